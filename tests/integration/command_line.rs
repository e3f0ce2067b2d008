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

#[test]
fn a_slip_of_the_keyboard_is_understood() {
    for (typed, meant) in [("rn", "'run'"), ("chek", "'check'")] {
        let output = run(&[typed, "x.toml"]);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(meant), "{said}");
    }
}

#[test]
fn key_words_have_colours_where_they_are_wanted() {
    const ESCAPE: char = '\u{1b}';
    for (arguments, has_colours) in [
        (&["check", "none.toml"][..], false),
        (&["check", "none.toml", "--color", "always"], true),
        (&["--color=never", "check", "none.toml"], false),
        // What the command line itself is refused with is in colour, too.
        (&["rn", "--color", "always"], true),
        (&["rn", "--color", "never"], false),
    ] {
        let output = marti().args(arguments).env_remove("CLICOLOR_FORCE").output().expect("marti can be started");
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert_eq!(said.contains(ESCAPE), has_colours, "{arguments:?}: {said}");
    }
}

#[test]
fn results_are_json_and_csv_where_that_is_asked_for() {
    let json = |arguments: &[&str]| -> serde_json::Value {
        let output = run(arguments);
        assert!(output.status.success(), "{}", stderr(&output));
        serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{arguments:?}: {error}"))
    };
    let check = json(&["check", TEAPOT, "--set", "run.assignment=on-demand", "--format", "json"]);
    assert_eq!(check["run"]["assignment"], "on_demand", "{check}");
    for option in [&["--format", "json"][..], &["--json"]] {
        assert!(json(&[&["inspect", "gears:1"][..], option].concat())["sections"].is_array());
        let verified = json(&[&["verify", "gears:1", "--rays", "100"][..], option].concat());
        assert_eq!(verified["kernels"][0]["kernel"], "single", "{verified}");
    }
    let csv = run(&["verify", "gears:1", "--rays", "100", "--format", "csv"]);
    let csv = String::from_utf8_lossy(&csv.stdout);
    assert!(csv.starts_with("kernel,aimed_at,rays,hits,agreeing,lost,false,"), "{csv}");
    let quiet = run(&["verify", "gears:1", "--rays", "100", "--quiet"]);
    assert_eq!((quiet.status.code(), quiet.stdout.len()), (Some(0), 0));
}
