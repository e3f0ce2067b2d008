//! Recorded references: replayed they give the live counters, at the recorded settings and at others.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use nix::sys::signal::Signal;
use serde_json::Value;

use crate::command::{TEAPOT, marti, number, python_with, recorded_report_of, report_of, run, stderr};
use crate::faults::Running;
use crate::processes::signal;

/// What a row of a replay and the memory of a report both say.
const COUNTS: [&str; 11] = [
    "local_bytes",
    "sets",
    "lines_per_set",
    "record_accesses",
    "misses",
    "line_accesses",
    "line_misses",
    "words_read",
    "words_moved",
    "misses_per_record_access",
    "words_moved_per_word_read",
];

/// The rows of `marti replay`, which must succeed.
fn replay(recording: &Path, options: &[&str]) -> Vec<Value> {
    let mut command = marti();
    command.arg("replay").arg(recording).args(["--format", "json"]).args(options);
    let output = command.output().expect("marti can be started");
    assert!(output.status.success(), "{options:?}: {:?}\n{}", output.status, stderr(&output));
    serde_json::from_slice(&output.stdout).expect("rows are JSON")
}

fn assert_equal(row: &Value, report: &Value, about: &str) {
    for count in COUNTS {
        assert!(!row[count].is_null(), "{about}: no {count}");
        assert_eq!(row[count], report["memory"][count], "{about}: {count}");
    }
    assert_eq!((&row["exact"], &row["reason"]), (&Value::Bool(true), &Value::Null), "{about}");
}

fn assert_checked(report: &Value, about: &str) {
    let checks = report["conservation"]["checks"].as_array().expect("checks are a list");
    let replayed = checks.iter().filter(|check| check["name"].as_str().is_some_and(|name| name.contains("replayed")));
    let nodes = report["nodes"].as_array().expect("nodes are a list").len();
    assert_eq!(replayed.count(), nodes, "{about}: {checks:?}");
    assert_eq!(report["conservation"]["holds"], true, "{about}: {checks:?}");
}

#[test]
fn replay_equals_live() {
    let topologies: [&[&str]; 13] = [
        &[],
        // Larger than the database, in sets that do not divide it.
        &["cluster.local_memory.size=64 MiB", "cluster.local_memory.ways=7", "cluster.nodes=1"],
        &["cluster.local_memory.size=1 MiB", "cluster.local_memory.ways=1", "cluster.local_memory.line=16"],
        // Several clusters, whose nodes are numbered one after the other.
        &["cluster.count=3", "cluster.nodes=2", "cluster.local_memory.ways=2"],
        &["cluster.local_memory.size=1/32", "cluster.local_memory.ways=4", "cluster.nodes=3"],
        &[
            "cluster.local_memory.size=4 KiB",
            "cluster.local_memory.line=16",
            "cluster.local_memory.replacement=fifo",
            "run.assignment=interleaved",
            "run.order=morton",
        ],
        &[
            "cluster.local_memory.size=1/16",
            "cluster.local_memory.replacement=random",
            "cluster.local_memory.ways=8",
            "cluster.nodes=4",
            "run.seed=9",
        ],
        &["scene.procedural=gears", "scene.size=1", "cluster.nodes=1", "cluster.local_memory.line=256"],
        &[
            "scene.procedural=gears",
            "scene.size=1",
            "cluster.local_memory.size=1/64",
            "cluster.local_memory.replacement=clock",
            "run.assignment=interleaved",
            "run.order=random",
            "cluster.nodes=5",
        ],
        &[
            "scene.procedural=gears",
            "scene.size=1",
            "cluster.local_memory.size=8 KiB",
            "cluster.local_memory.replacement=fifo",
            "cluster.local_memory.ways=1",
            "cluster.local_memory.line=32",
            "image.tile=[64, 1]",
        ],
        &[
            "scene.procedural=gears",
            "scene.size=1",
            "database.records=polygons",
            "database.numbers=f64",
            "database.record_bytes=300",
            "octree.leaf_size=1",
            "octree.max_depth=6",
            "cluster.local_memory.line=16",
            "cluster.local_memory.size=1/16",
            "cluster.nodes=3",
        ],
        &[
            "scene.board=none",
            "database.record_bytes=496",
            "cluster.local_memory.size=1/32",
            "cluster.local_memory.line=16",
            "cluster.local_memory.replacement=random",
        ],
        &["scene.procedural=balls", "scene.size=2", "cluster.local_memory.size=1/3", "octree.mailbox=false"],
    ];
    for sets in topologies {
        let out = tempfile::tempdir().expect("temporary folder");
        let about = sets.join(" ");
        let report = recorded_report_of(TEAPOT, out.path(), sets);
        assert_checked(&report, &about);
        assert!(number(&report, "memory.misses") > 100, "{about}: nothing to compare");
        let rows = replay(out.path(), &[]);
        assert_eq!(rows.len(), 1);
        assert_equal(&rows[0], &report, &about);
        assert_eq!(rows[0]["assignment"], "recorded");
        // The recording's own folder is the same recording.
        assert_eq!(replay(&out.path().join("recording"), &[]), rows);
    }
}

