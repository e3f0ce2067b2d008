//! The binary trace format of libCacheSim that knows the future, `oracleGeneral`.
//!
//! A reference is 24 bytes, little-endian and packed: u32 time, u64 object, u32 bytes, and i64 next access, the number
//! of the next reference to the same object, counted from 1, or −1 when there is none. Here an object is a line. No
//! clock was recorded: the time is the tile's place in the stream, far below the age at which libCacheSim forgets.

use std::io::{Seek, SeekFrom, Write};

use super::{ExportError, line_references, parts};
use crate::replay::{Lines, Trace, TraceError};

/// Bytes of a reference.
pub const REFERENCE_BYTES: u64 = 24;

/// A part of the trace, and where its references go.
struct CountedPart {
    tile: u32,
    part: u32,
    /// References before it.
    before: u64,
}

/// Writes each reference to a line, by the tiles given, in order. Returns how many there are.
///
/// The next access is known only to who comes from the end: parts are read once to count their references, and again
/// from the last to the first, each written to its place.
///
/// # Errors
/// Of the trace, or of `out`.
pub fn write(
    out: &mut (impl Write + Seek),
    trace: &(impl Trace + ?Sized),
    tiles: &[u32],
    lines: &impl Lines,
    line_bytes: u32,
) -> Result<u64, ExportError> {
    let (mut words, mut referenced) = (Vec::new(), Vec::new());
    let (mut counted, mut references) = (Vec::new(), 0);
    for (tile, part) in parts(trace, tiles) {
        counted.push(CountedPart { tile, part, before: references });
        trace.read(part, &mut words)?;
        referenced.clear();
        line_references(&words, lines, &mut referenced)?;
        references += referenced.len() as u64;
    }

    let start = out.stream_position()?;
    // By line, the number of its next reference; 0 when there is none.
    let mut next = vec![0u64; lines.count() as usize];
    let (mut bytes, mut end) = (Vec::new(), references);
    for &CountedPart { tile, part, before } in counted.iter().rev() {
        trace.read(part, &mut words)?;
        referenced.clear();
        line_references(&words, lines, &mut referenced)?;
        if referenced.len() as u64 != end - before {
            return Err(TraceError(format!("part {part} is not what it was a moment ago")).into());
        }
        bytes.resize(referenced.len() * REFERENCE_BYTES as usize, 0);
        let slots = bytes.chunks_exact_mut(REFERENCE_BYTES as usize);
        for ((number, &line), slot) in (before + 1..=end).rev().zip(referenced.iter().rev()).zip(slots.rev()) {
            let next_access = match std::mem::replace(&mut next[line as usize], number) {
                0 => -1,
                next => next as i64,
            };
            slot[..4].copy_from_slice(&tile.to_le_bytes());
            slot[4..12].copy_from_slice(&u64::from(line).to_le_bytes());
            slot[12..16].copy_from_slice(&line_bytes.to_le_bytes());
            slot[16..].copy_from_slice(&next_access.to_le_bytes());
        }
        out.seek(SeekFrom::Start(start + before * REFERENCE_BYTES))?;
        out.write_all(&bytes)?;
        end = before;
    }
    out.seek(SeekFrom::Start(start + references * REFERENCE_BYTES))?;
    Ok(references)
}
