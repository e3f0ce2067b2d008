//! From columns back to transactions, each of which is held against what a bus can have done.

use arrow_array::cast::AsArray;
use arrow_array::types::{ArrowPrimitiveType, Int8Type, UInt16Type, UInt32Type, UInt64Type};
use arrow_array::{Array, DictionaryArray, PrimitiveArray, RecordBatch};

use super::format::Metadata;
use crate::hardware::transaction::{Kind, Transaction};
use ground::ids::{Address, Attempt, ClusterId, Epoch, NodeId, TileId};
use trace::database::Section;

/// The rows of a batch, in order.
///
/// # Errors
/// A column is missing or of another type, or names something that this version does not know.
pub(super) fn rows(batch: &RecordBatch) -> Result<Vec<Transaction>, String> {
    let kinds = names(batch, "kind", |name| Kind::ALL.into_iter().find(|kind| kind.name() == name))?;
    let sections = names(batch, "section", |name| Section::ALL.into_iter().find(|section| section.name() == name))?;
    let (sequence, epoch) = (column::<UInt64Type>(batch, "sequence")?, column::<UInt32Type>(batch, "epoch")?);
    let (cluster, node) = (column::<UInt16Type>(batch, "cluster")?, column::<UInt16Type>(batch, "node")?);
    let (tile, attempt) = (column::<UInt32Type>(batch, "tile")?, column::<UInt32Type>(batch, "attempt")?);
    let (address, bytes) = (column::<UInt64Type>(batch, "address")?, column::<UInt32Type>(batch, "bytes")?);
    let (lines, crc32c) = (column::<UInt32Type>(batch, "lines")?, column::<UInt32Type>(batch, "crc32c")?);
    let accesses_before = column::<UInt64Type>(batch, "accesses_before")?;
    let request = column::<UInt64Type>(batch, "request_ns")?;
    let (grant, completion) = (column::<UInt64Type>(batch, "grant_ns")?, column::<UInt64Type>(batch, "completion_ns")?);
    let row = |i: usize| {
        Some(Transaction {
            sequence: at(sequence, i)?,
            epoch: Epoch(at(epoch, i)?),
            cluster: ClusterId(at(cluster, i)?),
            kind: kinds[i]?,
            node: at(node, i).map(NodeId),
            tile: at(tile, i).map(TileId),
            attempt: at(attempt, i).map(Attempt),
            section: sections[i],
            address: at(address, i).map(Address),
            bytes: at(bytes, i)?,
            lines: at(lines, i),
            crc32c: at(crc32c, i),
            accesses_before: at(accesses_before, i),
            request_nanoseconds: at(request, i)?,
            grant_nanoseconds: at(grant, i)?,
            completion_nanoseconds: at(completion, i)?,
        })
    };
    let null = |i: usize| format!("row {i} of the batch is null where none may be");
    (0..batch.num_rows()).map(|i| row(i).ok_or_else(|| null(i))).collect()
}

fn column<'a, T: ArrowPrimitiveType>(batch: &'a RecordBatch, name: &str) -> Result<&'a PrimitiveArray<T>, String> {
    let found = batch.column_by_name(name).and_then(|column| column.as_primitive_opt::<T>());
    found.ok_or_else(|| format!("expected a column {name:?} of {}", T::DATA_TYPE))
}

fn at<T: ArrowPrimitiveType>(column: &PrimitiveArray<T>, i: usize) -> Option<T::Native> {
    column.is_valid(i).then(|| column.value(i))
}

