//! A scene in OBJ, a NUL, the material library `m` that it may name; compiled, its octree built, and traced.
#![no_main]

use libfuzzer_sys::fuzz_target;
use marti_fuzz::{split, trace_scene, with_folder};

fuzz_target!(|data: &[u8]| {
    let (obj, mtl) = split(data);
    let scene = with_folder(&[("scene.obj", obj), ("m", mtl)], |folder| trace::scene::load(&folder.join("scene.obj")));
    if let Ok(scene) = scene {
        trace_scene(&scene);
    }
});
