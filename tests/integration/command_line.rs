//! What `marti` says and exits with before anything runs.

use std::io::Read;
use std::process::Stdio;

use crate::command::{TEAPOT, marti, run, stderr};

#[test]
fn a_check_runs_nothing() {
    let output = run(&["check", TEAPOT, "--set", "cluster.nodes=3"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(said.contains("processes     7: manager, bus, master, display and 3 nodes"), "{said}");
}

#[test]
fn a_reader_that_leaves_early_is_no_failure() {
    let mut command = marti();
    let child = command.args(["schema", "topology"]).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
    let mut child = child.expect("marti can be started");
    drop(child.stdout.take());
    let mut said = String::new();
    child.stderr.take().expect("a pipe").read_to_string(&mut said).expect("text");
    let status = child.wait().expect("it ends");
    assert_eq!((status.code(), said.as_str()), (Some(0), ""));
}
