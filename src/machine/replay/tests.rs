//! What a replay counts is what a node's local memory counts.

use crate::hardware::cluster_memory::{AccessError, ClusterMemory};
use crate::hardware::local_memory::{Geometry, LineSource, LocalMemory};
use crate::hardware::references::{Event, RecordNumbers, ReferenceWord};
use crate::hardware::replacement::{Clock, Clock0, Fifo, Lru, Random, Replacement, S3Fifo, Sieve, Srrip};
use crate::hardware::specification::{self, MemorySize};
use crate::hardware::stats::MemoryStats;
use crate::hardware::transaction::FetchRequest;
use crate::recording::references::octree_levels;
use crate::replay::model::detail::{Classes, Detail};
use crate::replay::model::replayer::{Counters, Replayer, Sum, Tally};
use crate::replay::plan::schedule::TileSchedule;
use crate::replay::stream::captured::tests::{scene, teapot};
use crate::replay::{Captured, RecordLines, Trace, TraceError, TracedTile};
use ground::ids::{Address, Attempt, Epoch, NodeId, TileId};
use trace::database::verify::Verified;
use trace::database::{Layout, Numbers, Objects, RecordLayout, Section};
use trace::tracer::MemoryPort;

const SEED: u64 = 7;

struct Shared<'a>(&'a ClusterMemory);

impl LineSource for Shared<'_> {
    type Error = AccessError;

    fn fetch(&mut self, request: &FetchRequest, into: &mut [u8]) -> Result<(), AccessError> {
        self.0.fetch(request, into)
    }
}

fn memory(size: MemorySize, line: u32, ways: Option<u32>) -> specification::LocalMemory {
    specification::LocalMemory { size, line, ways, replacement: specification::Replacement::Lru }
}

/// Reads what the words tell through a local memory with data in it.
fn read_all<P: MemoryPort<Error: std::fmt::Debug>>(
    port: &mut P,
    numbers: &RecordNumbers,
    levels: &[u8],
    words: &[u32],
) {
    for &word in words {
        let record = match ReferenceWord(word).decode().expect("of this version") {
            Event::Ray(kind) => {
                port.set_ray_kind(kind);
                continue;
            }
            Event::Read(record) => record,
            other => panic!("{other:?} of a tracer"),
        };
        let (section, i) = numbers.place(record);
        let read = match section {
            Section::OctreeNodes => port.octree_node(i, u32::from(levels[i as usize / 8])).map(drop),
            Section::LeafLists => port.leaf_entry(i).map(drop),
            Section::Triangles => port.triangle(i).map(drop),
            Section::Spheres => port.sphere(i).map(drop),
            Section::Cones => port.cone(i).map(drop),
            Section::Surfaces => port.surface(i).map(drop),
            Section::Normals => port.normals(i).map(drop),
            Section::Materials => port.material(i).map(drop),
            Section::Polygons => port.polygon(i).map(drop),
        };
        read.expect("the words are of this database");
    }
}

/// Live and replayed counts of one node that traced all of it.
fn both<R: Replacement>(database: &Verified, trace: &Captured, geometry: Geometry) -> (MemoryStats, MemoryStats) {
    let database_image = database.database();
    let layout = &database_image.header.layout;
    let mut shared = ClusterMemory::new(layout);
    shared.store(Address(0), database_image.bytes()).expect("in order");
    let (numbers, levels) = (RecordNumbers::new(layout), octree_levels(database));

    let mut live = LocalMemory::<R, _>::new(geometry, layout, SEED, Shared(&shared));
    trace.parts.iter().for_each(|words| read_all(&mut live, &numbers, &levels, words));

    let lines = RecordLines::new(layout, geometry.line_bytes);
    let mut replayer = Replayer::<R, _>::new(&lines, geometry, SEED).expect("few slots");
    let mut detail = Detail::new(trace, Classes::new(layout, &levels));
    for tile in 0..trace.tiles.len() as u32 {
        replayer.tile(trace, tile, &mut detail).expect("in memory");
    }
    (live.take_stats(), detail.stats)
}

#[test]
fn a_replay_counts_what_a_local_memory_counts() {
    let (database, trace) = teapot(24, 1);
    assert_counts(&database, &trace);
}

#[test]
fn a_replay_counts_what_a_local_memory_counts_of_polygons_and_padding() {
    for (objects, numbers, bytes) in [
        (Objects::Polygons, Numbers::F64, Some(300)),
        (Objects::Polygons, Numbers::F32, None),
        (Objects::Triangles, Numbers::F32, Some(496)),
    ] {
        let records = RecordLayout::new(objects, numbers, bytes).expect("possible");
        let (database, trace) = scene("gears:1", records, 16, 1);
        assert_counts(&database, &trace);
        let numbers = RecordNumbers::new(&database.database().header.layout);
        let polygons = numbers.section(Section::Polygons);
        let reads = trace.parts.iter().flatten().filter(|word| polygons.contains(word)).count();
        assert_eq!(reads > 1000, objects == Objects::Polygons, "{reads} reads of polygons");
    }
}

