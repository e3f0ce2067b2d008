//! What several fuzz targets do with bytes: put them into files, trace what came of them.

use std::fs;
use std::path::Path;

use tempfile::TempDir;
use trace::database::verify::Verified;
use trace::picture::{AovSet, ImageSettings, Pixels};
use trace::preparation::{self, ViewChoices};
use trace::render::{Kernel, Settings, render};
use trace::scene::{Camera, Scene};
use trace::tracer::View;
use trace::tracer::bvh8::Bvh8;
use trace::tracer::octree::{BuildParameters, build_database};
use trace::tracer::simd::Simd;

thread_local! {
    /// Whoever starts the process says by TMPDIR where it is, and removes it.
    static FOLDER: TempDir = tempfile::tempdir().expect("TMPDIR is writable");
}

/// Calls `read` with a folder of these files.
pub fn with_folder<T>(files: &[(&str, &[u8])], read: impl FnOnce(&Path) -> T) -> T {
    FOLDER.with(|folder| {
        for (name, bytes) in files {
            fs::write(folder.path().join(name), bytes).expect("TMPDIR is writable");
        }
        read(folder.path())
    })
}

/// Calls `read` with a file of these bytes.
pub fn with_file<T>(name: &str, bytes: &[u8], read: impl FnOnce(&Path) -> T) -> T {
    with_folder(&[(name, bytes)], |folder| read(&folder.join(name)))
}

/// The part of the input before the first NUL, and what is behind it.
pub fn split(data: &[u8]) -> (&[u8], &[u8]) {
    let end = data.iter().position(|byte| *byte == 0).unwrap_or(data.len());
    (&data[..end], data.get(end + 1..).unwrap_or_default())
}

/// Some pixels by every kernel, and how many of them were not finite.
pub fn images(database: &Verified, view: &View) -> Vec<(Pixels, u64)> {
    let bvh = Bvh8::build(database);
    let packets = Simd::available().map(|simd| Kernel::Packets(&bvh, simd));
    let kernels = packets.chain([true, false].map(|mailbox| Kernel::Single { mailbox }));
    let image = |kernel| {
        let settings = Settings { threads: 1, aov: AovSet { depth: true, normal: true, primitive: true }, kernel };
        let rendering =
            render(database, view, settings, |_| std::ops::ControlFlow::Continue(())).expect("a small image");
        (rendering.frame.pixels().clone(), rendering.stats.non_finite_pixels)
    };
    kernels.map(image).collect()
}

/// Few pixels, two bounces.
pub const IMAGE: ImageSettings = match ImageSettings::new(8, 6, 2, 0.0) {
    Ok(image) => image,
    Err(_) => panic!("possible"),
};

/// What a camera sees of something that brings no view.
pub fn view_of(camera: Camera) -> View {
    View { camera, lights: camera.framing_lights().to_vec(), background: Scene::default().background, image: IMAGE }
}

/// Compiles a scene and traces it; all kernels have to agree bit by bit. Larger ones would only take longer.
pub fn trace_scene(scene: &Scene) {
    if scene.primitive_count() > 200 || scene.vertices.len() > 1000 {
        return;
    }
    let Ok(view) = preparation::view(scene, &ViewChoices::default(), |_| Ok(IMAGE)) else { return };
    if let Ok(database) = build_database(scene, BuildParameters { leaf_size: 2, max_depth: 6 }) {
        let images = images(&database, &view);
        assert!(images.iter().all(|image| *image == images[0]), "another image by another kernel");
    }
}
