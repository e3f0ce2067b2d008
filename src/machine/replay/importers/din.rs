//! Traces in the formats of Dinero: the classic one, and the extended one that Dinero IV has besides.
//!
//! What each label does is what Dinero IV does with it (its `dinfmt.c`, `xdinfmt.c` and `ref.c`). A copy back (4, `c`) writes
//! back what is dirty of the line, which stays; an invalidation (5, `v`) drops the line without writing it back. Neither is a
//! reference: they are counted by themselves.

use std::io::BufRead;
use std::path::Path;

use super::access::{Access, AccessKind};
use super::builder::Builder;
use super::imported::Imported;
use super::text_file::{TextFile, hexadecimal, number, quoted, words};
use trace::scene::SourceError;

/// What a classic reference has: Dinero reads words, at addresses rounded down to these.
const WORD_BYTES: u32 = 4;

/// Reads a trace for lines of `line_bytes` or more.
///
/// A line of the classic format is a hexadecimal label (0 read, 1 write, 2 instruction fetch, 3 other read, 4 copy back, 5
/// invalidate) and a hexadecimal address; one of the extended format a letter (`r`, `w`, `i`, `m`, `c`, `v`), and a
/// hexadecimal address and size. What follows is a comment. The first line decides which it is. A copy back or an
/// invalidation concerns the line that its address lies in; one of size 0 the whole memory.
///
/// # Errors
/// The place of what is wrong, and what was expected.
pub fn read(file: &Path, input: impl BufRead, line_bytes: u32) -> Result<Imported, SourceError> {
    let mut text = TextFile::new(file, input);
    let mut builder = Builder::of_bytes().map_err(|what| text.whole(what))?;
    let mut is_extended = None;
    while text.next_line()? {
        let mut words = words(&text.line);
        let Some((at, label)) = words.next() else { continue };
        let is_extended = *is_extended.get_or_insert_with(|| extended(label).is_some());
        let kind = if is_extended { extended(label) } else { classic(label) };
        let Some(kind) = kind else {
            return Err(text.error(at, format!("label {}, expected {}", quoted(label), expected(is_extended))));
        };
        let mut hexadecimal_word = |what: &str| {
            let Some((at, digits)) = words.next() else {
                return Err(text.error(text.line.len(), format!("the line ends here, expected a hexadecimal {what}")));
            };
            let value = number(hexadecimal(digits).unwrap_or(digits), 16);
            let wrong = || format!("{}, expected a hexadecimal {what} of at most 64 bits", quoted(digits));
            Ok((at, value.ok_or_else(|| text.error(at, wrong()))?))
        };
        let (at, address) = hexadecimal_word("address")?;
        let reference = if is_extended {
            let (at, bytes) = hexadecimal_word("size")?;
            match bytes {
                0 => builder.whole_memory(kind).map_err(|what| text.error(at, what)),
                _ => {
                    let is_of_one_line = matches!(kind, AccessKind::CopyBack | AccessKind::Invalidate);
                    let bytes = if is_of_one_line { 1 } else { u32::try_from(bytes).unwrap_or(u32::MAX) };
                    builder.access(Access { kind, address, bytes }).map_err(|what| text.error(at, what))
                }
            }
        } else {
            let address = address & !u64::from(WORD_BYTES - 1);
            builder.access(Access { kind, address, bytes: WORD_BYTES }).map_err(|what| text.error(at, what))
        };
        reference?;
    }
    builder.finish(line_bytes).map_err(|what| text.whole(what))
}

/// Whether a line is certainly one of the extended format.
pub(super) fn is_extended_line(line: &[u8]) -> bool {
    let mut words = words(line).map(|(_, word)| word);
    let is_label = words.next().is_some_and(|label| extended(label).is_some());
    let is_number = |word: &[u8]| number(hexadecimal(word).unwrap_or(word), 16).is_some();
    is_label && words.next().is_some_and(is_number) && words.next().is_some_and(is_number)
}

/// Dinero takes a hexadecimal number of any length.
fn classic(label: &[u8]) -> Option<AccessKind> {
    match number(hexadecimal(label).unwrap_or(label), 16)? {
        0 | 3 => Some(AccessKind::Read),
        1 => Some(AccessKind::Write),
        2 => Some(AccessKind::Fetch),
        4 => Some(AccessKind::CopyBack),
        5 => Some(AccessKind::Invalidate),
        _ => None,
    }
}

fn extended(label: &[u8]) -> Option<AccessKind> {
    match label {
        b"r" | b"R" | b"m" | b"M" => Some(AccessKind::Read),
        b"w" | b"W" => Some(AccessKind::Write),
        b"i" | b"I" => Some(AccessKind::Fetch),
        b"c" | b"C" => Some(AccessKind::CopyBack),
        b"v" | b"V" => Some(AccessKind::Invalidate),
        _ => None,
    }
}

fn expected(is_extended: bool) -> &'static str {
    if is_extended {
        "r (read), w (write), i (instruction), m (other read), c (copy back) or v (invalidate)"
    } else {
        "0 (read), 1 (write), 2 (instruction), 3 (other read), 4 (copy back) or 5 (invalidate)"
    }
}
