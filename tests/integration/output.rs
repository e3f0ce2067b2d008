//! The output folder is one run's, and what was there before is never lost.

use std::fs;
use std::io::Write;
use std::net::TcpListener;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;
use nix::sys::stat::Mode;
use nix::unistd::mkfifo;

use crate::command::{TEAPOT, marti, read_report, report_of, run, stderr};
use crate::faults::Running;
use crate::processes::signal;

const SMALL: [&str; 2] = ["image.width=32", "image.height=32"];
const PATIENCE: Duration = Duration::from_secs(120);

/// Names and contents of all files below a folder.
fn contents(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut found = Vec::new();
    let mut rest = vec![folder.to_owned()];
    while let Some(next) = rest.pop() {
        for entry in fs::read_dir(next).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                rest.push(path);
            } else {
                let name = path.strip_prefix(folder).expect("below").to_string_lossy().into_owned();
                found.push((name, fs::read(path).expect("a file")));
            }
        }
    }
    found.sort();
    found
}

fn small_run(out: &Path) -> std::process::Command {
    let mut command = marti();
    command.args(["run", TEAPOT, "--quiet", "--out"]).arg(out);
    command.args(SMALL.iter().flat_map(|set| ["--set", set]));
    command
}

#[test]
fn a_folder_that_a_run_writes_into_is_refused_to_others_and_free_when_it_is_killed() {
    let mut running = Running::start(3);
    let out = running.out.path().to_owned();
    let before = fs::metadata(out.join("tiles")).expect("a journal").len();
    let path = out.to_str().expect("UTF-8");
    for arguments in [&["run", TEAPOT, "--out", path][..], &["run", "--resume", path]] {
        let output = run(arguments);
        assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
        assert_eq!(stderr(&output), format!("error: {path}: another process writes into this folder\n"));
    }
    assert!(fs::metadata(out.join("tiles")).expect("a journal").len() >= before && !out.join("earlier").exists());
    signal(running.manager.id(), Signal::SIGKILL);
    running.end(Duration::from_secs(10));
    let output = run(&["run", "--quiet", "--resume", path]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(out.join("earlier/1/logs/manager.log").exists());
}

#[test]
fn a_run_that_is_refused_leaves_an_earlier_runs_results_as_they_were() {
    let out = tempfile::tempdir().expect("temporary folder");
    report_of(TEAPOT, out.path(), &SMALL);
    let before = contents(out.path());
    let taken = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = taken.local_addr().expect("bound").to_string();
    let refusals: [(&[&str], Option<&str>, i32, &str); 4] = [
        (&[], Some("marti=debug"), 2, "MARTI_LOG is not a level, expected off, error, warn"),
        (&["--health", &address], None, 1, &address),
        (&["--listen", &address], None, 1, &address),
        (&["--set", "scene.file=none.nff"], None, 2, "none.nff"),
    ];
    for (options, filter, code, told) in refusals {
        let mut command = small_run(out.path());
        if let Some(filter) = filter {
            command.env("MARTI_LOG", filter);
        }
        let output = command.args(options).output().expect("marti can be started");
        assert_eq!(output.status.code(), Some(code), "{}", stderr(&output));
        assert!(stderr(&output).contains(told), "{}", stderr(&output));
        assert!(contents(out.path()) == before, "{told}: the folder has changed");
    }
    // What is put aside is what was there.
    let output = small_run(out.path()).output().expect("marti can be started");
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(contents(&out.path().join("earlier/1")) == before);
}

#[test]
fn processes_that_do_not_come_up_leave_an_earlier_runs_results_as_they_were() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let out = folder.path().join("out");
    report_of(TEAPOT, &out, &SMALL);
    let before = contents(&out);
    let topology = folder.path().join("elsewhere.toml");
    let text = fs::read_to_string(out.join("topology.toml")).expect("a topology");
    let hosts = "[[host]]\nname = 'a'\nnodes = 0\n[[host]]\nname = 'b'\nbind = '127.0.0.2'\nlaunch = ['false', '{program}']\nnodes = 1\ndisplay = true\n";
    fs::write(&topology, format!("{text}\n{hosts}")).expect("writable folder");
    let mut command = marti();
    command.args(["run", "--quiet", "--insecure", "--set", "cluster.nodes=1", "--out"]).arg(&out).arg(&topology);
    let output = command.output().expect("marti can be started");
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("the display") && said.contains("out/starting, and what an earlier run left"), "{said}");
    assert_eq!(read_report(&out.join("starting/report.json"))["status"], "failed");
    fs::remove_dir_all(out.join("starting")).expect("its own files");
    assert!(contents(&out) == before);
}

#[test]
fn a_folder_that_no_run_wrote_is_refused_untouched_unless_by_force() {
    let out = tempfile::tempdir().expect("temporary folder");
    fs::write(out.path().join("image.png"), "a photograph").expect("writable folder");
    let before = contents(out.path());
    let output = small_run(out.path()).output().expect("marti can be started");
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert!(
        stderr(&output).contains("is not empty (image.png) and holds nothing that says that a run wrote it"),
        "{}",
        stderr(&output)
    );
    assert!(contents(out.path()) == before);
    let output = small_run(out.path()).arg("--force").output().expect("marti can be started");
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(contents(&out.path().join("earlier/1")) == before);
}

