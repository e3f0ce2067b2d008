//! Traces as CSV: any with a column `address`, decimal or hexadecimal after `0x`, and perhaps a column `bytes`.

use std::io::BufRead;
use std::path::Path;

use super::imported::{Builder, Imported};
use super::table_lines::{EXTENT_BYTES_MAX, Unit};
use super::text_file::{TextFile, hexadecimal, number, quoted};
use trace::scene::SourceError;

/// Reads a trace whose first line names its columns. Without `bytes` a reference is to the line that its address lies
/// in. Fields may be in quotation marks, but not go on over the end of a line.
///
/// # Errors
/// The place of what is wrong, and what was expected.
pub fn read(file: &Path, input: impl BufRead) -> Result<Imported, SourceError> {
    let mut text = TextFile::new(file, input);
    let mut builder = Builder::new(Unit::Bytes).map_err(|what| text.whole(what))?;
    let columns = Columns::read(&mut text)?;
    while text.next_line()? {
        if text.line.trim_ascii().is_empty() {
            continue;
        }
        let (mut address, mut bytes, mut count) = (None, None, 0);
        for (column, field) in Fields::new(&text.line).enumerate() {
            let field = field.map_err(|at| text.error(at, UNCLOSED))?;
            count += 1;
            if column == columns.address {
                let known = unsigned(field.bytes);
                address = Some((field.at, known.ok_or_else(|| text.error(field.at, bad_address(field.bytes)))?));
            } else if Some(column) == columns.bytes {
                let known = unsigned(field.bytes).and_then(|bytes| u32::try_from(bytes).ok());
                bytes = Some(known.ok_or_else(|| text.error(field.at, bad_bytes(field.bytes)))?);
            }
        }
        let Some((at, address)) = address.filter(|_| count == columns.count) else {
            return Err(text.error(text.line.len(), format!("a row of {count} fields, expected {}", columns.count)));
        };
        builder.reference(address, bytes.unwrap_or(1)).map_err(|what| text.error(at, what))?;
    }
    builder.finish().map_err(|what| text.whole(what))
}

const UNCLOSED: &str = "a quotation mark that is not closed on its line, or text after it, expected one and a comma";

struct Columns {
    address: usize,
    bytes: Option<usize>,
    count: usize,
}

impl Columns {
    fn read(text: &mut TextFile<impl BufRead>) -> Result<Self, SourceError> {
        text.next_line()?;
        let (mut address, mut bytes, mut count) = (None, None, 0);
        for (column, field) in Fields::new(&text.line).enumerate() {
            let field = field.map_err(|at| text.error(at, UNCLOSED))?;
            count += 1;
            let place = match field.bytes {
                b"address" => &mut address,
                b"bytes" => &mut bytes,
                _ => continue,
            };
            if place.replace(column).is_some() {
                return Err(text.error(field.at, format!("a second column {}, expected one", quoted(field.bytes))));
            }
        }
        let address = address.ok_or_else(|| text.error(0, "no such column, expected one named \"address\""))?;
        Ok(Self { address, bytes, count })
    }
}

/// Decimal, or hexadecimal after `0x`.
fn unsigned(bytes: &[u8]) -> Option<u64> {
    hexadecimal(bytes).map_or_else(|| number(bytes, 10), |digits| number(digits, 16))
}

fn bad_address(bytes: &[u8]) -> String {
    format!("{}, expected an address of at most 64 bits, decimal or hexadecimal after 0x", quoted(bytes))
}

fn bad_bytes(bytes: &[u8]) -> String {
    format!("{}, expected bytes, 1 to {EXTENT_BYTES_MAX}", quoted(bytes))
}

struct Field<'a> {
    /// Where it starts in its line.
    at: usize,
    /// Without blanks and quotation marks around it; quotation marks within stay doubled.
    bytes: &'a [u8],
}

/// The fields of a line; where one starts that is in quotation marks and does not end as it should, and then no more.
struct Fields<'a> {
    line: &'a [u8],
    /// Where the next one starts, if there is one.
    next: Option<usize>,
}

impl<'a> Fields<'a> {
    fn new(line: &'a [u8]) -> Self {
        Self { line, next: Some(0) }
    }
}

impl<'a> Iterator for Fields<'a> {
    type Item = Result<Field<'a>, usize>;

    fn next(&mut self) -> Option<Self::Item> {
        let start = self.next.take()?;
        let rest = &self.line[start..];
        // A comma within quotation marks is none; a doubled quotation mark closes and opens again.
        let mut in_quotes = false;
        let ends = |byte: &u8| {
            in_quotes ^= *byte == b'"';
            *byte == b',' && !in_quotes
        };
        let length = rest.iter().position(ends).unwrap_or(rest.len());
        if length < rest.len() {
            self.next = Some(start + length + 1);
        }
        let field = rest[..length].trim_ascii();
        let at = start + length - rest[..length].trim_ascii_start().len();
        let bytes = match field {
            [b'"', inner @ .., b'"'] => inner,
            [b'"', ..] => return Some(Err(at)),
            _ => field,
        };
        Some(Ok(Field { at, bytes }))
    }
}
