//! What valgrind prints with `--tool=lackey --trace-mem=yes`.

use std::io::BufRead;
use std::path::Path;

use super::access::{Access, AccessKind};
use super::builder::Builder;
use super::imported::Imported;
use super::text_file::{TextFile, number, quoted, words};
use trace::scene::SourceError;

/// Reads a trace. A line is `I` (instruction fetch), `L` (load), `S` (store) or `M` (a load and a store), and a hexadecimal
/// address, a comma and a decimal size. Lines that begin with `==`, `--` or `**` are valgrind's messages.
///
/// # Errors
/// The place of what is wrong, and what was expected: what the program itself printed is no trace.
pub fn read(file: &Path, input: impl BufRead, line_bytes: u32) -> Result<Imported, SourceError> {
    let mut text = TextFile::new(file, input);
    let mut builder = Builder::of_bytes().map_err(|what| text.whole(what))?;
    while text.next_line()? {
        let mut words = words(&text.line);
        let Some((at, label)) = words.next() else { continue };
        if is_message(label) {
            continue;
        }
        let Some(kinds) = kinds(label) else {
            return Err(text.error(at, format!("{}, expected I, L, S or M, or a line of valgrind's", quoted(label))));
        };
        let Some((at, place)) = words.next() else {
            return Err(text.error(text.line.len(), format!("the line ends here, expected {PLACE}")));
        };
        let Some((address, bytes)) = address_and_size(place) else {
            return Err(text.error(at, format!("{}, expected {PLACE}", quoted(place))));
        };
        for &kind in kinds {
            builder.access(Access { kind, address, bytes }).map_err(|what| text.error(at, what))?;
        }
        if let Some((at, rest)) = words.next() {
            return Err(text.error(at, format!("{}, expected the end of the line", quoted(rest))));
        }
    }
    builder.finish(line_bytes).map_err(|what| text.whole(what))
}

const PLACE: &str = "a hexadecimal address, a comma and a decimal size";

/// Whether a line is certainly one of such a trace.
pub(super) fn is_line(line: &[u8]) -> bool {
    let mut words = words(line).map(|(_, word)| word);
    match words.next() {
        Some(label) if is_message(label) => {
            let process = label.strip_prefix(b"==").and_then(|rest| rest.strip_suffix(b"=="));
            process.is_some_and(|process| number(process, 10).is_some())
        }
        Some(label) => kinds(label).is_some() && words.next().is_some_and(|place| address_and_size(place).is_some()),
        None => false,
    }
}

fn is_message(label: &[u8]) -> bool {
    [b"==", b"--", b"**"].into_iter().any(|mark| label.starts_with(mark))
}

fn kinds(label: &[u8]) -> Option<&'static [AccessKind]> {
    match label {
        b"I" => Some(&[AccessKind::Fetch]),
        b"L" => Some(&[AccessKind::Read]),
        b"S" => Some(&[AccessKind::Write]),
        b"M" => Some(&[AccessKind::Read, AccessKind::Write]),
        _ => None,
    }
}

fn address_and_size(place: &[u8]) -> Option<(u64, u32)> {
    let comma = place.iter().position(|byte| *byte == b',')?;
    let (address, size) = (&place[..comma], &place[comma + 1..]);
    Some((number(address, 16)?, u32::try_from(number(size, 10)?).ok()?))
}
