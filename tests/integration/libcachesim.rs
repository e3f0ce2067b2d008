//! Every policy that libCacheSim has misses as often as libCacheSim's: `pip install libcachesim==0.3.5`.
//!
//! What differs on purpose: with fewer than 20 lines S3-FIFO places nothing there (S3FIFO.c:284 of its revision aa0fc40 returns where an
//! object is not smaller than the small queue, which has one line or none), and the package ends with an error below 10. That revision
//! is older than the package, whose first lines go into the main queue when the small one is full. Its random replacement cannot be compared: it is not seeded.

use std::path::{Path, PathBuf};

use machine::hardware::local_memory::{Directory, Geometry, Reference, Slots};
use machine::hardware::replacement::{Clock, Clock0, Fifo, Lru, Replacement, S3Fifo, Sieve};
use machine::recording::references::Recording;
use machine::replay::model::objects::{ObjectCounters, Request, count_misses};
use machine::replay::model::optimal::optimal;
use machine::replay::model::replayer::{Replayer, Sum};
use machine::replay::plan::setting::Policy;
use machine::replay::{Lines, RecordLines, Trace};
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;
use serde_json::{Value, json};

use crate::command::{marti, python_with, stderr};
use crate::exports::{python, recorded};

const LINE_BYTES: u32 = 64;

/// Of each trace, by policy and size, misses and bytes missed: whole numbers, not shares.
const SCRIPT: &str = r#"
import sys, json, libcachesim as l
policies = {
    "lru": l.LRU, "fifo": l.FIFO, "sieve": l.Sieve, "s3-fifo": l.S3FIFO, "optimal": l.Belady, "clock:0": l.Clock,
    # A line is referenced when it is filled, too; by default it is not.
    "clock": lambda size, **others: l.Clock(size, init_freq=1, n_bit_counter=1, **others),
}
def counts(trace):
    def requests():
        parameters = l.ReaderInitParam(ignore_obj_size=trace["ignore_sizes"])
        return l.TraceReader(trace["path"], l.TraceType.ORACLE_GENERAL_TRACE, parameters)
    count = requests().get_num_of_req()
    total = count if trace["ignore_sizes"] else sum(request.obj_size for request in requests())
    def misses(policy, size):
        objects, bytes = policies[policy](size, hashpower=16).process_trace(requests())
        return [round(objects * count), round(bytes * total)]
    return {policy: [misses(policy, size) for size in trace["sizes"]] for policy in policies}
print(json.dumps([counts(trace) for trace in json.loads(sys.argv[1])]))
"#;

const POLICIES: [Policy; 7] =
    [Policy::Lru, Policy::Fifo, Policy::Clock, Policy::Clock0, Policy::Sieve, Policy::S3Fifo, Policy::Optimal];

/// By policy.
fn by_policy(counts: impl Fn(Policy) -> Value) -> Value {
    Value::Object(POLICIES.into_iter().map(|policy| (policy.to_string(), counts(policy))).collect())
}

/// A trace in a file, and the sizes of caches that it is replayed through.
struct Asked<'a> {
    path: &'a Path,
    ignore_sizes: bool,
    sizes: &'a [u64],
}

