//! The hot paths, each in a function of its own that callgrind counts; prints by what to divide.
//!
//! ```text
//! cargo bench --bench instructions --no-run        # tells the executable's name
//! valgrind --tool=callgrind --callgrind-out-file=counts EXECUTABLE
//! callgrind_annotate --inclusive=yes counts | grep -E 'instructions::|Hero::|Shader::shade '
//! ```

use std::hint::black_box;

use marti::database::verify::Verified;
use marti::ids::Address;
use marti::machine::cluster_memory::ClusterMemory;
use marti::machine::local_memory::{Geometry, LocalMemory};
use marti::machine::replacement::Lru;
use marti::machine::specification::{LocalMemory as Configuration, MemorySize, Replacement};
use marti::picture::{AovSet, ImageSettings, Rect};
use marti::preparation::{Fallback, Prepared, prepare};
use marti::scene::SceneSource;
use marti::tracer::octree::Octree;
use marti::tracer::octree::hero::Hero;
use marti::tracer::primary::PrimaryRays;
use marti::tracer::ray::Ray;
use marti::tracer::slices::Slices;
use marti::tracer::{MemoryPort, TileTracer, TraceStats};

/// Pixels a side.
const SIDE: u32 = 96;
const READS: u32 = 1 << 16;

fn prepared(scene: &str, octree: Octree) -> Prepared {
    let source: SceneSource = scene.parse().expect("a scene");
    prepare(&source, octree, &Fallback::default(), |_| {
        Ok(ImageSettings { width: SIDE, height: SIDE, depth: ImageSettings::DEPTH_DEFAULT, cutoff: 0.0 })
    })
    .expect("the scene can be built")
}

fn primary_rays(prepared: &Prepared) -> Vec<Ray> {
    let camera = PrimaryRays::new(&prepared.database.database().header, &prepared.view);
    let pixels = (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x, y)));
    pixels.filter_map(|(x, y)| Ray::from_eye(camera.eye, camera.direction(x, y)).map(|(ray, _)| ray)).collect()
}

#[inline(never)]
fn single_rays(database: &Verified, rays: &[Ray]) {
    nearest(database, rays);
}

/// The octree is one leaf: what is counted is a ray's preparation and its tests.
#[inline(never)]
fn leaf(database: &Verified, rays: &[Ray]) {
    nearest(database, rays);
}

#[inline(always)]
fn nearest(database: &Verified, rays: &[Ray]) {
    let mut hero = Hero::new(&database.database().header, true);
    let (mut port, mut stats) = (Slices::new(database), TraceStats::default());
    for ray in rays {
        let Ok(hit) = hero.nearest(&mut port, ray, &mut stats);
        black_box(hit);
    }
}

#[inline(never)]
fn local_memory_hits<P: MemoryPort>(port: &mut P, words: u32) {
    for i in 0..READS {
        let Ok(word) = port.octree_node(i.wrapping_mul(0x9E37_79B1) % words, 3) else { return };
        black_box(word);
    }
}

/// A whole image: its traversal is to be taken off.
#[inline(never)]
fn image(prepared: &Prepared) -> u64 {
    let mut tracer = TileTracer::new(&prepared.database.database().header, &prepared.view, true);
    let rect = Rect { x: 0, y: 0, width: SIDE, height: SIDE };
    let Ok((pixels, stats)) = tracer.trace(&mut Slices::new(&prepared.database), rect, AovSet::default());
    black_box(pixels);
    stats.all_rays()
}

fn main() {
    let teapot = prepared("teapot:12", Octree::DEFAULT);
    let rays = primary_rays(&teapot);
    single_rays(&teapot.database, &rays);
    println!("single_rays: {} rays", rays.len());

    let one_leaf = prepared("tetra:2", Octree { leaf_size: 16, max_depth: 0, ..Octree::DEFAULT });
    let rays = primary_rays(&one_leaf);
    leaf(&one_leaf.database, &rays);
    println!("leaf: {} rays, 16 triangles each", rays.len());

    let database = teapot.database.database();
    let mut memory = ClusterMemory::new(&database.header.layout);
    memory.store(Address(0), database.bytes()).expect("the image fits its layout");
    let configuration = Configuration { size: MemorySize::All, line: 64, ways: None, replacement: Replacement::Lru };
    let geometry = Geometry::new(&configuration, &database.header.layout).expect("a possible memory");
    let mut local: LocalMemory<Lru, _> = LocalMemory::new(geometry, &database.header.layout, 1, &memory);
    let words = 4096;
    for word in 0..words {
        local.octree_node(word, 3).expect("in process");
    }
    local_memory_hits(&mut local, words);
    println!("local_memory_hits: {READS} reads");

    println!("image: {} rays", image(&teapot));
}
