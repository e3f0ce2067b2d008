//! The columns of a recording, and what its schema says of it. docs/recording.md explains each.

use std::collections::HashMap;
use std::sync::Arc;

use arrow_array::types::Int8Type;
use arrow_array::{ArrayRef, DictionaryArray, Int8Array, RecordBatch, StringArray};
use arrow_array::{UInt16Array, UInt32Array, UInt64Array};
use arrow_schema::{ArrowError, DataType, Field, Schema, SchemaRef};

use crate::hardware::specification::Arbiter;
use crate::hardware::transaction::{Kind, Transaction};
use crate::recording::metadata;
use ground::ids::{ClusterId, Epoch};
use trace::database::{Layout, Section};

/// The newest. Raised when a column changes its name, type or meaning; a column added at the end does not raise it.
pub const FORMAT_VERSION: u32 = metadata::FORMAT_VERSION;

/// What holds for a recording as a whole. Kept as strings in the schema, under keys that begin with `marti.`.
#[derive(Clone, PartialEq, Debug)]
pub struct Metadata {
    pub cluster: ClusterId,
    /// Of the bus.
    pub epoch: Epoch,
    pub arbiter: Arbiter,
    pub layout: Layout,
}

impl Metadata {
    fn entries(&self) -> HashMap<String, String> {
        let arbiter = match self.arbiter {
            Arbiter::Fifo => "fifo".to_owned(),
            Arbiter::RoundRobin { quantum } => format!("round_robin {quantum}"),
            Arbiter::FixedPriority => "fixed_priority".to_owned(),
        };
        let own = [("marti.cluster", self.cluster.0.to_string()), ("marti.arbiter", arbiter)];
        metadata::entries(self.epoch, &self.layout, own)
    }

    /// What a schema says.
    ///
    /// # Errors
    /// An entry is missing, is not what it should be, or belongs to a version that this one does not read.
    pub(super) fn parse<'a>(entry: impl Fn(&str) -> Option<&'a str>) -> Result<Self, String> {
        let version = entry("marti.format_version").ok_or("expected the schema of a bus log, found another")?;
        if !metadata::is_known_version(version) {
            return Err(format!("expected format version 1 to {FORMAT_VERSION}, found {version:?}"));
        }
        let missing = |key: &str| format!("the schema says nothing of {key}");
        let number = |key: &str| {
            let text = entry(key).ok_or_else(|| missing(key))?;
            text.parse::<u64>().map_err(|_| format!("{key}: expected a number, found {text:?}"))
        };
        let small = |key: &str, max: u64| match number(key)? {
            number if number <= max => Ok(number),
            number => Err(format!("{key}: expected at most {max}, found {number}")),
        };
        let arbiter = entry("marti.arbiter").ok_or_else(|| missing("marti.arbiter"))?;
        let layout = metadata::parse_layout(&entry)?;
        let (said, counted) = (number("marti.image_bytes")?, layout.database_bytes());
        if said != counted {
            return Err(format!("marti.image_bytes: expected the {counted} of marti.records, found {said}"));
        }
        Ok(Self {
            cluster: ClusterId(small("marti.cluster", u64::from(u16::MAX))? as u16),
            epoch: Epoch(small("marti.epoch", u64::from(u32::MAX))? as u32),
            arbiter: parse_arbiter(arbiter).ok_or_else(|| format!("marti.arbiter: {arbiter:?} is not known"))?,
            layout,
        })
    }
}

fn parse_arbiter(text: &str) -> Option<Arbiter> {
    match text.split_once(' ') {
        None if text == "fifo" => Some(Arbiter::Fifo),
        None if text == "fixed_priority" => Some(Arbiter::FixedPriority),
        Some(("round_robin", quantum)) => {
            let quantum = quantum.parse().ok().filter(|quantum| (1..=1024).contains(quantum))?;
            Some(Arbiter::RoundRobin { quantum })
        }
        _ => None,
    }
}

