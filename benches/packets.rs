//! What packets do a ray, and how fast, with each set of vector instructions: `cargo bench --bench packets`.
//!
//! Ratios of one run, taken in turns; the machine's noise is in them.

use std::time::Duration;

use trace::picture::{AovSet, ImageSettings, Rect};
use trace::preparation::{self, Prepared, ViewChoices};
use trace::render::{self, Kernel, Settings};
use trace::scene::SceneSource;
use trace::tracer::bvh8::{BatchTracer, Bvh8};
use trace::tracer::octree::Octree;
use trace::tracer::simd::Simd;

const SIDE: u32 = 512;
const TURNS: usize = 5;

fn main() {
    for scene in ["gears:4", "teapot:12", "balls:4", "tetra:8"] {
        let source: SceneSource = scene.parse().expect("a procedural scene");
        let image = |_: &_| Ok(ImageSettings::new(SIDE, SIDE, 4, 0.0).expect("possible"));
        let prepared = preparation::prepare(&source, Octree::DEFAULT, &ViewChoices::default(), image).expect("small");
        let bvh = Bvh8::build(&prepared.database);
        println!(
            "{scene}: {} bytes derived, {} of the database",
            bvh.bytes(),
            prepared.database.database().header.layout.database_bytes()
        );
        counts(&prepared, &bvh);
        speeds(&prepared, &bvh);
    }
}

/// Visits and tests a ray; the same for all instructions.
fn counts(prepared: &Prepared, bvh: &Bvh8) {
    let mut tracer = BatchTracer::new(bvh, &prepared.database, &prepared.view, Simd::best());
    let (_, stats) = tracer.trace(Rect { x: 0, y: 0, width: SIDE, height: SIDE }, AovSet::default());
    let (counts, rays) = (tracer.counts(), stats.all_rays() as f64);
    println!(
        "    a ray:    {:.3} packets' branches, {:.3} single ones, {:.3} packets' leaves, {:.3} single ones, {:.3} tests of sixteen, {:.4} decided exactly",
        counts.packet_branches as f64 / rays,
        counts.single_branches as f64 / rays,
        counts.packet_leaves as f64 / rays,
        counts.single_leaves as f64 / rays,
        counts.tests as f64 / rays,
        counts.contended as f64 / rays
    );
}

/// Million rays a second of processor time, medians.
fn speeds(prepared: &Prepared, bvh: &Bvh8) {
    let mut kernels: Vec<(String, Kernel<'_>, Vec<Duration>)> =
        Simd::available().map(|simd| (simd.to_string(), Kernel::Packets(bvh, simd), Vec::new())).collect();
    kernels.push(("single rays".to_owned(), Kernel::Single { mailbox: true }, Vec::new()));
    let mut rays = 0;
    for _ in 0..TURNS {
        for (_, kernel, times) in &mut kernels {
            let settings = Settings { threads: 1, aov: AovSet::default(), kernel: *kernel };
            let rendering =
                render::render(&prepared.database, &prepared.view, settings, |_| std::ops::ControlFlow::Continue(()))
                    .expect("a small image");
            times.push(rendering.cpu);
            rays = rendering.stats.all_rays();
        }
    }
    for (name, _, times) in &mut kernels {
        times.sort_unstable();
        println!("    {name:12} {:7.2} million rays a second", rays as f64 / times[TURNS / 2].as_secs_f64() / 1e6);
    }
}
