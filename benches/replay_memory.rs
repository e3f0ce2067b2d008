//! That replaying takes no more memory the longer a recording is: `cargo bench --bench replay_memory -- 1000000000` makes a
//! recording of so many references (default 10⁸, 4.2 bytes each in the temporary folder), replays it, and prints the most
//! memory that the process has had.

use std::fs;
use std::path::Path;
use std::time::Instant;

use cluster::topology::Topology;
use cluster::topology::recorded::open_references;
use ground::ids::{Attempt, Epoch, NodeId, TileId};
use machine::recording::references::{Opened, Seal, Writer, octree_levels};
use machine::replay::model::curve::curve;
use machine::replay::model::evaluation::{Evaluation, evaluate};
use machine::replay::plan::grid::Grid;
use machine::replay::plan::setting::{Policy, Setting};
use machine::replay::stream::subject::Subject;
use machine::replay::{Captured, Trace};
use trace::picture::{Sides, Tiling};

const TILE: u32 = 8;

fn main() {
    // cargo itself passes `--bench`.
    let wanted = std::env::args().skip(1).find_map(|argument| argument.parse().ok()).unwrap_or(100_000_000u64);
    let folder = tempfile::tempdir().expect("a temporary folder");
    let start = Instant::now();
    record(folder.path(), wanted);
    told("recorded", start);
    let start = Instant::now();
    let Opened { recording, faults } = open_references(folder.path()).expect("a recording");
    assert!(faults.is_empty(), "{faults:?}");
    println!(
        "{} references, {:.2} bytes each",
        recording.references,
        bytes(folder.path()) / recording.references as f64
    );
    told("opened and checked", start);
    for policy in [Policy::Lru, Policy::Optimal] {
        let start = Instant::now();
        let grid = Grid { replacement: vec![policy], ..Grid::default() };
        let settings = grid
            .settings(Setting::recorded(&recording.conditions.cluster, recording.conditions.tile_order))
            .expect("one");
        let rows = evaluate(&recording, &settings, &Evaluation::default(), |_| {}).expect("sound");
        assert_eq!(rows[0].counts.record_accesses, recording.references);
        told(&format!("{policy:?}: {} misses", rows[0].counts.misses), start);
    }
    let start = Instant::now();
    let tiles: Vec<u32> = (0..recording.tiles().len() as u32).collect();
    let points = curve(&recording, &tiles, &recording.lines(64)).expect("sound").points().len();
    told(&format!("curve of {points} points"), start);
}

/// The teapot's references again and again, as if of an image that is so much higher.
fn record(folder: &Path, wanted: u64) {
    let topology = Topology::read(
        Path::new("topologies/one-node.toml"),
        &["cluster.local_memory.size=1/8".parse().expect("a key")],
    )
    .expect("a topology of this project");
    let prepared = topology.prepare().expect("a scene");
    let header = &prepared.database.database().header;
    let side = prepared.view.image.width().min(256);
    let tiling =
        Tiling::new(Sides { width: side, height: side, tile_width: TILE, tile_height: TILE }).expect("possible");
    let captured = Captured::capture(&prepared.database, &prepared.view, tiling, true, 1);
    let reads = |words: &Vec<u32>| words.iter().filter(|&&word| word < 1 << 30).count() as u64;
    let once: u64 = captured.parts.iter().map(reads).sum();
    let times = wanted.div_ceil(once) as u32;
    let mut writer = Writer::create(folder, NodeId(0), Epoch(0), &header.layout).expect("a writable folder");
    let triangles =
        machine::hardware::references::RecordNumbers::new(&header.layout).section(trace::database::Section::Triangles);
    for tile in 0..times * tiling.tile_count() {
        let traced = &captured.tiles[(tile % tiling.tile_count()) as usize];
        writer.begin(TileId(tile), Attempt(0));
        let parts = &captured.parts[traced.parts.start as usize..traced.parts.end as usize];
        let tests = parts.iter().flatten().filter(|word| triangles.contains(word)).count() as u64;
        let (last, before) = parts.split_last().expect("a part");
        before.iter().for_each(|part| writer.part(part));
        writer.end(last, tests).expect("written");
    }
    let seal = Seal {
        topology: topology.to_toml().expect("its own"),
        layout: header.layout.clone(),
        tiling: Tiling::new(Sides { height: side * times, ..tiling.sides() }).expect("possible"),
        octree_levels: octree_levels(&prepared.database),
        scene_sha256: String::new(),
        local_bytes: header.layout.database_bytes() / 8,
    };
    seal.put(folder, 0, |_| true).expect("written");
}

fn bytes(folder: &Path) -> f64 {
    let files = fs::read_dir(folder).expect("a folder").flatten();
    files.map(|file| file.metadata().map_or(0, |metadata| metadata.len())).sum::<u64>() as f64
}

fn told(what: &str, start: Instant) {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap_or("unknown").trim().to_owned();
    println!("{what}: {:.1} s; at most {peak} so far", start.elapsed().as_secs_f64());
}
