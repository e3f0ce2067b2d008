//! Traces in the format of Dinero: a label and a hexadecimal address a line; what follows them is a comment.

use std::io::BufRead;
use std::path::Path;

use super::imported::{Builder, Imported};
use super::table_lines::Unit;
use super::text_file::{TextFile, hexadecimal, number, quoted};
use trace::scene::SourceError;

/// Reads a trace. Reads (label 0) and instruction fetches (2) are references, and writes (1) too, but those are counted.
/// A reference has no size: it is to the line that its address lies in.
///
/// # Errors
/// The place of what is wrong, and what was expected.
pub fn read(file: &Path, input: impl BufRead) -> Result<Imported, SourceError> {
    let mut text = TextFile::new(file, input);
    let mut builder = Builder::new(Unit::Bytes).map_err(|what| text.whole(what))?;
    while text.next_line()? {
        let mut words = words(&text.line);
        let Some((at, label)) = words.next() else { continue };
        match label {
            b"0" | b"2" => {}
            b"1" => builder.writes += 1,
            _ => {
                let what = format!("label {}, expected 0 (read), 1 (write) or 2 (instruction)", quoted(label));
                return Err(text.error(at, what));
            }
        }
        let Some((at, digits)) = words.next() else {
            return Err(text.error(text.line.len(), "the line ends here, expected a hexadecimal address"));
        };
        let Some(address) = number(hexadecimal(digits).unwrap_or(digits), 16) else {
            let what = format!("{}, expected a hexadecimal address of at most 64 bits", quoted(digits));
            return Err(text.error(at, what));
        };
        builder.reference(address, 1).map_err(|what| text.error(at, what))?;
    }
    builder.finish().map_err(|what| text.whole(what))
}

/// Where words start, and they.
fn words(line: &[u8]) -> impl Iterator<Item = (usize, &[u8])> {
    let start = |word: &[u8]| word.as_ptr() as usize - line.as_ptr() as usize;
    line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()).map(move |word| (start(word), word))
}
