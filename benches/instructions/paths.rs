//! The hot paths, each in a function of its own, which names do not change when the program's do.

use std::hint::black_box;

use cluster::processes::bus::state::State as Bus;
use cluster::protocol::control::BusConfiguration;
use cluster::protocol::memory::MemoryRequest;
use ground::ids::{Address, Attempt, ClusterId, Epoch, NodeId, TileId};
use machine::hardware::cluster_memory::ClusterMemory;
use machine::hardware::local_memory::{Geometry, LocalMemory};
use machine::hardware::references::{RecordNumbers, Recorder};
use machine::hardware::replacement::Lru;
use machine::hardware::specification::{Arbiter, LocalMemory as Specification, MemorySize, Replacement};
use machine::hardware::transaction::Initiator;
use machine::replay::model::replayer::{Replayer, Sum};
use machine::replay::model::stack_distance::LruStack;
use machine::replay::stream::captured::Captured;
use machine::replay::stream::lines::RecordLines;
use trace::database::Section;
use trace::database::verify::Verified;
use trace::picture::{AovSet, ImageSettings, Rect, Sides, Tiling};
use trace::preparation::{Prepared, ViewChoices, prepare};
use trace::scene::SceneSource;
use trace::tracer::bvh8::{BatchTracer, Bvh8};
use trace::tracer::octree::Octree;
use trace::tracer::octree::hero::Hero;
use trace::tracer::primary::PrimaryRays;
use trace::tracer::ray::Ray;
use trace::tracer::simd::Simd;
use trace::tracer::slices::Slices;
use trace::tracer::{MemoryPort, TileTracer, TraceStats};

/// Pixels a side.
const SIDE: u32 = 96;
const READS: u32 = 1 << 16;
const LINE_BYTES: u32 = 64;

pub(crate) struct Path {
    /// Of the function that callgrind collects in.
    pub(crate) name: &'static str,
    pub(crate) unit: &'static str,
    /// Prepares, calls the function once, and returns how many units it did.
    pub(crate) run: fn() -> u64,
    pub(crate) is_possible: fn() -> bool,
}

const fn path(name: &'static str, unit: &'static str, run: fn() -> u64) -> Path {
    Path { name, unit, run, is_possible: || true }
}

pub(crate) const PATHS: [Path; 12] = [
    path("nearest_hits", "ray", || nearest_hits(&teapot(), &primary_rays(&teapot()))),
    path("shadow_rays", "ray", || shadow_rays(&teapot(), &primary_rays(&teapot()))),
    path("leaf", "test", run_leaf),
    path("image", "ray", || image(&teapot())),
    Path { is_possible: || Simd::Avx2.is_available(), ..path("packets", "ray", || run_packets(&teapot(), packets)) },
    Path {
        is_possible: || Simd::Avx2.is_available(),
        ..path("sphere_packets", "ray", || run_packets(&prepared("balls:3", Octree::DEFAULT), sphere_packets))
    },
    path("local_memory_hits", "read", || with_local_memory(MemorySize::All, local_memory_hits)),
    path("local_memory_misses", "read", || with_local_memory(MemorySize::Bytes(4096), local_memory_misses)),
    path("recorded_reads", "read", run_recorded_reads),
    path("bus_fetches", "fetch", run_bus_fetches),
    path("replayed_references", "reference", run_replayed_references),
    path("stack_distances", "reference", run_stack_distances),
];

fn prepared(scene: &str, octree: Octree) -> Prepared {
    let source: SceneSource = scene.parse().expect("a scene");
    prepare(&source, octree, &ViewChoices::default(), |_| {
        Ok(ImageSettings::new(SIDE, SIDE, ImageSettings::DEPTH_DEFAULT, 0.0).expect("possible"))
    })
    .expect("the scene can be built")
}

fn teapot() -> Prepared {
    prepared("teapot:12", Octree::DEFAULT)
}

fn primary_rays(prepared: &Prepared) -> Vec<Ray> {
    let camera = PrimaryRays::new(&prepared.database.database().header, &prepared.view);
    let pixels = (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x, y)));
    pixels.filter_map(|(x, y)| Ray::from_eye(camera.eye, camera.direction(x, y)).map(|(ray, _)| ray)).collect()
}

#[inline(never)]
fn nearest_hits(scene: &Prepared, rays: &[Ray]) -> u64 {
    nearest(&scene.database, rays);
    rays.len() as u64
}

