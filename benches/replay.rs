//! What replaying costs, on the reference stream of the teapot at 250x250 in tiles of 5x5: `cargo bench --bench replay`,
//! `-- 9` for nine turns instead of five.
//!
//! Million record references a second of processor time on one thread, medians of turns. Where `python3` has libCacheSim
//! (`pip install libcachesim==0.3.5`), the same run measures what it takes for the same line references.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use ground::processor_time;
use machine::hardware::local_memory::Geometry;
use machine::hardware::replacement::{
    Clock, Clock0, Fifo, Lru, Plru, Random, Replacement as Policy, S3Fifo, Sieve, Srrip,
};
use machine::hardware::specification::{LocalMemory, MemorySize, Replacement};
use machine::replay::model::curve::curve;
use machine::replay::model::optimal::optimal;
use machine::replay::model::replayer::{Counters, Replayer, Sum};
use machine::replay::stream::reads;
use machine::replay::{Captured, Lines, RecordLines, Trace};
use trace::picture::{ImageSettings, Sides, Tiling};
use trace::preparation::{ViewChoices, prepare};
use trace::scene::SceneSource;
use trace::tracer::octree::Octree;

const SIDE: u32 = 250;
const TILE: u32 = 5;
const LINE_BYTES: u32 = 64;

fn main() {
    // cargo itself passes `--bench`.
    let turns = std::env::args().skip(1).find_map(|argument| argument.parse().ok()).unwrap_or(5).max(1);
    let (trace, lines, geometry) = teapot();
    let tiles: Vec<u32> = (0..trace.tiles().len() as u32).collect();
    let size = geometry.lines() as u32;

    let mut counted = Counters::default();
    let mut points = 0;
    let optima = [size / 2, size, size * 2, size * 4].map(|ways| Geometry { ways: ways.into(), ..geometry });
    let mut optimum = 0;
    let mut measured = [
        Measured::new("decoding alone"),
        Measured::new("one LRU setting"),
        Measured::new("the curve of all sizes"),
        Measured::new("Belady's optimum, one size"),
        Measured::new("Belady's optimum, four sizes"),
    ];
    let tree = Geometry { ways: 1 << size.ilog2(), ..geometry };
    let policies: [(_, Count, _); 8] = [
        ("one FIFO setting", count::<Fifo>, geometry),
        ("one clock setting", count::<Clock>, geometry),
        ("one clock:0 setting", count::<Clock0>, geometry),
        ("one random setting", count::<Random>, geometry),
        ("one SRRIP setting", count::<Srrip>, geometry),
        ("one SIEVE setting", count::<Sieve>, geometry),
        ("one S3-FIFO setting", count::<S3Fifo>, geometry),
        ("one tree pseudo-LRU setting", count::<Plru>, tree),
    ];
    let mut by_policy = policies.map(|(name, ..)| Measured::new(name));
    for _ in 0..turns {
        for ((_, count, geometry), measured) in policies.iter().zip(&mut by_policy) {
            let counters = measured.turn(|| count(&trace, &tiles, &lines, *geometry));
            assert!(counters.line_misses > 0);
        }
        let [decoding, counting, all_sizes, one_optimum, four_optima] = &mut measured;
        let sum = decoding.turn(|| decode(&trace, &lines));
        assert!(sum > 0);
        counted = counting.turn(|| count::<Lru>(&trace, &tiles, &lines, geometry));
        let curve = all_sizes.turn(|| curve(&trace, &tiles, &lines).expect("sound"));
        assert_eq!(curve.at(size), counted, "the curve and one setting");
        points = curve.points().len();
        let one = one_optimum.turn(|| optimal(&trace, &tiles, &lines, &[geometry]).expect("sound"));
        let four = four_optima.turn(|| optimal(&trace, &tiles, &lines, &optima).expect("sound"));
        assert_eq!(one[0], four[1]);
        optimum = one[0].line_misses;
    }
    println!(
        "teapot, {SIDE}x{SIDE}: {} record references, {} line references; {size} lines of {LINE_BYTES} bytes, 1/8 of {}",
        counted.record_accesses,
        counted.line_accesses,
        lines.count()
    );
    println!("{} lines missed, at best {optimum}; the curve has {points} points", counted.line_misses);
    for measured in measured.iter().chain(&by_policy) {
        let seconds = measured.median().as_secs_f64();
        let rate = counted.record_accesses as f64 / seconds / 1e6;
        println!("    {:<30}{rate:8.1} M record references/s {seconds:10.4} s", measured.name);
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("lines.oracleGeneral");
    write_lines(&trace, &lines, &file);
    libcachesim(&file, size, turns, &counted, &measured);
}

fn teapot() -> (Captured, RecordLines, Geometry) {
    let source: SceneSource = "teapot:12".parse().expect("a scene");
    let image = ImageSettings::new(SIDE, SIDE, ImageSettings::DEPTH_DEFAULT, 0.0).expect("possible");
    let prepared = prepare(&source, Octree::DEFAULT, &ViewChoices::default(), |_| Ok(image)).expect("the teapot");
    let tiling =
        Tiling::new(Sides { width: SIDE, height: SIDE, tile_width: TILE, tile_height: TILE }).expect("possible");
    let trace = Captured::capture(&prepared.database, &prepared.view, tiling, true, 1);
    let layout = &prepared.database.database().header.layout;
    let memory = LocalMemory {
        size: MemorySize::Share { numerator: 1, denominator: 8 },
        line: LINE_BYTES,
        ways: None,
        replacement: Replacement::Lru,
    };
    (trace, RecordLines::new(layout, LINE_BYTES), Geometry::new(&memory, layout).expect("an eighth"))
}

fn decode(trace: &Captured, lines: &RecordLines) -> u64 {
    let (mut words, mut sum) = (Vec::new(), 0);
    for part in 0..trace.parts.len() as u32 {
        trace.read(part, &mut words).expect("kept");
        reads::for_each(&words, lines, |first, count| sum += u64::from(first ^ count)).expect("sound");
    }
    sum
}

type Count = fn(&Captured, &[u32], &RecordLines, Geometry) -> Counters;

fn count<R: Policy>(trace: &Captured, tiles: &[u32], lines: &RecordLines, geometry: Geometry) -> Counters {
    let (mut memory, mut sum) =
        (Replayer::<R, _>::new(lines, geometry, 1).expect("a possible memory"), Sum::new(trace));
    for &tile in tiles {
        memory.tile(trace, tile, &mut sum).expect("sound");
    }
    sum.finish()
}

struct Measured {
    name: &'static str,
    times: Vec<Duration>,
}

impl Measured {
    fn new(name: &'static str) -> Self {
        Self { name, times: Vec::new() }
    }

    fn turn<T>(&mut self, work: impl FnOnce() -> T) -> T {
        let start = processor_time::of_this_thread();
        let result = work();
        self.times.push(processor_time::of_this_thread().saturating_sub(start));
        result
    }

    fn median(&self) -> Duration {
        let mut times = self.times.clone();
        times.sort();
        times[times.len() / 2]
    }
}

/// libCacheSim's oracleGeneral: little-endian u32 time, u64 id, u32 size, i64 next access. LRU does not ask for the
/// latter, nor for time; a line counts as one.
fn write_lines(trace: &Captured, lines: &RecordLines, path: &Path) {
    let mut file = BufWriter::new(File::create(path).expect("a file in a temporary folder"));
    let (mut words, mut bytes) = (Vec::new(), Vec::new());
    for part in 0..trace.parts.len() as u32 {
        trace.read(part, &mut words).expect("kept");
        bytes.clear();
        reads::for_each(&words, lines, |first, count| {
            for line in first..first + count {
                bytes.extend(0u32.to_le_bytes());
                bytes.extend(u64::from(line).to_le_bytes());
                bytes.extend(1u32.to_le_bytes());
                bytes.extend((-1i64).to_le_bytes());
            }
        })
        .expect("sound");
        file.write_all(&bytes).expect("room for the trace");
    }
    file.flush().expect("room for the trace");
}

/// By hash table size, as a power of two; the first is libCacheSim's default, the second fits the lines.
const SCRIPT: &str = "
import sys, time, libcachesim as l
path, size, turns, references = sys.argv[1], *map(int, sys.argv[2:])
for hashpower in 24, 16:
    times = []
    for _ in range(turns):
        reader = l.TraceReader(path, l.TraceType.ORACLE_GENERAL_TRACE, l.ReaderInitParam())
        cache = l.LRU(size, hashpower=hashpower)
        start = time.process_time()
        misses = round(cache.process_trace(reader)[0] * references)
        times.append(time.process_time() - start)
    print(l.__version__, hashpower, misses, sorted(times)[turns // 2])
";

fn libcachesim(file: &Path, size: u32, turns: usize, counted: &Counters, measured: &[Measured; 5]) {
    let mut python = Command::new("python3");
    python.args(["-c", SCRIPT]).arg(file).args([
        size.to_string(),
        turns.to_string(),
        counted.line_accesses.to_string(),
    ]);
    let out = match python.output() {
        Ok(out) if out.status.success() => String::from_utf8_lossy(&out.stdout).into_owned(),
        Ok(out) => {
            let error = String::from_utf8_lossy(&out.stderr).lines().last().unwrap_or_default().to_owned();
            return println!("NOT COMPARED: python3 with libcachesim 0.3.5 is absent or fails: {error}");
        }
        Err(error) => return println!("NOT COMPARED: python3 cannot be started: {error}"),
    };
    for line in out.lines() {
        let [version, hashpower, misses, seconds] = line.split(' ').collect::<Vec<_>>()[..] else {
            panic!("four words, but: {line}")
        };
        assert_eq!(misses, counted.line_misses.to_string(), "libCacheSim's misses and ours");
        let seconds: f64 = seconds.parse().expect("seconds");
        let ratio = |measured: &Measured| seconds / measured.median().as_secs_f64();
        println!("libCacheSim {version}, LRU of {size}, hash table of 2^{hashpower}: {seconds:.4} s, the same misses");
        println!("    ours, one setting:  {:8.1} times as fast", ratio(&measured[1]));
        println!("    ours, all sizes:    {:8.1} times as fast", ratio(&measured[2]));
    }
}
