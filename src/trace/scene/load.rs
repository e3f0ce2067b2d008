//! A scene file by its extension.

use std::path::Path;

use super::{Scene, SourceError};

/// Reads a scene file: `.nff` or `.obj` (with its MTL files).
///
/// # Errors
/// What is wrong, with the file's name and, where it applies, line and column.
pub fn load(path: &Path) -> Result<Scene, SourceError> {
    let extension = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    match extension.as_deref() {
        Some("nff") => super::nff::load(path),
        Some("obj") => super::obj::load(path),
        _ => Err(SourceError::new(path, None, "not a scene file, expected a name ending in .nff or .obj")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::database::ear_clipping::triangulate;
    use crate::scene::{Camera, UpAxis};

    #[test]
    fn the_scenes_that_come_along_are_valid() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes");
        // Polygons, spheres, cones, triangles, lights.
        for (name, expected) in [("primitives.nff", (5, 2, 3, 8, 3)), ("house.obj", (23, 0, 0, 58, 0))] {
            let scene = load(&folder.join(name)).expect("valid");
            let cuts: Vec<_> = scene.polygons.iter().map(|polygon| triangulate(scene.corners(polygon))).collect();
            assert!(cuts.iter().all(|cut| cut.flaw.is_none()), "{name} has a polygon that crosses itself");
            let ears = cuts.iter().map(|cut| cut.ears.len()).sum();
            let counts = (scene.polygons.len(), scene.spheres.len(), scene.cones.len(), ears, scene.lights.len());
            assert_eq!(counts, expected, "{name}");
            let camera = scene.camera.unwrap_or_else(|| Camera::framing(scene.bounds(), UpAxis::Y, 1.0, 45.0));
            assert_eq!(camera.check(), Ok(()));
        }
    }

    #[test]
    fn other_files_are_refused_by_name() {
        for name in ["scene", "scene.txt", "nff", ".obj"] {
            let error = load(Path::new(name)).expect_err("not a scene");
            assert_eq!(error.to_string(), format!("{name}: not a scene file, expected a name ending in .nff or .obj"));
        }
        assert!(load(Path::new("NONE.NFF")).is_err_and(|error| error.what.starts_with("cannot be read")));
    }
}
