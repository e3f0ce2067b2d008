//! What is exported of recorded references, read by the tools that its users have.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process::Command;

use cluster::topology::recorded::open_references;
use ground::ids::ClusterId;
use machine::hardware::local_memory::Geometry;
use machine::hardware::specification::Transactions;
use machine::recording::references::Recording;
use machine::replay::contention::timing::simulate_cluster;
use machine::replay::exporters::accesses::Surroundings;
use machine::replay::exporters::chrome::ChromeTrace;
use machine::replay::exporters::vcd::BusWaves;
use machine::replay::exporters::{ExportError, csv, din, json};
use machine::replay::plan::setting::Setting;
use machine::replay::{RecordLines, Trace};
use serde_json::Value;

use crate::command::{TEAPOT, marti, python_with, stderr};

const LINE_BYTES: u32 = 64;

/// A recorded run of so many nodes in the folder: its references, and all tiles in their order.
pub(crate) fn recorded(folder: &Path, nodes: u16) -> (Recording, Vec<u32>) {
    let nodes = format!("cluster.nodes={nodes}");
    let mut command = marti();
    command.args(["run", TEAPOT, "--quiet", "--record", "references", "--set", &nodes, "--out"]).arg(folder);
    let output = command.args(["--set", "cluster.local_memory.size=1/8"]).output().expect("marti can be started");
    assert!(output.status.success(), "{}", stderr(&output));
    let opened = open_references(folder).expect("a recording");
    assert_eq!(opened.faults, Vec::<String>::new());
    let tiles = (0..opened.recording.tiles().len() as u32).collect();
    (opened.recording, tiles)
}

fn exported(
    folder: &Path,
    name: &str,
    write: impl FnOnce(&mut BufWriter<File>) -> Result<u64, ExportError>,
) -> (PathBuf, u64) {
    let path = folder.join(name);
    let mut file = BufWriter::new(File::create(&path).expect("a file in a temporary folder"));
    let count = write(&mut file).expect("room in a temporary folder");
    file.into_inner().expect("room in a temporary folder");
    (path, count)
}

pub(crate) fn python(script: &str, arguments: &[&str]) -> Value {
    let output = Command::new("python3").args(["-c", script]).args(arguments).output().expect("python3 can be started");
    assert!(output.status.success(), "{}", stderr(&output));
    serde_json::from_slice(&output.stdout).expect("the script prints JSON")
}

fn surroundings(recording: &Recording) -> Surroundings<'_> {
    Surroundings { layout: &recording.layout, levels: &recording.octree_levels, tiling: recording.tiling }
}

/// Counts by each column of few values, and a sum that depends on all others.
const ROWS: &str = r#"
import sys, json, duckdb, pyarrow.csv
csv, lines = sys.argv[1:]
def counts(table):
    by = lambda column: dict(duckdb.sql(f"select coalesce({column}::varchar, 'none'), count(*) from {table} group by 1").fetchall())
    total = duckdb.sql(f"select count(*), sum((x + 1000 * y + 17 * record + tile) * 3 + address), sum(bytes) from {table}")
    return [by("ray"), by("section"), by("level"), [int(value) for value in total.fetchall()[0]]]
arrow = pyarrow.csv.read_csv(csv)
print(json.dumps({
    "duckdb_csv": counts(f"read_csv('{csv}')"),
    "duckdb_json": counts(f"read_json('{lines}', format='newline_delimited')"),
    "pyarrow": counts("arrow"),
    "columns": arrow.column_names,
}))
"#;

#[test]
fn duckdb_and_pyarrow_read_rows_and_objects() {
    if !python_with("pyarrow, duckdb", "duckdb_and_pyarrow_read_rows_and_objects") {
        return;
    }
    let out = tempfile::tempdir().expect("temporary folder");
    let (recording, tiles) = recorded(out.path(), 1);
    let (rows, count) =
        exported(out.path(), "x.csv", |file| csv::write(file, &recording, &tiles, surroundings(&recording)));
    let (objects, objects_count) =
        exported(out.path(), "x.json", |file| json::write(file, &recording, &tiles, surroundings(&recording)));
    assert_eq!((count, objects_count), (recording.references, recording.references));

    let read = python(ROWS, &[&rows.to_string_lossy(), &objects.to_string_lossy()]);
    let expected = &read["duckdb_csv"];
    assert_eq!(expected[3][0], count);
    assert_eq!(&read["duckdb_json"], expected);
    assert_eq!(&read["pyarrow"], expected);
    assert_eq!(read["columns"], serde_json::json!(csv::HEADER.split(',').collect::<Vec<_>>()));
    // Only octree nodes have a level.
    let other: u64 = expected[1]
        .as_object()
        .expect("sections")
        .iter()
        .map(|(name, count)| if name == "octree_nodes" { 0 } else { count.as_u64().expect("a count") })
        .sum();
    assert_eq!(expected[2]["none"], other);
}

#[test]
fn din_has_a_line_for_each_reference() {
    let out = tempfile::tempdir().expect("temporary folder");
    let (recording, tiles) = recorded(out.path(), 1);
    let lines = RecordLines::new(&recording.layout, LINE_BYTES);
    let (path, count) = exported(out.path(), "x.din", |file| din::write(file, &recording, &tiles, &lines, LINE_BYTES));
    let text = std::fs::read_to_string(path).expect("what was written");
    assert_eq!(text.lines().count() as u64, count);
    let address = |line: &str| u64::from_str_radix(line.strip_prefix("0 ").expect("a read"), 16).expect("an address");
    let places = text.lines().map(address);
    assert!(places.into_iter().all(|address| address % 64 == 0 && address < recording.layout.database_bytes()));
}

