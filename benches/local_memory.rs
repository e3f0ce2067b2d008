//! What a read through the local memory costs: a hit beside a plain slice, and misses served in process.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use ground::ids::Address;
use machine::hardware::cluster_memory::ClusterMemory;
use machine::hardware::local_memory::{Geometry, LocalMemory};
use machine::hardware::replacement::{Clock, Fifo, Lru, Random, Replacement};
use machine::hardware::specification;
use machine::hardware::specification::MemorySize;
use trace::database::{Layout, Section};
use trace::tracer::MemoryPort;

/// 128 KiB of octree nodes, 160 KB of triangles.
const RECORDS: [u64; Section::COUNT] = [32_768, 0, 4_096, 0, 0, 0, 0, 0, 0];
/// Reads an iteration.
const READS: u32 = 4_096;

fn layout() -> Layout {
    Layout::new(RECORDS).expect("small")
}

fn cluster_memory() -> ClusterMemory {
    let layout = layout();
    let mut memory = ClusterMemory::new(&layout);
    memory.store(Address(0), &vec![1; layout.database_bytes() as usize]).expect("in order");
    memory
}

fn local_memory<R: Replacement>(size: MemorySize, memory: &ClusterMemory) -> LocalMemory<R, &ClusterMemory> {
    let layout = layout();
    let local = specification::LocalMemory { size, line: 64, ways: None, replacement: specification::Replacement::Lru };
    LocalMemory::new(Geometry::new(&local, &layout).expect("within ranges"), &layout, 1, memory)
}

/// Indices that jump about as a traversal does, the same in every run.
fn scattered(records: u32) -> Vec<u32> {
    (0..READS).map(|i| i.wrapping_mul(0x9E37_79B1) >> 8).map(|i| i % records).collect()
}

fn octree_nodes<P: MemoryPort>(port: &mut P, indices: &[u32]) -> u32 {
    indices.iter().fold(0, |sum, &i| match port.octree_node(i, 3) {
        Ok(word) => sum ^ word.0,
        Err(_) => unreachable!("the index is in range, and the source cannot fail"),
    })
}

fn triangles<P: MemoryPort>(port: &mut P, indices: &[u32]) -> f32 {
    indices.iter().fold(0.0, |sum, &i| match port.triangle(i) {
        Ok(triangle) => sum + triangle.coordinates[1][2],
        Err(_) => unreachable!("the index is in range, and the source cannot fail"),
    })
}

fn hits_of<R: Replacement>(c: &mut Criterion, name: &str) {
    let cluster_memory = cluster_memory();
    let mut memory = local_memory::<R>(MemorySize::All, &cluster_memory);
    let (nodes, few) = (scattered(32_768), scattered(4_096));
    let same = vec![77; READS as usize];
    octree_nodes(&mut memory, &nodes);
    triangles(&mut memory, &few);
    let mut group = c.benchmark_group("hit");
    group.throughput(Throughput::Elements(u64::from(READS)));
    group.bench_function(BenchmarkId::new("octree node", name), |b| {
        b.iter(|| octree_nodes(&mut memory, black_box(&nodes)));
    });
    group.bench_function(BenchmarkId::new("octree node, same line", name), |b| {
        b.iter(|| octree_nodes(&mut memory, black_box(&same)));
    });
    group.bench_function(BenchmarkId::new("triangle", name), |b| b.iter(|| triangles(&mut memory, black_box(&few))));
    group.finish();
}

fn hits(c: &mut Criterion) {
    hits_of::<Lru>(c, "lru");
    hits_of::<Fifo>(c, "fifo");
    hits_of::<Clock>(c, "clock");
    let words = vec![1u32; 32_768];
    let nodes = scattered(32_768);
    let mut group = c.benchmark_group("hit");
    group.throughput(Throughput::Elements(u64::from(READS)));
    group.bench_function("octree node/slice", |b| {
        b.iter(|| black_box(&nodes).iter().fold(0, |sum, &i| sum ^ words[i as usize]));
    });
    group.finish();
}

fn misses_of<R: Replacement>(c: &mut Criterion, name: &str) {
    let cluster_memory = cluster_memory();
    // 64 lines, read through in order: every line is gone when it is wanted again.
    let mut memory = local_memory::<R>(MemorySize::Bytes(4096), &cluster_memory);
    let streaming: Vec<u32> = (0..READS).map(|i| i * 16 % 32_768).collect();
    let mut group = c.benchmark_group("miss");
    group.throughput(Throughput::Elements(u64::from(READS)));
    group.bench_function(BenchmarkId::new("streaming", name), |b| {
        b.iter(|| octree_nodes(&mut memory, black_box(&streaming)));
    });
    group.finish();
}

fn misses(c: &mut Criterion) {
    misses_of::<Lru>(c, "lru");
    misses_of::<Fifo>(c, "fifo");
    misses_of::<Clock>(c, "clock");
    misses_of::<Random>(c, "random");
}

criterion_group!(benches, hits, misses);
criterion_main!(benches);
