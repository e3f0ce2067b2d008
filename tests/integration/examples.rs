//! The programs of `examples/`, run as their first lines say.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::command::{TEAPOT, recorded_report_of, stderr};

/// Where cargo puts an example that it builds with this test.
fn example(name: &str) -> Command {
    let folder = Path::new(env!("CARGO_BIN_EXE_marti")).parent().expect("a folder");
    let program: PathBuf = folder.join("examples").join(name);
    assert!(
        program.is_file(),
        "{} is not there: `cargo test` builds it with all tests, `cargo build --examples` alone",
        program.display()
    );
    Command::new(program)
}

/// What an example prints, a line each.
fn lines(command: &mut Command) -> Vec<String> {
    let output = command.output().expect("it can be started");
    assert!(output.status.success(), "{}", stderr(&output));
    String::from_utf8(output.stdout).expect("text").lines().map(str::to_owned).collect()
}

/// The last two columns of a row.
fn numbers(line: &str) -> (u64, u64) {
    let columns: Vec<&str> = line.split_whitespace().collect();
    let [.., one, other] = columns[..] else { panic!("{line}") };
    (one.parse().expect("a number"), other.parse().expect("a number"))
}

#[test]
fn a_scene_is_rendered_as_the_program_renders_it() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let (own, theirs) = (folder.path().join("own.png"), folder.path().join("theirs.png"));
    lines(example("render").arg("teapot:6").arg(&own));
    let marti = Command::new(env!("CARGO_BIN_EXE_marti"))
        .args(["render", "teapot:6", "--size", "256x256", "--quiet", "-o"])
        .arg(&theirs)
        .output()
        .expect("marti can be started");
    assert!(marti.status.success(), "{}", stderr(&marti));
    assert!(std::fs::read(own).expect("written") == std::fs::read(theirs).expect("written"));
}

#[test]
fn a_policy_of_one_s_own_is_counted_beside_lru() {
    let rows = lines(&mut example("replacement_policy"));
    let page = include_str!("../../docs/extending/replacement-policy.md");
    assert!(
        rows.iter().all(|row| page.contains(row)),
        "docs/extending/replacement-policy.md shows another table: {rows:?}"
    );
    let counts: Vec<(u64, u64)> = rows[1..].iter().map(|row| numbers(row)).collect();
    assert_eq!(counts.len(), 5);
    assert!(counts.is_sorted_by(|more, less| more.0 <= less.0), "less memory never misses less under LRU: {rows:?}");
    assert!(counts.iter().all(|(lru, one_bit)| *one_bit > lru / 2 && *one_bit < 2 * lru), "{rows:?}");
}

#[test]
fn a_recording_is_read_and_replayed_as_recorded() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let report = recorded_report_of(TEAPOT, folder.path(), &[]);
    let rows = lines(example("read_recording").arg(folder.path()));
    let accesses: u64 = report["nodes"]
        .as_array()
        .expect("nodes")
        .iter()
        .map(|node| node["record_accesses"].as_u64().expect("a count"))
        .sum();
    assert!(rows[0].starts_with(&format!("{accesses} references of records")), "{rows:?}");
    assert_eq!(rows.len(), 2 + 5);
    assert!(rows[2..].iter().all(|row| numbers(row).0 == accesses && numbers(row).1 > 0), "{rows:?}");
}

#[test]
fn a_cluster_in_one_process_renders_the_renderer_s_image() {
    let rows = lines(&mut example("cluster"));
    let [_, first, second, bus, _, sha256] = &rows[..] else { panic!("{rows:?}") };
    let (hits, misses) =
        [numbers(first), numbers(second)].iter().fold((0, 0), |sum, row| (sum.0 + row.0, sum.1 + row.1));
    assert!(misses > 0 && hits > 10 * misses, "{rows:?}");
    // Nothing went wrong: a fetch for every miss.
    assert!(bus.starts_with(&format!("{misses} fetches, ")), "{rows:?}");
    assert!(sha256.starts_with("sha256 "), "{rows:?}");
    assert_eq!(rows, lines(&mut example("cluster")), "one seed is one course of events");
}
