//! Traces of memory in Ramulator's text formats: `LD ADDRESS` and `ST ADDRESS`, or `ADDRESS R` and `ADDRESS W`.

use std::io::BufRead;
use std::path::Path;

use super::access::{Access, AccessKind};
use super::builder::Builder;
use super::imported::Imported;
use super::text_file::{TextFile, quoted, unsigned, words};
use trace::scene::SourceError;

/// Reads a trace. Addresses are decimal, or hexadecimal after `0x`. A reference has no size: it is to the line that its
/// address lies in.
///
/// # Errors
/// The place of what is wrong, and what was expected.
pub fn read(file: &Path, input: impl BufRead, line_bytes: u32) -> Result<Imported, SourceError> {
    let mut text = TextFile::new(file, input);
    let mut builder = Builder::of_bytes().map_err(|what| text.whole(what))?;
    while text.next_line()? {
        let mut words = words(&text.line);
        let Some((at, first)) = words.next() else { continue };
        let Some((second_at, second)) = words.next() else {
            return Err(text.error(text.line.len(), format!("the line ends here, expected {FORMATS}")));
        };
        let Some((kind, address)) = reference(first, second) else {
            let what = format!("{} and {}, expected {FORMATS}", quoted(first), quoted(second));
            return Err(text.error(at, what));
        };
        if let Some((at, rest)) = words.next() {
            return Err(text.error(at, format!("{}, expected the end of the line", quoted(rest))));
        }
        let access = builder.access(Access { kind, address, bytes: 1 });
        access.map_err(|what| text.error(second_at, what))?;
    }
    builder.finish(line_bytes).map_err(|what| text.whole(what))
}

const FORMATS: &str = "LD or ST and an address, or an address and R or W; an address is decimal, or hexadecimal after 0x, of at most 64 bits";

/// Whether a line is certainly one of such a trace.
pub(super) fn is_line(line: &[u8]) -> bool {
    let words: Vec<&[u8]> = words(line).map(|(_, word)| word).take(3).collect();
    matches!(words[..], [first, second] if reference(first, second).is_some())
}

fn reference(first: &[u8], second: &[u8]) -> Option<(AccessKind, u64)> {
    match (first, second) {
        (b"LD", address) | (address, b"R") => Some((AccessKind::Read, unsigned(address)?)),
        (b"ST", address) | (address, b"W") => Some((AccessKind::Write, unsigned(address)?)),
        _ => None,
    }
}