#[inline(always)]
fn nearest(database: &Verified, rays: &[Ray]) -> TraceStats {
    let mut hero = Hero::new(&database.database().header, true);
    let (mut port, mut stats) = (Slices::new(database), TraceStats::default());
    for ray in rays {
        let Ok(hit) = hero.nearest(&mut port, ray, &mut stats);
        black_box(hit);
    }
    stats
}

/// Whether anything is on the way as far as a ray goes.
#[inline(never)]
fn shadow_rays(scene: &Prepared, rays: &[Ray]) -> u64 {
    let mut hero = Hero::new(&scene.database.database().header, true);
    let (mut port, mut stats) = (Slices::new(&scene.database), TraceStats::default());
    for ray in rays {
        let Ok(occluded) = hero.occluded(&mut port, ray, &mut stats);
        black_box(occluded);
    }
    rays.len() as u64
}

/// The octree is one leaf: a ray's preparation and its tests of 16 triangles.
#[inline(never)]
fn leaf(scene: &Prepared, rays: &[Ray]) -> u64 {
    nearest(&scene.database, rays).primitive_tests
}

fn run_leaf() -> u64 {
    let scene = prepared("tetra:2", Octree { leaf_size: 16, max_depth: 0, ..Octree::DEFAULT });
    leaf(&scene, &primary_rays(&scene))
}

const WHOLE: Rect = Rect { x: 0, y: 0, width: SIDE, height: SIDE };

/// Everything that a ray costs: its generation, traversal, shading and share of the rays that it leads to.
#[inline(never)]
fn image(scene: &Prepared) -> u64 {
    let mut tracer = TileTracer::new(&scene.database.database().header, &scene.view, true);
    let Ok((pixels, stats)) = tracer.trace(&mut Slices::new(&scene.database), WHOLE, AovSet::default());
    black_box(pixels);
    stats.all_rays()
}

#[inline(never)]
fn packets(tracer: &mut BatchTracer<'_>) -> u64 {
    trace_packets(tracer)
}

#[inline(never)]
fn sphere_packets(tracer: &mut BatchTracer<'_>) -> u64 {
    black_box(trace_packets(tracer))
}

#[inline(always)]
fn trace_packets(tracer: &mut BatchTracer<'_>) -> u64 {
    let (pixels, stats) = tracer.trace(WHOLE, AovSet::default());
    black_box(pixels);
    stats.all_rays()
}