#[test]
fn live_runs_with_other_settings_are_predicted_bit_for_bit() {
    let interleaved = "run.assignment=interleaved";
    let recorded = tempfile::tempdir().expect("temporary folder");
    recorded_report_of(TEAPOT, recorded.path(), &[interleaved, "cluster.nodes=3"]);
    // Size, line, ways, policy, nodes, order.
    let others = [
        ["1/16", "64", "full", "lru", "3", "scanline"],
        ["4 KiB", "32", "4", "fifo", "2", "scanline"],
        ["1/32", "16", "2", "clock", "5", "morton"],
        ["1/4", "256", "full", "random", "1", "scanline"],
        ["1/8", "128", "8", "lru", "9", "random"],
        ["64 KiB", "64", "1", "random", "4", "morton"],
    ];
    for setting @ [size, line, ways, policy, nodes, order] in others {
        let about = setting.join(" ");
        let mut sets = vec![
            interleaved.to_owned(),
            format!("cluster.local_memory.size={size}"),
            format!("cluster.local_memory.line={line}"),
            format!("cluster.local_memory.replacement={policy}"),
            format!("cluster.nodes={nodes}"),
            format!("run.order={order}"),
        ];
        if ways != "full" {
            sets.push(format!("cluster.local_memory.ways={ways}"));
        }
        let out = tempfile::tempdir().expect("temporary folder");
        let live = report_of(TEAPOT, out.path(), &sets.iter().map(String::as_str).collect::<Vec<_>>());
        let names = ["--local-memory", "--line", "--ways", "--replacement", "--nodes", "--tile-order"];
        let options: Vec<&str> = names.into_iter().zip(setting).flat_map(|(name, value)| [name, value]).collect();
        let rows = replay(recorded.path(), &[&options[..], &["--assignment", "interleaved"]].concat());
        assert_equal(&rows[0], &live, &about);
    }
}

#[test]
fn contention_has_the_cycles_that_timings_have() {
    let out = tempfile::tempdir().expect("temporary folder");
    recorded_report_of(TEAPOT, out.path(), &["image.width=64", "image.height=64", "image.tile=8"]);
    for options in
        [&["--nodes", "4"][..], &["--nodes", "4", "--assignment", "on-demand"], &["--nodes", "2", "--clusters", "3"]]
    {
        let rows = replay(out.path(), &[options, &["--timings"]].concat());
        let mut command = marti();
        command.arg("replay").arg(out.path()).args(["--format", "json", "--contention"]).args(options);
        let output = command.output().expect("marti can be started");
        assert!(output.status.success(), "{options:?}: {}", stderr(&output));
        let table: Value = serde_json::from_slice(&output.stdout).expect("JSON");
        for column in ["cycles", "efficiency", "bus_utilisation", "wait_mean", "assignment", "clusters"] {
            assert_eq!(table["rows"][0][column], rows[0][column], "{options:?}: {column}");
        }
    }
}

