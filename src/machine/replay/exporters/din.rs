//! The trace format of Dinero: a line of text a reference, its label and its address.

use std::io::Write;

use super::{ExportError, line_references, parts};
use crate::replay::{Lines, Trace};

/// Writes `0 ADDRESS` for each reference to a line, by the tiles given, in order: a read, and the line's first byte in
/// hexadecimal. Returns how many there are.
///
/// # Errors
/// Of the trace, or of `out`.
pub fn write(
    out: &mut impl Write,
    trace: &(impl Trace + ?Sized),
    tiles: &[u32],
    lines: &impl Lines,
    line_bytes: u32,
) -> Result<u64, ExportError> {
    let (mut words, mut referenced) = (Vec::new(), Vec::new());
    let mut references = 0;
    for (_, part) in parts(trace, tiles) {
        trace.read(part, &mut words)?;
        referenced.clear();
        line_references(&words, lines, &mut referenced)?;
        for &line in &referenced {
            writeln!(out, "0 {:x}", u64::from(line) * u64::from(line_bytes))?;
        }
        references += referenced.len() as u64;
    }
    Ok(references)
}
