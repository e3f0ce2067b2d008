//! The bus log, read by the tools that its users have.

use std::process::Command;

use crate::command::{TEAPOT, number, python_with, report_of, stderr};

const PYARROW: &str = r#"
import sys, json, pyarrow as pa, pyarrow.compute as pc
table = pa.ipc.open_stream(sys.argv[1]).read_all()
sequence = table["sequence"].to_pylist()
fetch = table.filter(pc.equal(table["kind"].cast(pa.string()), "fetch"))
json.dump({
    "rows": table.num_rows,
    "fetches": fetch.num_rows,
    "bytes": sum(fetch["bytes"].to_pylist()),
    "in_order": sequence == list(range(sequence[0], sequence[0] + len(sequence))),
}, sys.stdout)
"#;

const DUCKDB: &str = r#"
import sys, json, duckdb, pyarrow as pa
log = pa.ipc.open_stream(sys.argv[1]).read_all()
kinds = duckdb.sql("select cast(kind as varchar), count(*) from log group by 1").fetchall()
json.dump(dict(kinds), sys.stdout)
"#;

fn python(script: &str, file: &std::path::Path) -> serde_json::Value {
    let output = Command::new("python3").args(["-c", script]).arg(file).output().expect("python3 can be started");
    assert!(output.status.success(), "{}", stderr(&output));
    serde_json::from_slice(&output.stdout).expect("the script prints JSON")
}

#[test]
fn pyarrow_and_duckdb_count_what_the_report_says() {
    if !python_with("pyarrow, duckdb", "pyarrow_and_duckdb_count_what_the_report_says") {
        return;
    }
    let out = tempfile::tempdir().expect("temporary folder");
    let report = report_of(TEAPOT, out.path(), &["cluster.local_memory.size=1/32"]);
    let log = out.path().join("recording/bus.arrows");

    let counted = python(PYARROW, &log);
    assert_eq!(number(&counted, "fetches"), number(&report, "bus.fetches"));
    assert_eq!(number(&counted, "rows"), number(&report, "bus.log_rows"));
    let line = 64;
    assert_eq!(number(&counted, "bytes"), number(&report, "memory.line_misses") * line);
    assert_eq!(counted["in_order"], true);

    let kinds = python(DUCKDB, &log);
    assert_eq!(number(&kinds, "fetch"), number(&report, "bus.fetches"));
    // A job and its end for every tile, and its pixels.
    assert_eq!(number(&kinds, "job"), 2 * number(&report, "tiles.total"));
    assert_eq!(number(&kinds, "pixels"), number(&report, "tiles.total"));
}