#[test]
fn a_run_that_lost_a_node_is_replayed_exactly() {
    // A tile of many parts for each node, so that one is killed within a tile that has been written in part.
    let options = [
        "--record",
        "references",
        "--set",
        "image.width=96",
        "--set",
        "image.height=96",
        "--set",
        "image.tile=[96, 48]",
        "--set",
        "cluster.nodes=2",
        "--set",
        "cluster.local_memory.size=4 KiB",
    ];
    let mut running = Running::start_with(2, &options);
    running.wait_for(|name| name.starts_with("references-n"), 700 << 10);
    let bytes = |name: &str| fs::metadata(running.out.path().join("recording").join(name)).map_or(0, |file| file.len());
    let [first, second] = ["references-n000-e0.arrows", "references-n001-e0.arrows"];
    let longest = if bytes(first) > bytes(second) { first } else { second };
    let nodes = running.pids("marti-node");
    let writes = |pid: &&u32| {
        let files = fs::read_dir(format!("/proc/{pid}/fd")).into_iter().flatten().flatten();
        files.filter_map(|file| fs::read_link(file.path()).ok()).any(|file| file.ends_with(longest))
    };
    signal(*nodes.iter().find(writes).expect("a node writes it"), Signal::SIGKILL);
    let (status, _) = running.end(Duration::from_secs(120));
    assert!(status.success(), "{status}: {}", running.stderr());
    let report = running.report();
    assert!(number(&report, "tiles.reissued") >= 1, "{}", report["tiles"]);
    assert_checked(&report, "a node killed");
    assert_equal(&replay(running.out.path(), &[])[0], &report, "a node killed");
    let sidecar = fs::read(running.out.path().join("recording/references.json")).expect("a sidecar");
    let sidecar: Value = serde_json::from_slice(&sidecar).expect("JSON");
    let lost = sidecar["lost"].as_array().expect("a list");
    assert!(lost.iter().any(|lost| lost["epoch"] == 0 && lost["attempt"] == 0), "{lost:?}");
    assert_eq!(sidecar["files"].as_array().map(Vec::len), Some(3), "a file each process: {}", sidecar["files"]);
    // What is simulated without the loss is what an undisturbed run counts.
    let out = tempfile::tempdir().expect("temporary folder");
    let undisturbed = ["image.width=96", "image.height=96", "image.tile=[96, 48]", "cluster.local_memory.size=4 KiB"];
    let live = report_of(TEAPOT, out.path(), &[&undisturbed[..], &["run.assignment=interleaved"]].concat());
    assert_equal(&replay(running.out.path(), &["--assignment", "interleaved"])[0], &live, "undisturbed");
}

#[test]
fn an_interrupted_run_leaves_a_recording_of_what_was_done() {
    let options =
        ["--record", "references", "--set", "image.width=256", "--set", "image.height=256", "--set", "image.tile=16"];
    let mut running = Running::start_with(2, &options);
    running.wait_for(|name| name.starts_with("references-n"), 2 << 20);
    running.interrupt();
    let (status, _) = running.end(Duration::from_secs(60));
    assert_eq!(status.code(), Some(130), "{}", running.stderr());
    let report = running.report();
    assert!(number(&report, "tiles.done") < number(&report, "tiles.total"), "it was over too soon");
    assert_checked(&report, "interrupted");
    let row = &replay(running.out.path(), &[])[0];
    for count in COUNTS {
        assert_eq!(row[count], report["memory"][count], "{count}");
    }
}

#[test]
fn there_is_nothing_to_record_where_all_is_local() {
    let out = tempfile::tempdir().expect("temporary folder");
    let folder = out.path().join("out");
    let sets = ["--set", "cluster.local_memory.size=all", "--out"];
    let output =
        run(&[&["run", TEAPOT, "--record", "references"], &sets[..], &[&folder.display().to_string()]].concat());
    assert_eq!(output.status.code(), Some(2));
    let told = "error: there are no references to record where cluster.local_memory.size is \"all\"";
    assert!(stderr(&output).starts_with(told), "{}", stderr(&output));
    assert!(!folder.exists(), "nothing is left behind");
}

/// Bytes of all that was recorded of references.
fn recorded_bytes(out: &Path) -> u64 {
    let files = fs::read_dir(out.join("recording")).expect("a folder").flatten();
    let ours = files.filter(|file| !file.file_name().to_string_lossy().starts_with("bus."));
    ours.map(|file| file.metadata().expect("a file").len()).sum()
}

