//! Traces as tables of text: columns by name or number, apart by commas, tabs, semicolons or blanks.

use std::io::BufRead;
use std::path::Path;

use super::access::{Access, AccessKind, ObjectId};
use super::builder::Builder;
use super::csv_columns::{Columns, CsvOptions, Place};
use super::csv_fields::{Fields, UNCLOSED};
use super::imported::Imported;
use super::table_lines::EXTENT_BYTES_MAX;
use super::text_file::{TextFile, quoted, unsigned};
use trace::scene::SourceError;

/// Reads a table: of addresses of bytes, or of ids of objects. Without sizes a reference is to one unit of addresses, and an
/// object has size 1; objects of size 0 are left out, as libCacheSim leaves them out, and counted.
///
/// # Errors
/// The place of what is wrong, and what was expected.
pub fn read(file: &Path, input: impl BufRead, options: &CsvOptions, line_bytes: u32) -> Result<Imported, SourceError> {
    let mut text = TextFile::new(file, input);
    if !next_row(&mut text)? {
        return Err(text.whole("no references, expected at least one"));
    }
    let columns = Columns::new(&text.line, options).map_err(|(at, what)| text.error(at, what))?;
    let builder = match columns.place {
        Place::Address { .. } => Builder::of_bytes(),
        Place::Id => Builder::of_objects(),
    };
    let mut builder = builder.map_err(|what| text.whole(what))?;
    let mut is_row = !columns.has_header || next_row(&mut text)?;
    while is_row {
        row(&text, &columns, &mut builder)?;
        is_row = next_row(&mut text)?;
    }
    builder.finish(line_bytes).map_err(|what| text.whole(what))
}

/// Moves to the next line that is not empty; `false` at the end of the file.
fn next_row(text: &mut TextFile<impl BufRead>) -> Result<bool, SourceError> {
    while text.next_line()? {
        if !text.line.trim_ascii().is_empty() {
            return Ok(true);
        }
    }
    Ok(false)
}

fn row(text: &TextFile<impl BufRead>, columns: &Columns, builder: &mut Builder) -> Result<(), SourceError> {
    let (mut place, mut size, mut kind, mut count) = (None, None, AccessKind::Read, 0);
    for (column, field) in Fields::new(&text.line, columns.separator).enumerate() {
        let field = field.map_err(|at| text.error(at, UNCLOSED))?;
        count += 1;
        if column == columns.place_column {
            place = Some(field);
        } else if Some(column) == columns.size {
            let bytes = unsigned(field.bytes);
            size = Some(bytes.ok_or_else(|| text.error(field.at, bad_size(field.bytes, columns.place)))?);
        } else if Some(column) == columns.operation {
            kind = operation(field.bytes).unwrap_or_else(|| {
                builder.notes.unknown_operations += 1;
                AccessKind::Read
            });
        }
    }
    let Some(field) = place.filter(|_| count == columns.count) else {
        return Err(text.error(text.line.len(), format!("a row of {count} fields, expected {}", columns.count)));
    };
    let appended = match columns.place {
        Place::Id if field.bytes.is_empty() => Err("an empty field, expected an id".to_owned()),
        Place::Id => builder.object(kind, ObjectId::parse(field.bytes), size.unwrap_or(1)),
        Place::Address { unit } => {
            let address = unsigned(field.bytes).and_then(|address| address.checked_mul(u64::from(unit)));
            let address = address.ok_or_else(|| text.error(field.at, bad_address(field.bytes)))?;
            let bytes = u32::try_from(size.unwrap_or(u64::from(unit))).unwrap_or(u32::MAX);
            builder.access(Access { kind, address, bytes })
        }
    };
    appended.map_err(|what| text.error(field.at, what))
}

/// What tools call what a reference does: words of caches and of block devices, and commands of SCSI in hexadecimal.
fn operation(name: &[u8]) -> Option<AccessKind> {
    const NAMES: [(AccessKind, &[&str]); 5] = [
        (AccessKind::Read, &["r", "read", "rs", "get", "gets", "load", "ld", "l", "rd", "08", "28", "a8", "88"]),
        (
            AccessKind::Write,
            &[
                "w", "write", "ws", "set", "put", "add", "replace", "cas", "append", "prepend", "incr", "decr",
                "store", "st", "s", "wr", "0a", "2a", "aa", "8a",
            ],
        ),
        (AccessKind::Fetch, &["i", "fetch", "ifetch", "instruction"]),
        (AccessKind::Invalidate, &["d", "delete", "v", "invalidate", "trim", "discard", "t"]),
        (AccessKind::CopyBack, &["f", "flush", "c", "copyback"]),
    ];
    let name = name.strip_prefix(b"0x").unwrap_or(name);
    let is_named = |names: &[&str]| names.iter().any(|known| name.eq_ignore_ascii_case(known.as_bytes()));
    NAMES.iter().find(|(_, names)| is_named(names)).map(|(kind, _)| *kind)
}

fn bad_address(bytes: &[u8]) -> String {
    format!("{}, expected an address of at most 64 bits, decimal or hexadecimal after 0x", quoted(bytes))
}

fn bad_size(bytes: &[u8], place: Place) -> String {
    match place {
        Place::Address { .. } => format!("{}, expected bytes, 1 to {EXTENT_BYTES_MAX}", quoted(bytes)),
        Place::Id => format!("{}, expected a size of at most 64 bits", quoted(bytes)),
    }
}