fn counted_by_libcachesim(asked: &[Asked<'_>]) -> Value {
    let asked: Vec<_> = asked
        .iter()
        .map(|trace| json!({"path": trace.path, "ignore_sizes": trace.ignore_sizes, "sizes": trace.sizes}))
        .collect();
    python(SCRIPT, &[&json!(asked).to_string()])
}

fn misses_of_recording<R: Replacement>(recording: &Recording, lines: &RecordLines, geometries: &[Geometry]) -> Value {
    let count = |&geometry: &Geometry| {
        let mut replayer = Replayer::<R, _>::new(lines, geometry, 0).expect("few slots");
        let mut sum = Sum::new(recording);
        let tiles = 0..recording.tiles().len() as u32;
        tiles.for_each(|tile| replayer.tile(recording, tile, &mut sum).expect("a sound recording"));
        let misses = sum.finish().line_misses;
        [misses, misses]
    };
    geometries.iter().map(count).collect()
}

#[test]
fn libcachesim_counts_the_same_misses_of_a_recording() {
    if !python_with("libcachesim", "libcachesim_counts_the_same_misses_of_a_recording") {
        return;
    }
    let out = tempfile::tempdir().expect("temporary folder");
    let (recording, tiles) = recorded(out.path(), 1);
    let path = out.path().join("x.oracleGeneral");
    let mut export = marti();
    export
        .arg("replay")
        .arg(out.path())
        .args(["--export", "oracle-general", "--node", "0", "--line", "64", "-o"])
        .arg(&path);
    let output = export.output().expect("marti can be started");
    assert!(output.status.success(), "{}", stderr(&output));

    let lines = RecordLines::new(&recording.layout, LINE_BYTES);
    let sizes = [64, 32, 16, 8, 4].map(|share| (lines.count() / share).max(20));
    let geometries = sizes.map(|ways| Geometry {
        line_bytes: LINE_BYTES,
        database_lines: lines.count(),
        sets: 1,
        ways: ways.into(),
    });
    let optimum = optimal(&recording, &tiles, &lines, &geometries).expect("a sound recording");
    let ours = by_policy(|policy| match policy {
        Policy::Lru => misses_of_recording::<Lru>(&recording, &lines, &geometries),
        Policy::Fifo => misses_of_recording::<Fifo>(&recording, &lines, &geometries),
        Policy::Clock => misses_of_recording::<Clock>(&recording, &lines, &geometries),
        Policy::Clock0 => misses_of_recording::<Clock0>(&recording, &lines, &geometries),
        Policy::Sieve => misses_of_recording::<Sieve>(&recording, &lines, &geometries),
        Policy::S3Fifo => misses_of_recording::<S3Fifo>(&recording, &lines, &geometries),
        _ => optimum.iter().map(|totals| [totals.line_misses; 2]).collect(),
    });
    let asked = Asked { path: &path, ignore_sizes: true, sizes: &sizes.map(u64::from) };
    let theirs = counted_by_libcachesim(&[asked]);
    eprintln!("memories of {sizes:?} of {} lines: {ours}", lines.count());
    assert_eq!(theirs, json!([ours]));
}

const OBJECTS: u32 = 3000;

/// Objects by Zipf's law, scans of all and parts of them, loops over more and fewer objects than fit, and all of this mixed.
fn synthetic() -> Vec<(&'static str, Vec<u32>)> {
    let mut random = Pcg32::seed_from_u64(5);
    let mut below = |limit: u32| ((u64::from(random.next_u32()) * u64::from(limit)) >> 32) as u32;
    // The cumulated weights 1/1 + … + 1/k, in 2⁻³² of all.
    let weights: Vec<f64> = (1..=OBJECTS)
        .scan(0.0, |sum, k| {
            *sum += 1.0 / f64::from(k);
            Some(*sum)
        })
        .collect();
    let mut zipf = |count: u32| -> Vec<u32> {
        let one = |_| {
            let at = f64::from(below(u32::MAX)) / f64::from(u32::MAX) * weights[weights.len() - 1];
            // Spread over the numbers, so that popular objects are not neighbours.
            (weights.partition_point(|weight| *weight < at) as u32).min(OBJECTS - 1) * 7 % OBJECTS
        };
        (0..count).map(one).collect()
    };
    let looped = |objects: u32, turns: u32| (0..turns).flat_map(move |_| 0..objects);
    let mixed: Vec<u32> = (0..12)
        .flat_map(|i| {
            let scan = i * 200..i * 200 + 400;
            // Repeated at once, as hits that only S3-FIFO counts.
            let twice = zipf(1500).into_iter().flat_map(|object| [object, object]);
            twice.chain(scan).chain(looped(40 * i, 3)).collect::<Vec<_>>()
        })
        .map(|object| object % OBJECTS)
        .collect();
    vec![
        ("zipf", zipf(40_000)),
        ("scans", looped(OBJECTS, 4).chain((0..8).flat_map(|i| i * 100..i * 300)).collect()),
        ("loops", (1..30).flat_map(|i| looped(17 * i, 5)).collect()),
        ("mixed", mixed),
    ]
}

/// oracleGeneral, see `machine::replay::exporters::oracle_general`.
fn write(folder: &Path, name: &str, requests: &[Request]) -> PathBuf {
    let mut next_by_object = vec![-1i64; OBJECTS as usize];
    let mut references = Vec::new();
    for (number, request) in (1..=requests.len() as i64).rev().zip(requests.iter().rev()) {
        let next = std::mem::replace(&mut next_by_object[request.object as usize], number);
        let bytes = u32::try_from(request.bytes).expect("small objects");
        let mut reference = Vec::from(0u32.to_le_bytes());
        reference.extend(u64::from(request.object).to_le_bytes());
        reference.extend(bytes.to_le_bytes());
        reference.extend(next.to_le_bytes());
        references.push(reference);
    }
    references.reverse();
    let path = folder.join(name);
    std::fs::write(&path, references.concat()).expect("room in a temporary folder");
    path
}

fn misses_of_lines<R: Replacement>(string: &[u32], ways: &[u64]) -> Value {
    let count = |&ways: &u64| {
        let mut directory = Directory::<R>::new(Slots { sets: 1, ways: ways as u32 }, OBJECTS, 0);
        let misses = string.iter().filter(|line| matches!(directory.reference(**line), Reference::Miss { .. })).count();
        [misses, misses]
    };
    ways.iter().map(count).collect()
}

fn misses_of_objects(policy: Policy, requests: &[Request], sizes: &[u64]) -> Value {
    let count = |&capacity: &u64| {
        let counters: ObjectCounters =
            count_misses(policy, capacity, OBJECTS, 0, requests).expect("objects with numbers below their count");
        [counters.misses, counters.bytes_missed]
    };
    sizes.iter().map(count).collect()
}

/// Lines in memories, and objects of one byte in caches.
#[test]
fn libcachesim_counts_the_same_misses_of_lines() {
    if !python_with("libcachesim", "libcachesim_counts_the_same_misses_of_lines") {
        return;
    }
    let out = tempfile::tempdir().expect("temporary folder");
    let sizes = [20, 29, 30, 57, 100, 333, 1000, 2500];
    let traces: Vec<_> = synthetic()
        .into_iter()
        .map(|(name, string)| {
            let requests: Vec<_> = string.iter().map(|&object| Request { object, bytes: 1 }).collect();
            (name, write(out.path(), name, &requests), string, requests)
        })
        .collect();
    let asked: Vec<_> = traces.iter().map(|(_, path, ..)| Asked { path, ignore_sizes: true, sizes: &sizes }).collect();
    let theirs = counted_by_libcachesim(&asked);
    for ((name, _, string, requests), theirs) in traces.iter().zip(theirs.as_array().expect("a list")) {
        let objects = by_policy(|policy| misses_of_objects(policy, requests, &sizes));
        assert_eq!(theirs, &objects, "{name}, objects of one byte");
        let lines = by_policy(|policy| match policy {
            Policy::Lru => misses_of_lines::<Lru>(string, &sizes),
            Policy::Fifo => misses_of_lines::<Fifo>(string, &sizes),
            Policy::Clock => misses_of_lines::<Clock>(string, &sizes),
            Policy::Clock0 => misses_of_lines::<Clock0>(string, &sizes),
            Policy::Sieve => misses_of_lines::<Sieve>(string, &sizes),
            Policy::S3Fifo => misses_of_lines::<S3Fifo>(string, &sizes),
            _ => objects["optimal"].clone(),
        });
        assert_eq!(theirs, &lines, "{name}, lines");
        let misses: std::collections::BTreeSet<_> =
            lines.as_object().expect("policies").values().map(Value::to_string).collect();
        assert!(misses.len() >= 4, "policies do not differ in {name}: {lines}");
    }
}

/// Objects of different sizes, which stay as they are in one half of the traces, and change with each request in the other.
#[test]
fn libcachesim_counts_the_same_misses_of_objects() {
    if !python_with("libcachesim", "libcachesim_counts_the_same_misses_of_objects") {
        return;
    }
    let out = tempfile::tempdir().expect("temporary folder");
    let sizes = [10, 999, 20_000, 123_456, 1 << 20, 10_000_000];
    let mut traces = Vec::new();
    for (name, string) in synthetic() {
        for changing in [false, true] {
            // 1 to 32,000 bytes, more of them small.
            let bytes = |number: u32, object: u32| {
                let number = if changing { number } else { 0 };
                let hash = (object ^ number.wrapping_mul(0x9e37_79b9)).wrapping_mul(0x85eb_ca6b) >> 8;
                1 + u64::from(hash % 1000) * u64::from(hash / 1000 % 33)
            };
            let requests: Vec<_> =
                (0..).zip(&string).map(|(i, &object)| Request { object, bytes: bytes(i, object) }).collect();
            let name = format!("{name}, {}", if changing { "changing" } else { "constant" });
            traces.push((write(out.path(), &name, &requests), name, requests));
        }
    }
    let asked: Vec<_> = traces.iter().map(|(path, ..)| Asked { path, ignore_sizes: false, sizes: &sizes }).collect();
    let theirs = counted_by_libcachesim(&asked);
    for ((_, name, requests), theirs) in traces.iter().zip(theirs.as_array().expect("a list")) {
        let ours = by_policy(|policy| misses_of_objects(policy, requests, &sizes));
        assert_eq!(theirs, &ours, "{name}");
    }
}