/// Turns rows into record batches of one schema.
pub(super) struct Format {
    schema: SchemaRef,
    version: u32,
    /// The names of kinds and of sections, each at its code. Shared by all batches, so that they are written once.
    kinds: ArrayRef,
    sections: ArrayRef,
}

impl Format {
    /// The schema, without what it says of one recording.
    pub(super) fn columns() -> Schema {
        let name = || DataType::Dictionary(Box::new(DataType::Int8), Box::new(DataType::Utf8));
        let always = |column: &str, data_type| Field::new(column, data_type, false);
        let sometimes = |column: &str, data_type| Field::new(column, data_type, true);
        Schema::new(vec![
            always("sequence", DataType::UInt64),
            always("epoch", DataType::UInt32),
            always("cluster", DataType::UInt16),
            always("kind", name()),
            sometimes("node", DataType::UInt16),
            sometimes("tile", DataType::UInt32),
            sometimes("attempt", DataType::UInt32),
            sometimes("section", name()),
            sometimes("address", DataType::UInt64),
            always("bytes", DataType::UInt32),
            sometimes("lines", DataType::UInt32),
            sometimes("crc32c", DataType::UInt32),
            sometimes("accesses_before", DataType::UInt64),
            always("request_ns", DataType::UInt64),
            always("grant_ns", DataType::UInt64),
            always("completion_ns", DataType::UInt64),
        ])
    }

    pub(super) fn new(metadata: &Metadata) -> Self {
        Self {
            version: metadata::format_version(&metadata.layout),
            schema: Arc::new(Self::columns().with_metadata(metadata.entries())),
            kinds: Arc::new(StringArray::from_iter_values(Kind::ALL.map(Kind::name))),
            sections: Arc::new(StringArray::from_iter_values(Section::ALL.map(Section::name))),
        }
    }

    /// In which the log is written.
    pub(super) fn version(&self) -> u32 {
        self.version
    }

    pub(super) fn schema(&self) -> &SchemaRef {
        &self.schema
    }

