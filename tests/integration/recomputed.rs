//! Counts of `marti replay`, computed again by tests/simulator/simulator.py, which shares no code with this program.

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::command::{TEAPOT, marti, python_with, recorded_report_of, stderr};

/// A small image, so that a plain program is quick enough.
const SMALL: [&str; 4] = ["image.width=32", "image.height=32", "image.tile=8", "cluster.nodes=3"];

/// Compares all combinations of these options; returns how many there were.
fn agree(recording: &Path, options: &str) -> usize {
    let grid = marti().arg("replay").arg(recording).args(["--format", "json"]).args(options.split(' ')).output();
    let grid = grid.expect("marti can be started");
    assert!(grid.status.success(), "{options}: {}", stderr(&grid));
    let file = recording.join("grid.json");
    fs::write(&file, &grid.stdout).expect("room in a temporary folder");
    let simulator = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/simulator/simulator.py");
    let compared = Command::new("python3").arg(simulator).arg(recording).arg(&file).output().expect("python3");
    assert!(compared.status.success(), "{options}: {}", stderr(&compared));
    let said = String::from_utf8_lossy(&compared.stdout).into_owned();
    let count = said.strip_suffix(" settings agree\n").and_then(|count| count.parse().ok());
    count.unwrap_or_else(|| panic!("{options}: {said}"))
}

#[test]
fn a_simulator_from_the_documents_counts_the_same() {
    if !python_with("pyarrow", "a_simulator_from_the_documents_counts_the_same") {
        return;
    }
    let out = tempfile::tempdir().expect("temporary folder");
    recorded_report_of(TEAPOT, out.path(), &SMALL);
    // From a share to memories that are larger than the database.
    let memories = "--local-memory 1/32,4KiB,16MiB,all --line 16,64,256";
    let policies = "--replacement lru,fifo,clock,clock:0,random,optimal,srrip,sieve,s3-fifo";
    let mut settings = agree(out.path(), &format!("{memories} --ways 1,7,full {policies}"));
    settings += agree(out.path(), &format!("{memories} --ways 1,2,16 --replacement plru"));
    settings += agree(
        out.path(),
        "--nodes 1,4 --clusters 1,2 --tile-order morton,random --ways 4,full --replacement lru,random",
    );
    let polygons = tempfile::tempdir().expect("temporary folder");
    let layout = ["database.records=polygons", "database.record_bytes=300", "database.numbers=f64", "cluster.count=2"];
    recorded_report_of(TEAPOT, polygons.path(), &[&SMALL[..], &layout].concat());
    settings +=
        agree(polygons.path(), "--local-memory 1/32,1/4,all --line 16,256 --ways 3,full --replacement lru,sieve");
    assert!(settings >= 400, "{settings}");
}