fn assert_counts(database: &Verified, trace: &Captured) {
    let share = |denominator| MemorySize::Share { numerator: 1, denominator };
    let mut counted = Vec::new();
    for (size, line, ways) in [
        (share(8), 64, None),
        (share(32), 16, None),
        (share(16), 32, Some(4)),
        (MemorySize::Bytes(4096), 256, None),
        (MemorySize::Bytes(2048), 16, Some(1)),
        (MemorySize::All, 128, Some(2)),
    ] {
        let layout = &database.database().header.layout;
        let geometry = Geometry::new(&memory(size, line, ways), layout).expect("within ranges");
        for (live, replayed) in [
            both::<Lru>(database, trace, geometry),
            both::<Fifo>(database, trace, geometry),
            both::<Clock>(database, trace, geometry),
            both::<Random>(database, trace, geometry),
            both::<Clock0>(database, trace, geometry),
            both::<Srrip>(database, trace, geometry),
            both::<Sieve>(database, trace, geometry),
            // Counts hits that are repeated at once, so that the replay must not leave these out.
            both::<S3Fifo>(database, trace, geometry),
        ] {
            assert_eq!(live, replayed, "{geometry:?}");
            counted.push(live.total().line_misses);
        }
    }
    let differing: std::collections::BTreeSet<_> = counted.iter().collect();
    assert!(differing.len() > 15, "the settings are not all the same: {counted:?}");
}

/// A trace without words, of tiles by node, epoch and whether they were accepted.
struct Tiles(Vec<TracedTile>);

impl Tiles {
    fn new(tiles: &[(u16, u32, bool)]) -> Self {
        let tile = |(i, &(node, epoch, accepted)): (u32, &(u16, u32, bool))| TracedTile {
            node: NodeId(node),
            epoch: Epoch(epoch),
            tile: TileId(i),
            attempt: Attempt(0),
            accepted,
            parts: 0..0,
        };
        Self((0..).zip(tiles).map(tile).collect())
    }
}

impl Trace for Tiles {
    fn tiles(&self) -> &[TracedTile] {
        &self.0
    }

    fn read(&self, _part: u32, _words: &mut Vec<u32>) -> Result<(), TraceError> {
        Ok(())
    }
}

#[test]
fn the_recorded_schedule_begins_anew_with_each_process() {
    // Node 1 died twice, the second time before it had traced anything; node 2 traced nothing at all.
    let trace = Tiles::new(&[(0, 0, true), (0, 0, true), (1, 0, true), (1, 0, false), (1, 2, true), (3, 1, true)]);
    let schedule = TileSchedule::recorded(&trace, 5);
    let expected = [vec![vec![0, 1]], vec![vec![2, 3], vec![4]], vec![], vec![vec![5]], vec![]];
    assert_eq!(schedule.nodes, expected);
    assert_eq!(schedule.nodes().map(|(node, _)| node.0).collect::<Vec<_>>(), [0, 1, 2, 3, 4]);
}

#[test]
fn an_interleaved_schedule_deals_tiles_in_turn_and_leaves_out_what_is_missing() {
    let tiles = [Some(4), Some(0), None, Some(1), Some(3)];
    assert_eq!(TileSchedule::interleaved(&tiles, 2).nodes, [vec![vec![4, 3]], vec![vec![0, 1]]]);
    assert_eq!(TileSchedule::interleaved(&tiles, 3).nodes, [vec![vec![4, 1]], vec![vec![0, 3]], vec![vec![]]]);
}

#[test]
fn sums_leave_out_tiles_that_were_not_accepted() {
    let trace = Tiles::new(&[(0, 0, true), (0, 0, false), (0, 0, true), (0, 0, false)]);
    let mut sum = Sum::new(&trace);
    for tile in 0..4 {
        sum.tile(tile);
        // One, two, three, four records in two lines each; one line of each record is missing in odd tiles.
        (0..=tile).for_each(|record| sum.read(record, 2, tile % 2));
        sum.read(9, 3, 2);
    }
    let expected = Counters { record_accesses: 2 + 4, record_misses: 2, line_accesses: 2 + 6 + 6, line_misses: 4 };
    assert_eq!(sum.finish(), expected);
}

#[test]
fn a_word_that_is_not_known_is_an_error() {
    let layout = Layout::new([80, 0, 0, 0, 0, 0, 0, 0, 0]).expect("small");
    let geometry = Geometry::new(&memory(MemorySize::All, 16, None), &layout).expect("within ranges");
    let lines = RecordLines::new(&layout, 16);
    let trace = Tiles::new(&[(0, 0, true)]);
    let error = Replayer::<Lru, _>::new(&lines, geometry, SEED)
        .expect("few slots")
        .words(&[3, 0xc300_0000], &mut Sum::new(&trace));
    assert_eq!(error, Err(TraceError("0xc3000000 is no word that this version knows".to_owned())));
}