    /// # Errors
    /// Never for rows of this program; arrow checks that columns and schema agree.
    pub(super) fn batch(&self, rows: &[Transaction]) -> Result<RecordBatch, ArrowError> {
        let u64s = |value: fn(&Transaction) -> u64| -> ArrayRef {
            Arc::new(UInt64Array::from_iter_values(rows.iter().map(value)))
        };
        let optional_u64s = |value: fn(&Transaction) -> Option<u64>| -> ArrayRef {
            Arc::new(rows.iter().map(value).collect::<UInt64Array>())
        };
        let u32s = |value: fn(&Transaction) -> u32| -> ArrayRef {
            Arc::new(UInt32Array::from_iter_values(rows.iter().map(value)))
        };
        let optional_u32s = |value: fn(&Transaction) -> Option<u32>| -> ArrayRef {
            Arc::new(rows.iter().map(value).collect::<UInt32Array>())
        };
        let names = |code: fn(&Transaction) -> Option<i8>, names: &ArrayRef| -> Result<ArrayRef, ArrowError> {
            let codes: Int8Array = rows.iter().map(code).collect();
            Ok(Arc::new(DictionaryArray::<Int8Type>::try_new(codes, Arc::clone(names))?))
        };
        let columns = vec![
            u64s(|row| row.sequence),
            u32s(|row| row.epoch.0),
            Arc::new(UInt16Array::from_iter_values(rows.iter().map(|row| row.cluster.0))),
            names(|row| Some(row.kind as i8), &self.kinds)?,
            Arc::new(rows.iter().map(|row| row.node.map(|node| node.0)).collect::<UInt16Array>()),
            optional_u32s(|row| row.tile.map(|tile| tile.0)),
            optional_u32s(|row| row.attempt.map(|attempt| attempt.0)),
            names(|row| row.section.map(|section| section as i8), &self.sections)?,
            optional_u64s(|row| row.address.map(|address| address.0)),
            u32s(|row| row.bytes),
            optional_u32s(|row| row.lines),
            optional_u32s(|row| row.crc32c),
            optional_u64s(|row| row.accesses_before),
            u64s(|row| row.request_nanoseconds),
            u64s(|row| row.grant_nanoseconds),
            u64s(|row| row.completion_nanoseconds),
        ];
        RecordBatch::try_new(Arc::clone(&self.schema), columns)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::rows::{check, rows};
    use super::*;
    use ground::ids::{Address, Attempt, NodeId, TileId};
    use trace::database::strides::Strides;

    pub(in super::super) fn metadata() -> Metadata {
        let layout = Layout::new([8, 10, 3, 0, 0, 3, 0, 1, 0]).expect("small");
        Metadata { cluster: ClusterId(2), epoch: Epoch(1), arbiter: Arbiter::RoundRobin { quantum: 4 }, layout }
    }

    /// A fetch, a job and a write in turn; every value tells its row.
    pub(in super::super) fn row(sequence: u64) -> Transaction {
        let fetch = sequence.is_multiple_of(3);
        let write = sequence % 3 == 2;
        let small = sequence as u32;
        let address = Address(sequence % 70 * 16);
        let lines = (small % 50) | 1;
        Transaction {
            sequence,
            epoch: Epoch(1),
            cluster: ClusterId(2),
            kind: [Kind::Fetch, Kind::Job, Kind::Write][small as usize % 3],
            node: (!write).then_some(NodeId(small as u16 % 9)),
            tile: (!write).then_some(TileId(small / 10)),
            attempt: (!write).then_some(Attempt(0)),
            section: fetch.then(|| metadata().layout.section_at(address)).flatten(),
            address: (fetch || write).then_some(address),
            bytes: if fetch { lines.count_ones() * 16 } else { 16 + small % 100 },
            lines: fetch.then_some(lines),
            crc32c: (fetch || write).then_some(!small),
            accesses_before: fetch.then_some(sequence * 1000),
            request_nanoseconds: sequence * 100,
            grant_nanoseconds: sequence * 100 + 10,
            completion_nanoseconds: sequence * 100 + 20,
        }
    }

    #[test]
    fn rows_survive_the_columns() {
        let written: Vec<_> = (0..30).map(row).collect();
        let batch = Format::new(&metadata()).batch(&written).expect("columns and schema agree");
        assert_eq!(rows(&batch), Ok(written.clone()));
        let mut before = None;
        for row in &written {
            assert_eq!(check(row, before, &metadata()), Ok(()));
            before = Some(row);
        }
    }

    #[test]
    fn a_schema_says_which_layout_it_is_of() {
        let strides = Strides::new([4, 4, 76, 16, 32, 8, 72, 48, 300]).expect("possible");
        let counts = [8, 10, 3, 0, 0, 3, 0, 1, 2];
        for (layout, version) in [
            (metadata().layout, 1),
            (Layout::new(counts).expect("small"), 2),
            (Layout::padded([8, 10, 3, 0, 0, 3, 0, 1, 0], strides).expect("small"), 2),
            (Layout::padded(counts, strides).expect("small"), 2),
        ] {
            let written = Metadata { layout, ..metadata() };
            let format = Format::new(&written);
            let said = |key: &str| format.schema().metadata().get(key).map(String::as_str);
            assert_eq!((Metadata::parse(said), format.version()), (Ok(written.clone()), version));
            assert_eq!(said("marti.record_bytes").is_some(), version > 1);
        }
    }

    #[test]
    fn the_schema_says_what_the_recording_is_of() {
        let format = Format::new(&metadata());
        let entry = |key: &str| format.schema().metadata()[key].as_str();
        assert_eq!(entry("marti.format_version"), "1");
        assert_eq!(entry("marti.arbiter"), "round_robin 4");
        assert_eq!(entry("marti.image_bytes"), "1280");
        let records: HashMap<String, u64> = serde_json::from_str(entry("marti.records")).expect("JSON");
        assert_eq!(records.len(), Section::COUNT - 1, "no polygons");
        assert_eq!((records["octree_nodes"], records["leaf_lists"], records["spheres"]), (8, 10, 0));
    }
}