#[test]
fn a_report_of_another_run_is_noticed() {
    let [one, other] = [0, 1].map(|_| tempfile::tempdir().expect("temporary folder"));
    let report = report_of(TEAPOT, one.path(), &SMALL);
    report_of(TEAPOT, other.path(), &["image.width=40", "image.height=40"]);
    fs::copy(other.path().join("report.json"), one.path().join("report.json")).expect("writable folder");
    let output = run(&["run", "--quiet", "--resume", one.path().to_str().expect("UTF-8")]);
    assert!(output.status.success(), "{}", stderr(&output));
    let resumed = read_report(&one.path().join("report.json"));
    assert_eq!(resumed["image"]["sha256"], report["image"]["sha256"]);
    assert_eq!(resumed["tiles"]["resumed"], report["tiles"]["total"]);
}

#[test]
fn a_recording_that_cannot_be_made_whole_fails_the_run_and_the_report_says_so() {
    let mut running = Running::start(3);
    fs::remove_dir_all(running.out.path().join("recording")).expect("our own folder");
    let (status, _) = running.end(PATIENCE);
    assert_eq!(status.code(), Some(1), "{}", running.stderr());
    let report = running.report();
    assert_eq!(report["status"], "failed");
    let error = report["error"].as_str().unwrap_or_default();
    assert!(error.contains("the bus") && error.contains("bus.arrows"), "{error}");
    assert_eq!(report["tiles"]["done"], report["tiles"]["total"], "the image is kept");
}

#[test]
fn what_is_no_regular_file_is_not_waited_for() {
    let out = tempfile::tempdir().expect("temporary folder");
    report_of(TEAPOT, out.path(), &SMALL);
    let path = out.path().to_str().expect("UTF-8");
    let replaced = |name: &str| {
        fs::remove_file(out.path().join(name)).expect("a file of the run");
        mkfifo(&out.path().join(name), Mode::S_IRWXU).expect("a pipe");
    };
    let start = Instant::now();
    // Not a report: the run goes on, and what it finds done it takes.
    replaced("report.json");
    let output = run(&["run", "--quiet", "--resume", path]);
    assert!(output.status.success(), "{}", stderr(&output));
    replaced("report.json");
    replaced("tiles");
    let output = run(&["run", "--quiet", "--resume", path]);
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert!(stderr(&output).contains("tiles: is no journal of tiles"), "{}", stderr(&output));
    replaced("topology.toml");
    let output = run(&["run", "--quiet", "--resume", path]);
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert!(stderr(&output).contains("topology.toml: is not a regular file"), "{}", stderr(&output));
    assert!(start.elapsed() < PATIENCE);
}

#[test]
fn outputs_that_are_no_files_are_written_to_and_stay() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = |name: &str| folder.path().join(name);
    let expected = run(&["scene", "gears"]).stdout;
    symlink("/dev/stdout", path("out")).expect("a link");
    let output = marti().args(["scene", "gears", "-o"]).arg(path("out")).output().expect("marti can be started");
    assert!(output.status.success() && output.stdout == expected, "{}", stderr(&output));
    // What it is appended to stays.
    let mut log = fs::File::create(path("log")).expect("writable folder");
    log.write_all(b"before\n").expect("writable folder");
    let appended = fs::File::options().append(true).open(path("log")).expect("there");
    let status = marti().args(["scene", "gears", "-o", "/dev/stdout"]).stdout(Stdio::from(appended)).status();
    assert!(status.expect("marti can be started").success());
    assert_eq!(fs::read(path("log")).expect("there"), [b"before\n", &expected[..]].concat());
}

#[test]
fn a_terminal_that_is_closed_ends_a_run_like_any_signal_unless_it_is_ignored() {
    let mut running = Running::start(3);
    signal(running.manager.id(), Signal::SIGHUP);
    let (status, _) = running.end(Duration::from_secs(20));
    assert_eq!(status.code(), Some(129), "{}", running.stderr());
    assert_eq!(running.report()["status"], "interrupted");
    running.assert_nobody_lives();

    let out = tempfile::tempdir().expect("temporary folder");
    let marti = env!("CARGO_BIN_EXE_marti");
    let script = format!("trap '' HUP; {marti} run {TEAPOT} --quiet --out \"$1\" & sleep 0.2; kill -HUP $!; wait $!");
    let mut shell = std::process::Command::new("sh");
    shell.current_dir(env!("CARGO_MANIFEST_DIR")).args(["-c", &script, "sh"]).arg(out.path());
    assert_eq!(shell.status().expect("a shell").code(), Some(0));
}

#[test]
fn no_word_is_shown_of_a_file_that_a_scene_names() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let (scene, image) = (folder.path().join("scene.obj"), folder.path().join("out.png"));
    fs::write(folder.path().join("secret"), "root:$6$salt$hash:19000:0\n").expect("writable folder");
    mkfifo(&folder.path().join("pipe"), Mode::S_IRWXU).expect("a pipe");
    // The pipe is not waited for.
    for library in ["secret", "pipe"] {
        fs::write(&scene, format!("mtllib {library}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")).expect("writable folder");
        let paths = [&scene, &image].map(|path| path.to_str().expect("UTF-8"));
        let output = run(&["render", paths[0], "--size", "8x8", "-o", paths[1]]);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(0), "{said}");
        assert!(!said.contains("root") && !String::from_utf8_lossy(&output.stdout).contains("root"), "{said}");
    }
}
