//! JSON Lines: an object for each record that was read.

use std::fmt::{self, Display};
use std::io::Write;

use super::ExportError;
use super::accesses::{self, Access, Surroundings};
use crate::replay::Trace;

/// Writes the records that were read for the tiles given, in order. Returns how many there are. What is not known of
/// a record is `null`.
///
/// # Errors
/// Of the trace, or of `out`.
pub fn write(
    out: &mut impl Write,
    trace: &(impl Trace + ?Sized),
    tiles: &[u32],
    surroundings: Surroundings,
) -> Result<u64, ExportError> {
    accesses::visit(trace, tiles, surroundings, |access| {
        let Access { node, tile, attempt, pixel, ray, section, level, index, address, bytes } = access;
        let (x, y) = (OrNull(pixel.map(|pixel| pixel.0)), OrNull(pixel.map(|pixel| pixel.1)));
        write!(out, r#"{{"node":{},"tile":{},"attempt":{},"x":{x},"y":{y},"#, node.0, tile.0, attempt.0)?;
        // The names are words of letters and underlines: there is nothing to escape.
        match ray {
            Some(ray) => write!(out, r#""ray":"{}","#, ray.name())?,
            None => write!(out, r#""ray":null,"#)?,
        }
        let (section, level) = (section.name(), OrNull(*level));
        write!(out, r#""section":"{section}","level":{level},"record":{index},"#)?;
        Ok(writeln!(out, r#""address":{address},"bytes":{bytes}}}"#)?)
    })
}

struct OrNull<T>(Option<T>);

impl<T: Display> Display for OrNull<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.0 {
            Some(value) => value.fmt(f),
            None => f.write_str("null"),
        }
    }
}
