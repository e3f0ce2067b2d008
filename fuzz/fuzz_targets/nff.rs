//! A scene in NFF, compiled, its octree built, and traced by every kernel.
#![no_main]

use libfuzzer_sys::fuzz_target;
use marti_fuzz::{trace_scene, with_file};

fuzz_target!(|data: &[u8]| {
    if let Ok(scene) = with_file("scene.nff", data, trace::scene::load) {
        trace_scene(&scene);
    }
});
