//! `marti run --chaos`: nodes are killed, stopped and cut off in the middle of a run, and the image is the same.

use std::process::Output;
use std::sync::OnceLock;

use serde_json::Value;

use crate::command::{TEAPOT, marti, number, read_report, report_of, stderr};

/// Long enough for a fault to be felt: a fetch for nearly every record.
const SLOW: [&str; 4] = ["image.width=160", "image.height=160", "cluster.nodes=3", "cluster.local_memory.size=4 KiB"];

fn run_with(chaos: &str, sets: &[&str]) -> (Output, Option<Value>) {
    let out = tempfile::tempdir().expect("temporary folder");
    let mut command = marti();
    command.args(["run", TEAPOT, "--quiet", "--chaos", chaos, "--out"]).arg(out.path());
    command.args(sets.iter().flat_map(|set| ["--set", set]));
    let output = command.output().expect("marti can be started");
    let report = out.path().join("report.json");
    (output, report.is_file().then(|| read_report(&report)))
}

/// The hash of the image without faults.
fn undisturbed() -> &'static Value {
    static SHA256: OnceLock<Value> = OnceLock::new();
    SHA256.get_or_init(|| {
        let out = tempfile::tempdir().expect("temporary folder");
        report_of(TEAPOT, out.path(), &SLOW)["image"]["sha256"].clone()
    })
}

fn incidents(report: &Value) -> Vec<&str> {
    let incidents = report["incidents"].as_array().expect("incidents are a list");
    incidents.iter().filter_map(|incident| incident["text"].as_str()).collect()
}

/// The report of a run that a fault does not harm; `told` is what its incidents have to say, each.
fn survives(chaos: &str, sets: &[&str], told: &[&str]) -> Value {
    let (output, report) = run_with(chaos, &[&SLOW, sets].concat());
    assert!(output.status.success(), "{chaos}: {:?}\n{}", output.status, stderr(&output));
    let report = report.expect("a report");
    assert_eq!(&report["image"]["sha256"], undisturbed(), "{chaos}");
    assert_eq!(report["conservation"]["holds"], true, "{chaos}: {}", report["conservation"]);
    assert_eq!(number(&report, "tiles.done"), number(&report, "tiles.total"), "{chaos}");
    for told in told {
        assert!(incidents(&report).iter().any(|text| text.contains(told)), "{told}: {:?}", incidents(&report));
    }
    report
}

#[test]
fn nodes_are_killed() {
    let report = survives(
        "kill node 2@10%; kill node 0@20%; kill node@0.2s; seed=7",
        &[],
        &["chaos: node 2 is killed", "chaos: node 0 is killed", "node 2 died of signal 9 (SIGKILL)"],
    );
    assert_eq!(report["chaos"]["schedule"], "kill node 2@10%; kill node 0@20%; kill node 0@0.2s");
    assert_eq!(number(&report, "chaos.carried_out"), 3);
    assert!(number(&report, "tiles.reissued") >= 1, "{}", report["tiles"]);
    assert!(report["chaos"]["longest_wait_seconds"].as_f64().is_some_and(|seconds| seconds > 0.0));
}

#[test]
fn a_node_that_stops_for_longer_than_its_heartbeat_is_replaced() {
    let report = survives(
        "stop node 1@20% for 30s",
        &["run.deadlines.heartbeat_seconds=0.5"],
        &["chaos: node 1 is stopped for 30s", "node 1 was silent for more than 0.5 s"],
    );
    assert!(report["seconds"]["total"].as_f64().is_some_and(|seconds| seconds < 20.0), "nobody waited for it");
}

#[test]
fn a_node_that_stops_for_a_moment_goes_on() {
    let report = survives("stop node 1@20% for 0.2s", &[], &["chaos: node 1 is stopped for 0.2s"]);
    assert_eq!(incidents(&report).len(), 1, "{:?}", incidents(&report));
}

#[test]
fn a_node_that_is_cut_off_for_longer_than_its_heartbeat_is_replaced() {
    let report = survives(
        "cut node 2@20% for 1.5s",
        &["run.deadlines.heartbeat_seconds=0.5"],
        &["chaos: node 2 is cut off for 1.5s", "node 2 was silent for more than 0.5 s"],
    );
    assert!(report["seconds"]["total"].as_f64().is_some_and(|seconds| seconds < 20.0), "nobody waited for it");
}

#[test]
fn a_node_that_is_cut_off_for_a_moment_goes_on() {
    let report =
        survives("cut node 0@20% for 0.3s; cut node 0@50% for 0.3s", &[], &["chaos: node 0 is cut off for 0.3s"]);
    assert_eq!(incidents(&report).len(), 2, "{:?}", incidents(&report));
}

#[test]
fn a_run_does_not_wait_for_one_that_is_cut_off_at_its_end() {
    let report = survives(
        "cut node 1@95% for 60s",
        &["run.deadlines.heartbeat_seconds=0.5"],
        &["chaos: node 1 is cut off for 60s"],
    );
    assert!(report["seconds"]["total"].as_f64().is_some_and(|seconds| seconds < 20.0), "nobody waited for it");
}

#[test]
fn servers_are_killed() {
    for (server, name) in [("bus", "the bus"), ("master", "the master"), ("display", "the display")] {
        let told = [format!("chaos: {name} is killed"), format!("{name} died of signal 9 (SIGKILL)")];
        survives(&format!("kill {server}@30%"), &[], &told.each_ref().map(String::as_str));
    }
}

#[test]
fn servers_are_cut_off_and_stopped_for_a_moment() {
    for server in ["bus", "master", "display"] {
        survives(&format!("cut {server}@20% for 0.3s; stop {server}@60% for 0.3s"), &[], &["is cut off", "is stopped"]);
    }
}

#[test]
fn a_node_that_is_corrupted_is_found_out() {
    survives("corrupt node 1@10%", &["run.verify=0.02"], &["chaos: node 1 is corrupted"]);
}

#[test]
fn a_node_that_is_corrupted_gives_another_image_where_nobody_compares() {
    let (output, report) = run_with("corrupt node 1@10%", &[&SLOW[..], &["run.verify=0"]].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    let report = report.expect("a report");
    assert_ne!(&report["image"]["sha256"], undisturbed(), "nobody compares");
    assert_eq!(incidents(&report), ["chaos: node 1 is corrupted"]);
}

#[test]
fn what_did_not_come_to_pass_is_told() {
    let report = survives("kill node 0@3600s", &[], &["chaos: `kill node 0@3600s` did not come to pass"]);
    assert_eq!(number(&report, "chaos.carried_out"), 0);
}

#[test]
fn a_bad_schedule_is_refused_before_anything_is_started() {
    for (chaos, told) in [
        ("kill nod@1%", "column 6: expected bus, master, node or display, found `nod@1%`"),
        ("kill manager@1%", "column 6: the manager brings about the faults and cannot watch its own"),
        ("kill node 3@1%", "--chaos: `kill node 3@1%`: expected a node from 0 to 2"),
    ] {
        let (output, report) = run_with(chaos, &SLOW);
        assert_eq!(output.status.code(), Some(2), "{chaos}");
        assert!(stderr(&output).contains(told), "{chaos}: {}", stderr(&output));
        assert!(report.is_none());
    }
}
