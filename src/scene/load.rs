//! A scene file by its extension.

use std::path::Path;

use super::{Scene, SourceError};

/// Reads a scene file: `.nff` or `.obj` (with its MTL files).
///
/// # Errors
/// What is wrong, with the file's name and, where it applies, line and column.
pub fn load(path: &Path) -> Result<Scene, SourceError> {
    match path.extension().and_then(|e| e.to_str()) {
        Some("nff") => super::nff::load(path),
        Some("obj") => super::obj::load(path),
        _ => Err(SourceError::new(path, None, "not a scene file, expected a name ending in .nff or .obj")),
    }
}
