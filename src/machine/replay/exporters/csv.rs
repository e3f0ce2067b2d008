//! CSV: a row for each record that was read.

use std::io::Write;

use super::ExportError;
use super::accesses::{self, Access, Surroundings};
use crate::replay::Trace;

/// The columns; what is not known of a record is left empty.
pub const HEADER: &str = "node,tile,attempt,x,y,ray,section,level,record,address,bytes";

/// Writes the records that were read for the tiles given, in order. Returns how many there are.
///
/// # Errors
/// Of the trace, or of `out`.
pub fn write(
    out: &mut impl Write,
    trace: &(impl Trace + ?Sized),
    tiles: &[u32],
    surroundings: Surroundings,
) -> Result<u64, ExportError> {
    writeln!(out, "{HEADER}")?;
    accesses::visit(trace, tiles, surroundings, |access| {
        let Access { node, tile, attempt, pixel, ray, section, level, index, address, bytes } = access;
        write!(out, "{},{},{},", node.0, tile.0, attempt.0)?;
        match pixel {
            Some((x, y)) => write!(out, "{x},{y},")?,
            None => write!(out, ",,")?,
        }
        write!(out, "{},{},", ray.map_or("", |ray| ray.name()), section.name())?;
        if let Some(level) = level {
            write!(out, "{level}")?;
        }
        Ok(writeln!(out, ",{index},{address},{bytes}")?)
    })
}
