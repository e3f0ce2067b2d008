//! Traces of valgrind's lackey through memories of the shapes that cachegrind simulates, on a program of this machine.

use std::fs;
use std::process::Command;

use serde_json::Value;

use crate::command::{marti, number, stderr};

/// Bytes, ways and bytes of a line of a first-level data cache.
const SHAPES: [[u32; 3]; 5] = [[1 << 20, 1, 64], [1 << 20, 1, 256], [32_768, 8, 64], [8192, 2, 32], [65_536, 1, 64]];

/// Valgrind with a tool, whose output is in a file then. It has the same environment each time, so that the program has
/// the same addresses.
fn valgrind(options: &[&str]) {
    let mut command = Command::new("valgrind");
    command.env_clear().env("PATH", "/usr/bin:/bin").args(options).arg("/bin/true");
    let output = command.output().expect("valgrind can be started");
    assert!(output.status.success(), "{options:?}: {}", stderr(&output));
}

/// The numbers of a line such as `==7== D1  misses:  1,405  ( 1,058 rd   +    347 wr)`.
fn misses(log: &str) -> [u64; 3] {
    let line = log.lines().find(|line| line.contains("D1  misses:")).expect("cachegrind prints its misses");
    let (_, numbers) = line.split_once("misses:").expect("misses");
    let digits = numbers.replace(',', "");
    let found = digits.split(|c: char| !c.is_ascii_digit()).filter_map(|number| number.parse().ok());
    found.collect::<Vec<_>>().try_into().expect("three numbers")
}

#[test]
fn cachegrind_counts_the_same_misses() {
    if Command::new("valgrind").arg("--version").output().is_err() {
        eprintln!("SKIPPED cachegrind_counts_the_same_misses: valgrind is not installed");
        return;
    }
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let (lackey, log) = (path("all.lackey"), path("cachegrind.txt"));
    valgrind(&["--tool=lackey", "--trace-mem=yes", &format!("--log-file={lackey}")]);
    // The data cache has no instructions.
    let data: Vec<_> = fs::read(&lackey).expect("a trace").split_inclusive(|&byte| byte == b'\n').fold(
        Vec::new(),
        |mut kept, line| {
            kept.extend_from_slice(if line.starts_with(b"I") { b"" } else { line });
            kept
        },
    );
    fs::write(path("data.lackey"), data).expect("room in a temporary folder");
    for [bytes, ways, line] in SHAPES {
        let cache = format!("--D1={bytes},{ways},{line}");
        valgrind(&[
            "--tool=cachegrind",
            "--cache-sim=yes",
            "--cachegrind-out-file=/dev/null",
            &cache,
            &format!("--log-file={log}"),
        ]);
        let [all, reads, writes] = misses(&fs::read_to_string(&log).expect("a log"));
        let sizes = [bytes, ways, line].map(|number| number.to_string());
        let output = marti()
            .args(["replay", &path("data.lackey"), "--format", "json"])
            .args(["--local-memory", &sizes[0], "--ways", &sizes[1], "--line", &sizes[2]])
            .output()
            .expect("marti can be started");
        assert!(output.status.success(), "{cache}: {}", stderr(&output));
        let rows: Value = serde_json::from_slice(&output.stdout).expect("rows are JSON");
        let (misses, write_misses) = (number(&rows[0], "misses"), number(&rows[0], "write_misses"));
        assert_eq!([misses, misses - write_misses, write_misses], [all, reads, writes], "{cache}");
    }
}
