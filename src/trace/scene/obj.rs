//! Wavefront OBJ with MTL materials.
//!
//! Polygons stay polygons. What cannot change the geometry is repaired or left out, with a warning; a vertex that is
//! not there and a coordinate that is not a number are errors. OBJ has neither a camera nor lights.

mod definition;
mod folder;
mod libraries;
mod materials;
mod mtl;
mod reader;
mod smoothing;
mod statements;
mod vertex;

use std::path::Path;

use super::source::Source;
use super::{Scene, SourceError};
use folder::Folder;

/// Larger files are refused, so that no index outgrows 32 bits and memory stays within some 40 GiB.
pub const OBJ_BYTES_MAX: u64 = 1 << 30;
/// Of all material libraries of a scene together.
pub const MTL_BYTES_MAX: u64 = 64 << 20;

/// Reads an OBJ file and the material libraries it names, in paths relative to its own folder.
///
/// # Errors
/// The file cannot be read, is larger than [`OBJ_BYTES_MAX`], or its first mistake that changes the geometry, with
/// line and column.
pub fn load(path: &Path) -> Result<Scene, SourceError> {
    let source = Source::read(path, OBJ_BYTES_MAX)?;
    let folder = Folder::of(path, MTL_BYTES_MAX);
    reader::read(&source, |name, spelling| folder.read(name, spelling))
}

#[cfg(test)]
mod tests;