#[test]
fn a_reference_takes_at_most_five_bytes_on_disk() {
    let out = tempfile::tempdir().expect("temporary folder");
    let report = recorded_report_of(TEAPOT, out.path(), &["image.width=256", "image.height=256"]);
    let (bytes, references) = (recorded_bytes(out.path()), number(&report, "memory.record_accesses"));
    println!("{bytes} bytes, {references} references: {:.3} each", bytes as f64 / references as f64);
    assert!(bytes <= 5 * references, "{bytes} bytes for {references} references");
}

const PYARROW: &str = r#"
import sys, json, pathlib, numpy as np, pyarrow as pa
folder = pathlib.Path(sys.argv[1])
sidecar = json.loads((folder / "references.json").read_text())
sections = ["octree_nodes", "leaf_lists", "triangles", "spheres", "cones", "surfaces", "normals", "materials", "polygons"]
ends = np.cumsum([sidecar["records"].get(section, 0) for section in sections])
reads, kinds, tests, tiles = np.zeros(len(sections), int), np.zeros(4, int), 0, set()
for file in sidecar["files"]:
    with pa.ipc.open_stream(folder / file["name"]) as stream:
        for batch in stream:
            [row] = batch.to_pylist()
            words = np.array(row["references"], np.uint32)
            marks = words[words >> 30 == 3]
            kinds += np.bincount(marks & 0xffffff, minlength=4)
            reads += np.bincount(np.searchsorted(ends, words[words >> 30 == 0], "right"), minlength=len(sections))
            if row["is_last"]:
                tests += row["primitive_tests"]
                tiles.add(row["tile"])
levels = np.fromfile(folder / "octree-levels.u8", np.uint8)
json.dump({
    "reads": dict(zip(sections, reads.tolist())),
    "kinds": kinds.tolist(),
    "tests": int(tests),
    "tiles": len(tiles),
    "deepest": int(levels.max()),
}, sys.stdout)
"#;

#[test]
fn pyarrow_and_numpy_count_what_the_report_says() {
    if !python_with("pyarrow, numpy", "pyarrow_and_numpy_count_what_the_report_says") {
        return;
    }
    let out = tempfile::tempdir().expect("temporary folder");
    let report = recorded_report_of(TEAPOT, out.path(), &[]);
    let script = Command::new("python3").args(["-c", PYARROW]).arg(out.path().join("recording")).output();
    let script = script.expect("python3 can be started");
    assert!(script.status.success(), "{}", stderr(&script));
    let counted: Value = serde_json::from_slice(&script.stdout).expect("JSON");
    for section in report["memory"]["by_section"].as_array().expect("a list") {
        let name = section["section"].as_str().expect("a name");
        assert_eq!(counted["reads"][name], section["record_accesses"], "{name}");
    }
    let kinds = ["primary", "shadow", "reflection", "refraction"];
    for (kind, counted) in kinds.into_iter().zip(counted["kinds"].as_array().expect("a list")) {
        assert_eq!(*counted, report["rays"][kind], "{kind}");
    }
    assert_eq!(counted["tests"], report["tests"]["primitive"]);
    assert_eq!(counted["tiles"], report["tiles"]["total"]);
    assert_eq!(counted["deepest"], report["octree"]["depth"]);
}

/// Before anything was recorded there is no recording to close, and a signal stays a signal.
#[test]
fn a_run_that_is_interrupted_before_it_records_anything_says_so() {
    let folder = tempfile::tempdir().expect("temporary folder");
    for (attempt, milliseconds) in [5, 10, 15, 20, 25, 30, 40].into_iter().enumerate() {
        let out = folder.path().join(attempt.to_string());
        let mut command = Command::new(env!("CARGO_BIN_EXE_marti"));
        command.current_dir(env!("CARGO_MANIFEST_DIR")).args(["run", TEAPOT, "--record", "references", "--out"]);
        let run = command.arg(&out).stderr(Stdio::piped()).stdout(Stdio::null()).spawn().expect("it can be started");
        std::thread::sleep(Duration::from_millis(milliseconds));
        signal(run.id(), Signal::SIGTERM);
        let output = run.wait_with_output().expect("it ends");
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(!said.contains("cannot be closed"), "after {milliseconds} ms: {said}");
        // Before it has said that it takes signals, one ends it; a quick machine is done before.
        let ended = output.status.code();
        assert!([None, Some(143), Some(0)].contains(&ended), "after {milliseconds} ms: {ended:?}: {said}");
    }
}
