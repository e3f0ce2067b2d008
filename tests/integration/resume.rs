//! A run whose manager is killed goes on from the display's journal.

use std::fs;
use std::path::Path;
use std::time::Duration;

use nix::sys::signal::Signal;

use crate::command::{TEAPOT, marti, number, read_report, report_of, run, stderr};
use crate::faults::{Running, SLOW, decodes_as_png};
use crate::processes::signal;

fn resume(out: &Path, options: &[&str]) -> std::process::Output {
    marti().args(["run", "--quiet", "--resume"]).arg(out).args(options).output().expect("marti can be started")
}

/// Kills the manager once the journal has so many bytes.
fn kill_at(bytes: u64, options: &[&str]) -> Running {
    let mut running = Running::start_with(3, options);
    let journal = running.out.path().join("tiles");
    while fs::metadata(&journal).map_or(0, |file| file.len()) < bytes {
        std::thread::sleep(Duration::from_millis(1));
    }
    signal(running.manager.id(), Signal::SIGKILL);
    running.end(Duration::from_secs(10));
    running
}

#[test]
fn a_killed_managers_run_goes_on_and_gives_the_same_image() {
    let out = tempfile::tempdir().expect("temporary folder");
    let options = SLOW.map(|set| ["--set", set]).concat();
    let undisturbed = report_of(TEAPOT, out.path(), &SLOW);
    // 160x160 pixels of 12 bytes in 400 tiles.
    for bytes in [0, 30_000, 200_000] {
        let running = kill_at(bytes, &options);
        let output = resume(running.out.path(), &[]);
        assert!(output.status.success(), "{bytes}: {}", stderr(&output));
        let report = running.report();
        assert_eq!(report["image"]["sha256"], undisturbed["image"]["sha256"], "{bytes}");
        assert_eq!(report["conservation"]["holds"], true, "{}", report["conservation"]);
        // A record is 32 bytes and a tile of 8x8 pixels.
        let resumed = number(&report, "tiles.resumed");
        assert!(resumed >= bytes / (32 + 8 * 8 * 12), "{bytes}: {resumed}");
        let accepted =
            report["nodes"].as_array().expect("a list").iter().map(|node| node["tiles"].as_u64().unwrap_or(0));
        assert_eq!(accepted.sum::<u64>() + resumed, 400, "only what the journal lacks is rendered");
        assert!(decodes_as_png(&running.out.path().join("image.png")));
        assert!(running.out.path().join("earlier/1/recording").is_dir());
    }
}

#[test]
fn a_finished_run_is_resumed_at_once_and_nothing_changes() {
    let out = tempfile::tempdir().expect("temporary folder");
    let before = report_of(TEAPOT, out.path(), &["image.width=32", "image.height=32"]);
    let output = resume(out.path(), &[]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(read_report(&out.path().join("report.json")), before);
}

#[test]
fn an_empty_journal_starts_over_and_a_torn_tail_is_dropped_and_told() {
    let out = tempfile::tempdir().expect("temporary folder");
    let before = report_of(TEAPOT, out.path(), &["image.width=64", "image.height=64"]);
    let journal = out.path().join("tiles");
    let whole = fs::read(&journal).expect("a journal");
    for (kept, resumed, is_torn) in [(0, 0, false), (whole.len() - 5, 63, true)] {
        fs::write(&journal, &whole[..kept]).expect("our own file");
        fs::remove_file(out.path().join("image.png")).expect("an image");
        let output = resume(out.path(), &[]);
        assert!(output.status.success(), "{}", stderr(&output));
        let report = read_report(&out.path().join("report.json"));
        assert_eq!(report["image"]["sha256"], before["image"]["sha256"]);
        assert_eq!(number(&report, "tiles.resumed"), resumed);
        let incidents = report["incidents"].to_string();
        assert_eq!(incidents.contains("tiles: dropped the last 795 bytes"), is_torn, "{incidents}");
    }
}

#[test]
fn what_cannot_be_resumed_is_named() {
    let out = tempfile::tempdir().expect("temporary folder");
    let path = out.path().to_str().expect("UTF-8");
    let output = run(&["run", "--resume", path]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("topology.toml"), "{}", stderr(&output));
    report_of(TEAPOT, out.path(), &["image.width=32", "image.height=32"]);
    fs::remove_file(out.path().join("image.png")).expect("an image");
    for (set, expected) in [
        ("image.width=48", "tiles: is the journal of another image: 32x32 pixels in tiles of 8x8, expected 48x32"),
        ("image.depth=1", "scene and settings have the fingerprint"),
        ("image.terminator=soft", "scene and settings have the fingerprint"),
    ] {
        let output = run(&["run", "--resume", path, "--set", set]);
        assert_eq!(output.status.code(), Some(2), "{set}");
        assert!(stderr(&output).contains(expected), "{}", stderr(&output));
    }
    // Who renders it does not matter.
    let output = run(&["run", "--quiet", "--resume", path, "--set", "cluster.nodes=1"]);
    assert!(output.status.success(), "{}", stderr(&output));
}
