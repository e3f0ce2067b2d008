//! `marti replay TRACE`: traces that came from elsewhere, from a file or standard input.

use std::fs;
use std::io::Write;
use std::process::{Output, Stdio};

use serde_json::Value;

use crate::command::{marti, number, run, stderr};

/// `0 40`, `1 80`, `2 c0`, `3 100`, as `gzip -9` writes them.
const GZIP: &[u8] = b"\x1f\x8b\x08\x00\x00\x00\x00\x00\x02\x03\x33\x50\x30\x31\xe0\x32\x54\xb0\x30\xe0\x32\x52\x48\x36\xe0\x32\x56\x30\x34\x30\xe0\x02\x00\xf8\xd3\x8f\xd3\x15\x00\x00\x00";

/// Replays what standard input has.
fn piped(input: &[u8], options: &[&str]) -> Output {
    let mut command = marti();
    command.args(["replay", "-", "--format", "json"]).args(options);
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().expect("marti can be started");
    // What is refused is not read to its end.
    let _ = child.stdin.take().expect("a pipe").write_all(input);
    child.wait_with_output().expect("it ends")
}

/// The first row, and what was said.
fn row(output: &Output) -> (Value, String) {
    assert!(output.status.success(), "{}", stderr(output));
    let rows: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    (rows[0].clone(), stderr(output))
}

#[test]
fn standard_input_is_read_plain_and_compressed() {
    let (plain, said) = row(&piped(b"r 40 4\nw 80 4\nw 80 4\nr 100 1\n", &["--local-memory", "1 KiB"]));
    assert_eq!(
        ["line_accesses", "line_misses", "write_accesses", "write_misses"].map(|name| number(&plain, name)),
        [4, 3, 2, 1]
    );
    assert_eq!((number(&plain, "bytes_written_back"), number(&plain, "bytes_dirty_at_end")), (0, 64));
    assert!(said.contains("2 of 4 references are writes: --write-policy back, --write-allocate yes"), "{said}");
    let options = ["--local-memory", "1 KiB", "--import", "din", "--write-policy", "through", "--write-allocate", "no"];
    let (compressed, said) = row(&piped(GZIP, &options));
    assert_eq!((number(&compressed, "line_misses"), number(&compressed, "bytes_written_through")), (4, 4));
    assert_eq!(said, "");
}

#[test]
fn objects_are_counted_by_units() {
    // LRU of 16 objects over twice 17 of them: all miss; a memory of 17 has them the second time.
    let ids: String = (0..34).map(|i| format!("key {}\n", i % 17)).collect();
    for (memory, misses) in [("16", 34), ("17", 17), ("1/1", 17)] {
        let options = ["--import", "ids", "--ignore-object-size", "--local-memory", memory];
        let (counted, said) = row(&piped(ids.as_bytes(), &options));
        assert_eq!((number(&counted, "misses"), said.as_str()), (misses, ""), "{memory}");
    }
}

#[test]
fn objects_have_the_sizes_of_their_trace() {
    // By hand, of a capacity of 100 bytes, LRU: c evicts b, since a was requested after it; d is larger than the cache.
    let table = "obj_id,obj_size\na,60\nb,40\na,60\nc,30\na,60\nd,101\na,60\n";
    let (counted, said) = row(&piped(table.as_bytes(), &["--import", "csv", "--local-memory", "100"]));
    let names = ["requests", "misses", "bytes_requested", "bytes_missed", "objects", "objects_bytes"];
    let expected = [7, 4, 411, 60 + 40 + 30 + 101, 4, 60 + 40 + 30 + 101];
    assert_eq!((names.map(|name| number(&counted, name)), said.as_str()), (expected, ""));
    let half = row(&piped(table.as_bytes(), &["--import", "csv", "--local-memory", "1/2"])).0;
    assert_eq!(number(&half, "local_bytes"), 115);
    // Objects whose size changes are one object each.
    let resized =
        row(&piped(b"obj_id,obj_size\na,10\nb,20\na,10\nb,200\na,10\n", &["--import", "csv", "--local-memory", "all"]))
            .0;
    assert_eq!(["objects", "objects_bytes", "misses"].map(|name| number(&resized, name)), [2, 30, 2]);
    for option in ["--classes", "--curve"] {
        let refused = piped(table.as_bytes(), &["--import", "csv", option]);
        assert!(stderr(&refused).contains("has no effect on caches of objects with sizes"), "{}", stderr(&refused));
    }
}

#[test]
fn lines_of_a_trace_may_be_long() {
    let table = "lbn,size\n0,65536\n127,512\n128,512\n";
    let options = ["--import", "csv", "--csv-address-unit", "512", "--line", "16,65536", "--local-memory", "all"];
    let output = piped(table.as_bytes(), &options);
    assert!(output.status.success(), "{}", stderr(&output));
    let rows: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!([0, 1].map(|i| number(&rows[i], "line_misses")), [4096 + 32, 2]);
}

#[test]
fn what_cannot_be_is_refused() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let file = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        fs::write(&path, bytes).expect("writable folder");
        path.to_string_lossy().into_owned()
    };
    let (reads, ids) = (file("r.din", b"0 1\n"), file("i.txt", b"1\n"));
    let (cut, unknown) = (file("c.din.gz", &GZIP[..30]), file("unknown", b"hello\n"));
    let dropped = file("v.din", b"0 1\n5 1\n");
    for (arguments, expected) in [
        (&[reads.as_str(), "--write-policy", "back"][..], "a trace without writes"),
        (&[&reads, "--ignore-object-size"], "a trace of bytes has no objects"),
        (&[&reads, "--csv-id", "1"], "this is no table"),
        (&[&reads, "--timings"], "--timings has no effect on a trace"),
        (&[&reads, "--line", "131072"], "expected a power of two, 16 to 65536"),
        (&[&ids, "--line", "64"], "--line has no effect on objects"),
        (&[&cut], "c.din.gz: gzip: the compressed stream ends at byte 30"),
        (&[&unknown], "its format is not recognised; --import says which"),
        (&[&dropped, "--curve"], "a trace with invalidations"),
        (&[&dropped, "--replacement", "optimal"], "a trace with invalidations"),
        (&["tests", "--csv-id", "1"], "--csv-id has no effect on a recording"),
        (&["tests", "--write-policy", "back"], "--write-policy has no effect on a recording"),
        (&[&ids, "--csv-id", "1", "--csv-address", "2"], "cannot be used with"),
    ] {
        let output = run(&[&["replay"], arguments].concat());
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", stderr(&output));
        assert!(stderr(&output).contains(expected), "{arguments:?}: {}", stderr(&output));
    }
}