fn run_packets(scene: &Prepared, trace: fn(&mut BatchTracer<'_>) -> u64) -> u64 {
    let bvh = Bvh8::build(&scene.database);
    trace(&mut BatchTracer::new(&bvh, &scene.database, &scene.view, Simd::Avx2))
}

type Memory<'a> = LocalMemory<Lru, &'a ClusterMemory>;

fn cluster_memory(scene: &Prepared) -> ClusterMemory {
    let database = scene.database.database();
    let mut memory = ClusterMemory::new(&database.header.layout);
    memory.store(Address(0), database.bytes()).expect("the image fits its layout");
    memory
}

fn geometry(scene: &Prepared, size: MemorySize) -> Geometry {
    let memory = Specification { size, line: LINE_BYTES, ways: None, replacement: Replacement::Lru };
    Geometry::new(&memory, &scene.database.database().header.layout).expect("a possible memory")
}

fn with_local_memory(size: MemorySize, read: fn(&mut Memory<'_>, u32) -> u64) -> u64 {
    let scene = teapot();
    let cluster = cluster_memory(&scene);
    let mut memory = LocalMemory::new(geometry(&scene, size), &scene.database.database().header.layout, 1, &cluster);
    let words = 4096;
    for word in 0..words {
        memory.octree_node(word, 3).expect("in process");
    }
    read(&mut memory, words)
}

/// Scattered octree words, all of them in the memory.
#[inline(never)]
fn local_memory_hits(memory: &mut Memory<'_>, words: u32) -> u64 {
    octree_words(memory, (0..READS).map(|i| i.wrapping_mul(0x9E37_79B1) % words))
}

/// One word of each line in order, and again: every line was evicted when it is wanted again. Fetched in process.
#[inline(never)]
fn local_memory_misses(memory: &mut Memory<'_>, words: u32) -> u64 {
    octree_words(memory, (0..READS).map(|i| i * (LINE_BYTES / 4) % words))
}

#[inline(always)]
fn octree_words<P: MemoryPort>(port: &mut P, indices: impl Iterator<Item = u32>) -> u64 {
    for index in indices {
        let Ok(word) = port.octree_node(index, 3) else { unreachable!("in process, and in range") };
        black_box(word);
    }
    u64::from(READS)
}

/// What recording the references adds to reads that cost nothing else.
#[inline(never)]
fn recorded_reads(scene: &Prepared, words: &mut Vec<u32>) -> u64 {
    let numbers = RecordNumbers::new(&scene.database.database().header.layout);
    let mut slices = Slices::new(&scene.database);
    let mut port = Recorder::new(&mut slices, numbers, words, |part| {
        black_box(part);
    });
    octree_words(&mut port, (0..READS).map(|i| i.wrapping_mul(0x9E37_79B1) % 4096))
}

fn run_recorded_reads() -> u64 {
    recorded_reads(&teapot(), &mut Vec::with_capacity(1 << 18))
}

const FETCHES: u32 = 1 << 12;

/// From a node's request to the frame that answers it, sockets and log apart.
#[inline(never)]
fn bus_fetches(bus: &mut Bus, out: &mut Vec<u8>) -> u64 {
    for i in 0..FETCHES {
        let fetch = MemoryRequest::Fetch {
            tile: TileId(0),
            attempt: Attempt(0),
            section: Section::OctreeNodes,
            address: Address(u64::from(i % 64 * LINE_BYTES)),
            line_bytes: LINE_BYTES as u16,
            lines: 1,
            accesses_before: 0,
        };
        bus.request(Initiator::Node(NodeId(0)), fetch, &[], u64::from(i)).expect("a good fetch");
        let grant = bus.grant(u64::from(i)).expect("the only one");
        out.clear();
        black_box(bus.serve(grant, out, || u64::from(i)).expect("in range"));
    }
    u64::from(FETCHES)
}

fn run_bus_fetches() -> u64 {
    let scene = teapot();
    let database = scene.database.database();
    let configuration = BusConfiguration {
        cluster: ClusterId(0),
        arbiter: Arbiter::Fifo,
        layout: database.header.layout.clone(),
        recording: "unused".into(),
    };
    let mut bus = Bus::new(&configuration, Epoch(0));
    let mut out = Vec::with_capacity(1 << 16);
    bus.request(Initiator::Loader, MemoryRequest::Store { address: Address(0) }, database.bytes(), 0).expect("it fits");
    let grant = bus.grant(0).expect("the only one");
    bus.serve(grant, &mut out, || 0).expect("in order");
    bus_fetches(&mut bus, &mut out)
}

fn captured(scene: &Prepared) -> Captured {
    let sides = Sides { width: SIDE, height: SIDE, tile_width: 8, tile_height: 8 };
    Captured::capture(&scene.database, &scene.view, Tiling::new(sides).expect("possible"), true, 1)
}

#[inline(never)]
fn replayed_references(trace: &Captured, lines: &RecordLines, geometry: Geometry) -> u64 {
    let (mut memory, mut sum) =
        (Replayer::<Lru, _>::new(lines, geometry, 1).expect("a possible memory"), Sum::new(trace));
    for tile in 0..trace.tiles.len() as u32 {
        memory.tile(trace, tile, &mut sum).expect("sound");
    }
    sum.finish().record_accesses
}

fn run_replayed_references() -> u64 {
    let scene = teapot();
    let lines = RecordLines::new(&scene.database.database().header.layout, LINE_BYTES);
    let size = MemorySize::Share { numerator: 1, denominator: 8 };
    replayed_references(&captured(&scene), &lines, geometry(&scene, size))
}

/// Mattson's distances of lines that are drawn with a fixed generator, near ones more often.
#[inline(never)]
fn stack_distances(stack: &mut LruStack, lines: &[u32], distances: &mut [u32]) -> u64 {
    stack.references(lines, distances);
    black_box(distances);
    lines.len() as u64
}

fn run_stack_distances() -> u64 {
    const LINES: u32 = 1 << 14;
    let mut state = 1u32;
    let mut next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        state >> 8
    };
    let lines: Vec<u32> = (0..READS).map(|_| (next() % LINES).min(next() % LINES).min(next() % LINES)).collect();
    stack_distances(&mut LruStack::new(LINES), &lines, &mut vec![0; lines.len()])
}
