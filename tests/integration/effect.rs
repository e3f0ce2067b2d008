//! What an option or a key cannot do is refused or said; what was done so far is kept when a signal comes.

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;

use crate::command::{TEAPOT, marti, read_report, run, stderr};
use crate::faults::{Running, decodes_as_png};
use crate::processes::signal;

fn node(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_marti-node"));
    for variable in ["MARTI_JOIN", "MARTI_KEYS", "MARTI_TOKEN", "MARTI_PATIENCE", "MARTI_HOST"] {
        command.env_remove(variable);
    }
    command.args(arguments).stdin(Stdio::null()).output().expect("the node can be started")
}

#[test]
fn options_of_joining_are_refused_where_nothing_is_joined() {
    for option in [
        ["--patience", "5"],
        ["--token", "x"],
        ["--keys", "x"],
        ["--host", "x"],
        ["--interface", "127.0.0.1"],
        ["--advertise", "x"],
        ["--health", "127.0.0.1:0"],
    ] {
        let output = node(&option);
        assert_eq!(output.status.code(), Some(2), "{option:?}");
        let expected = format!("{} has no effect without --join, expected both or neither", option[0]);
        assert!(stderr(&output).contains(&expected), "{}", stderr(&output));
    }
    let both = node(&["--join", "127.0.0.1:1", "--keys", "x", "--token", "y"]);
    assert_eq!(both.status.code(), Some(2));
    assert!(stderr(&both).contains("--token has no effect beside --keys"), "{}", stderr(&both));
    let bus =
        Command::new(env!("CARGO_BIN_EXE_marti-bus")).args(["--recording", "x", "--join", "127.0.0.1:1"]).output();
    assert_eq!(bus.expect("the bus can be started").status.code(), Some(2));
}

/// Whatever the environment has, as processes that a run starts inherit it.
#[test]
fn the_environment_of_a_process_that_is_spawned_may_have_options_of_joining() {
    let out = tempfile::tempdir().expect("a folder");
    let mut command = marti();
    command.args(["run", TEAPOT, "--quiet", "--out"]).arg(out.path());
    let output = command.envs([("MARTI_TOKEN", "/nowhere"), ("MARTI_PATIENCE", "3")]).output().expect("it starts");
    assert!(output.status.success(), "{}", stderr(&output));
}

#[test]
fn keys_that_cannot_be_used_end_a_process_at_once() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("token");
    fs::write(&file, "no token").expect("a file");
    let file = file.to_str().expect("text");
    let start = Instant::now();
    for (option, path, expected) in [("--keys", "/nowhere/keys", "/nowhere/keys"), ("--token", file, "others can read")]
    {
        let output = node(&["--join", "127.0.0.1:1", option, path, "--patience", "60"]);
        assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
        assert!(stderr(&output).contains(expected), "{}", stderr(&output));
    }
    assert!(start.elapsed() < Duration::from_secs(20));
}

#[test]
fn options_without_effect_are_refused() {
    for (arguments, expected) in [
        (&["render", "teapot:2", "--mailbox", "off"][..], "--mailbox is of the single kernel"),
        (&["render", "teapot:2", "--kernel", "single", "--simd", "scalar"], "--simd is of packets"),
        (&["verify", "teapot:2", "--rays", "0"], "0 is not in 1.."),
        (&["replay", "Cargo.toml", "-o", "x.txt"], "--out has no effect on a trace"),
        (&["replay", "out", "--heat-map", "misses", "-o", "x.jpg"], "expected a name ending in .png"),
        (
            &["replay", "tests/data", "--export", "csv", "-o", "tests/data/teapot-64.toml"],
            "the command reads this file",
        ),
        (&["replay", "out", "--pace", "recorded"], "--to-bus"),
    ] {
        let output = run(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(stderr(&output).contains(expected), "{}", stderr(&output));
    }
}

#[test]
fn what_has_no_effect_on_a_live_run_is_said() {
    let out = tempfile::tempdir().expect("a folder");
    let run = |more: &[&str]| {
        let mut command = marti();
        let output = command.args(["run", TEAPOT, "--force", "--out"]).arg(out.path()).args(more).output();
        let output = output.expect("marti can be started");
        assert!(output.status.success(), "{}", stderr(&output));
        stderr(&output)
    };
    let said = run(&["--set", "cluster.bus.width=8", "--insecure"]);
    assert!(said.contains("note: cluster.bus.width change nothing of a live run"), "{said}");
    assert!(said.contains("--insecure has no effect: no other machine can reach the addresses of this run"), "{said}");
    let said = run(&["--set", "cluster.bus.arbiter=\"round_robin\""]);
    assert!(!said.contains("note:") && !said.contains("warning"), "{said}");
}

#[test]
fn an_interrupted_run_names_the_command_that_goes_on_with_it() {
    let mut running = Running::start(3);
    running.interrupt();
    let (status, _) = running.end(Duration::from_secs(30));
    assert_eq!(status.code(), Some(130));
    let expected = format!("interrupted; `marti run --resume {}` goes on with it", running.out.path().display());
    assert!(running.stderr().contains(&expected), "{}", running.stderr());
}

#[test]
fn a_rendering_that_a_signal_ends_is_kept_as_far_as_it_is() {
    for (sent, code, said) in [
        (Signal::SIGINT, 130, "interrupted"),
        (Signal::SIGTERM, 143, "terminated"),
        (Signal::SIGHUP, 129, "the terminal"),
    ] {
        let folder = tempfile::tempdir().expect("a folder");
        let (image, report) = (folder.path().join("x.png"), folder.path().join("x.json"));
        let mut command = marti();
        command
            .args(["render", "teapot:12", "--size", "3200x3200", "--threads", "1", "--kernel", "single", "-q", "-o"])
            .arg(&image);
        let child = command.arg("--report").arg(&report).stderr(Stdio::piped()).spawn().expect("marti can be started");
        // Longer than reading the scene and less than rendering it.
        std::thread::sleep(Duration::from_millis(1500));
        signal(child.id(), sent);
        let output = child.wait_with_output().expect("it ends");
        assert_eq!(output.status.code(), Some(code), "{}", stderr(&output));
        assert!(stderr(&output).contains(said), "{}", stderr(&output));
        assert!(stderr(&output).contains(" of 10000 tiles"), "{}", stderr(&output));
        assert!(decodes_as_png(&image));
        assert_eq!(read_report(Path::new(&report))["status"], "interrupted");
    }
}