/// What each node's process and the bus's show, added up; and the bus's wave forms, integrated over time.
const BUS: &str = r##"
import sys, json
trace = json.load(open(sys.argv[1]))
events = trace["traceEvents"]
names = {e["pid"]: e["args"]["name"] for e in events if e["name"] == "process_name"}
bus = next(pid for pid, name in names.items() if name.endswith("bus"))
of = lambda pid, ph: [e for e in events if e["pid"] == pid and e["ph"] == ph]
end = lambda e: e["ts"] + e["dur"]
nodes = {}
for pid in sorted(names.keys() - {bus}):
    begins, ends, stalls = of(pid, "B"), of(pid, "E"), of(pid, "X")
    assert [e["name"] for e in begins] == [e["name"] for e in ends]
    spans = [(b["ts"], e["ts"]) for b, e in zip(begins, ends)]
    assert all(b <= e for b, e in spans) and all(e[1] <= b[0] for e, b in zip(spans, spans[1:]))
    assert all(end(one) <= other["ts"] for one, other in zip(stalls, stalls[1:]))
    # All but the messages that a tile is done are within a tile.
    outside = [s["name"] for s in stalls if not any(b <= s["ts"] and end(s) <= e for b, e in spans)]
    assert outside == ["job"] * len(spans), outside[:5]
    nodes[names[pid]] = [len(spans), sum(s["dur"] for s in stalls), sum(s["args"]["bytes"] for s in stalls)]
held = of(bus, "X")
assert all(end(one) <= other["ts"] for one, other in zip(held, held[1:]))
shares = [(e["ts"], e["args"]["share"]) for e in of(bus, "C")]
counted = sum(share * (next - ts) for (ts, share), (next, _) in zip(shares, shares[1:]))

now, busy, cycles, fetched, changes = 0, "0", 0, set(), {}
for line in open(sys.argv[2]).read().split("$enddefinitions $end")[1].split():
    if line[0] == "#":
        cycles += (int(line[1:]) - now) * (busy == "1")
        now = int(line[1:])
    elif line in ("0b", "1b"):
        busy = line[0]
    elif line == "a":
        fetched.add(before)
    before = line
print(json.dumps({
    "nodes": nodes, "held": sum(e["dur"] for e in held), "counted": round(counted), "last": shares[-1][0],
    "busy": cycles, "now": now, "addresses": sorted(int(a[1:], 2) for a in fetched if a != "bx"),
}))
"##;

#[test]
fn python_adds_up_a_chrome_trace_and_wave_forms() {
    if !python_with("json", "python_adds_up_a_chrome_trace_and_wave_forms") {
        return;
    }
    let out = tempfile::tempdir().expect("temporary folder");
    let (mut recording, _) = recorded(out.path(), 4);
    let geometry = Geometry::new(&recording.conditions.cluster.local_memory, &recording.layout).expect("as recorded");
    let setting = Setting::recorded(&recording.conditions.cluster, recording.conditions.tile_order);
    let (trace_path, waves_path) = (out.path().join("x.json"), out.path().join("x.vcd"));
    for transactions in [Transactions::Locked, Transactions::Split] {
        recording.conditions.cluster.bus.transactions = transactions;
        let file = |path| BufWriter::new(File::create(path).expect("a file in a temporary folder"));
        let trace = ChromeTrace::new(file(&trace_path), 1000);
        trace.cluster(ClusterId(0), 4);
        let (outcome, _) =
            simulate_cluster(&recording, &setting, geometry, 0, &mut &trace, |step| trace.step(step)).expect("sound");
        trace.finish().and_then(|mut file| file.flush()).expect("room in a temporary folder");
        let waves = BusWaves::new(file(&waves_path), ClusterId(0), 4);
        simulate_cluster(&recording, &setting, geometry, 0, &mut &waves, |step| waves.step(step)).expect("sound");
        waves.finish().and_then(|mut file| file.flush()).expect("room in a temporary folder");

        let read = python(BUS, &[&trace_path.to_string_lossy(), &waves_path.to_string_lossy()]);
        let mut tiles = 0;
        for node in &outcome.nodes {
            let shown = &read["nodes"][format!("cluster 0 {}", node.node)];
            assert_eq!(shown[1], node.stall_cycles);
            assert_eq!(shown[2], node.bytes);
            tiles += shown[0].as_u64().expect("a count");
        }
        assert_eq!(tiles, recording.tiles().len() as u64);
        for busy in ["held", "counted", "busy"] {
            assert_eq!(read[busy], outcome.bus_busy_cycles, "{busy}");
        }
        assert_eq!(read["last"], outcome.cycles);
        let addresses: Vec<u64> = serde_json::from_value(read["addresses"].clone()).expect("addresses");
        assert!(addresses.len() > 100, "{} addresses", addresses.len());
        assert!(addresses.iter().all(|address| address % 64 == 0 && *address < recording.layout.database_bytes()));
    }
}