/// What the dictionary of a column names, row by row.
fn names<T: Copy>(
    batch: &RecordBatch,
    name: &str,
    known: impl Fn(&str) -> Option<T>,
) -> Result<Vec<Option<T>>, String> {
    let not_here = || format!("expected a column {name:?} of names");
    let found: &DictionaryArray<Int8Type> =
        batch.column_by_name(name).and_then(|column| column.as_dictionary_opt()).ok_or_else(not_here)?;
    let words = found.values().as_string_opt::<i32>().ok_or_else(not_here)?;
    let meanings: Vec<Option<T>> = words.iter().map(|word| word.and_then(&known)).collect();
    let meaning = |i: usize| match found.key(i) {
        None => Ok(None),
        Some(key) => meanings.get(key).copied().flatten().map(Some).ok_or_else(|| {
            let word = if key < words.len() { words.value(key) } else { "" };
            format!("{name} {word:?} is not known to this version")
        }),
    };
    (0..found.len()).map(meaning).collect()
}

/// That a row is a transaction of this recording's bus, after the one `before` it.
///
/// # Errors
/// It is not; what was expected, and what found.
pub(super) fn check(row: &Transaction, before: Option<&Transaction>, of: &Metadata) -> Result<(), String> {
    let sequence = before.map_or(0, |before| before.sequence + 1);
    if row.sequence != sequence {
        return Err(format!("expected sequence {sequence}, found {}", row.sequence));
    }
    let said = |what: String| Err(format!("sequence {sequence}: {what}"));
    if (row.epoch, row.cluster) != (of.epoch, of.cluster) {
        return said(format!("expected {} {}, found {} {}", of.cluster, of.epoch, row.cluster, row.epoch));
    }
    let free = before.map_or(0, |before| before.completion_nanoseconds);
    let (request, grant, completion) = (row.request_nanoseconds, row.grant_nanoseconds, row.completion_nanoseconds);
    if request > grant || grant > completion || grant < free {
        return said(format!(
            "expected a request, a grant at {free} ns or later and a completion in this order, found {request}, {grant} \
             and {completion} ns"
        ));
    }
    match shape(row, of) {
        None => Ok(()),
        Some(expected) => said(format!("expected {expected}")),
    }
}

/// What was expected of a row of this kind, if it is not that.
fn shape(row: &Transaction, of: &Metadata) -> Option<&'static str> {
    let attempted = row.tile.is_some() && row.attempt.is_some();
    let moved = row.address.is_some() && row.crc32c.is_some();
    let only_fetch = row.section.is_none() && row.lines.is_none() && row.accesses_before.is_none();
    let end = |span: u64| row.address.and_then(|address| address.0.checked_add(span));
    let within = |span: u64| end(span).is_some_and(|end| end <= of.layout.database_bytes());
    let sound = match row.kind {
        Kind::Fetch => {
            let (Some(address), Some(section), Some(lines), Some(_)) =
                (row.address, row.section, row.lines, row.accesses_before)
            else {
                return Some("a fetch to have address, section, lines and accesses");
            };
            let line = row.bytes.checked_div(lines.count_ones()).unwrap_or_default();
            if lines & 1 == 0 || !line.is_power_of_two() || !(16..=256).contains(&line) {
                return Some("a fetch of whole lines of 16 to 256 bytes, the first among them");
            }
            let span = u64::from(u32::BITS - lines.leading_zeros()) * u64::from(line);
            if line * lines.count_ones() != row.bytes || !address.0.is_multiple_of(u64::from(line)) || !within(span) {
                return Some("a fetch of lines within the image");
            }
            if of.layout.section_at(address) != Some(section) {
                return Some("a fetch whose section is that of its address");
            }
            row.node.is_some() && attempted && moved
        }
        Kind::Bulk => row.node.is_some() && only_fetch && moved && row.bytes > 0 && within(u64::from(row.bytes)),
        Kind::Write => row.node.is_none() && only_fetch && moved && row.bytes > 0 && within(u64::from(row.bytes)),
        Kind::Job | Kind::Pixels => {
            row.node.is_some() && attempted && only_fetch && row.address.is_none() && row.crc32c.is_none()
        }
        // No version writes them yet.
        Kind::Allocate | Kind::Publish => true,
    };
    (!sound).then_some("the columns of its kind, within the image")
}
