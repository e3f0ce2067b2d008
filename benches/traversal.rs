//! A tile of the teapot, traced over plain slices and through local memories that are counted but served in
//! process: what simulating costs. `cargo bench --bench traversal`

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use machine::hardware::cluster_memory::ClusterMemory;
use machine::hardware::local_memory::{Geometry, LocalMemory};
use machine::hardware::replacement::Lru;
use machine::hardware::specification::{LocalMemory as Configuration, MemorySize, Replacement};
use trace::database::verify::Verified;
use trace::picture::{AovSet, ImageSettings, Rect};
use trace::preparation::{Prepared, ViewChoices, prepare};
use trace::scene::SceneSource;
use trace::tracer::octree::Octree;
use trace::tracer::slices::Slices;
use trace::tracer::{MemoryPort, TileTracer};

const TILE: Rect = Rect { x: 192, y: 192, width: 128, height: 128 };

fn teapot() -> Prepared {
    let source: SceneSource = "teapot:12".parse().expect("a scene");
    prepare(&source, Octree::DEFAULT, &ViewChoices::default(), |_| {
        Ok(ImageSettings::new(512, 512, ImageSettings::DEPTH_DEFAULT, 0.0).expect("possible"))
    })
    .expect("the teapot can be built")
}

fn cluster_memory(database: &Verified) -> ClusterMemory {
    let database = database.database();
    let mut memory = ClusterMemory::new(&database.header.layout);
    memory.store(ground::ids::Address(0), database.bytes()).expect("the image fits its layout");
    memory
}

fn trace<M: MemoryPort>(tracer: &mut TileTracer, port: &mut M) -> u64
where
    M::Error: std::fmt::Debug,
{
    tracer.trace(port, TILE, AovSet::default()).expect("the tile can be traced").1.all_rays()
}

fn traversal(criterion: &mut Criterion) {
    let Prepared { database, view, .. } = teapot();
    let header = &database.database().header;
    let memory = cluster_memory(&database);
    let mut tracer = TileTracer::new(header, &view, true);
    let rays = trace(&mut tracer, &mut Slices::new(&database));
    let mut group = criterion.benchmark_group("teapot tile");
    group.throughput(Throughput::Elements(rays)).sample_size(20);
    group.bench_function("plain slices", |bencher| {
        bencher.iter(|| trace(&mut tracer, &mut Slices::new(&database)));
    });
    let mut without = TileTracer::new(header, &view, false);
    group.bench_function("plain slices, no mailbox", |bencher| {
        bencher.iter(|| trace(&mut without, &mut Slices::new(&database)));
    });
    for (name, denominator) in [("1/8", 8), ("1/32", 32)] {
        let configuration = Configuration {
            size: MemorySize::Share { numerator: 1, denominator },
            line: 64,
            ways: None,
            replacement: Replacement::Lru,
        };
        let geometry = Geometry::new(&configuration, &header.layout).expect("a possible memory");
        let mut local: LocalMemory<Lru, _> = LocalMemory::new(geometry, &header.layout, 1, &memory);
        group.bench_function(format!("local memory {name}, served in process"), |bencher| {
            bencher.iter(|| trace(&mut tracer, &mut local));
        });
    }
    group.finish();
}

criterion_group!(benches, traversal);
criterion_main!(benches);
