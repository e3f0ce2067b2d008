//! Processes die in the middle of a run: whoever it is, it is replaced and the image is the same; a signal ends the run
//! in time, and nothing stays behind.

use std::fs;
use std::path::Path;
use std::process::{Child, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;
use serde_json::Value;

use crate::command::{TEAPOT, marti, number, read_report, report_of};
use crate::processes::{children, lives, signal};

/// Long enough for a test to interfere: a fetch for nearly every record.
pub(crate) const SLOW: [&str; 4] =
    ["image.width=160", "image.height=160", "cluster.nodes=3", "cluster.local_memory.size=4 KiB"];
/// Manager's patience with a dead server, and some for a busy machine.
const PATIENCE: Duration = Duration::from_secs(10);

/// A run in the middle of its work.
pub(crate) struct Running {
    pub(crate) manager: Child,
    children: Vec<(String, u32)>,
    pub(crate) out: tempfile::TempDir,
    stderr: tempfile::NamedTempFile,
}

impl Running {
    pub(crate) fn start(nodes: usize) -> Self {
        Self::start_with(nodes, &SLOW.map(|set| ["--set", set]).concat())
    }

    /// With so many nodes, by these options.
    pub(crate) fn start_with(nodes: usize, options: &[&str]) -> Self {
        let out = tempfile::tempdir().expect("temporary folder");
        let mut command = marti();
        command.args(["run", TEAPOT, "--quiet", "--out"]).arg(out.path()).args(options);
        let stderr = tempfile::NamedTempFile::new().expect("temporary file");
        let said = stderr.reopen().expect("our own file");
        let manager = command.stdout(Stdio::null()).stderr(said).spawn().expect("marti can be started");
        let children = children(manager.id(), 3 + nodes, PATIENCE);
        assert_eq!(children.len(), 3 + nodes, "{children:?}");
        let running = Self { manager, children, out, stderr };
        running.wait_for_rows();
        running
    }

    /// Until the bus has logged something: nodes are at work.
    fn wait_for_rows(&self) {
        self.wait_for(|_| true, 64 << 10);
    }

    /// Until recorded files of such names have so many bytes together.
    pub(crate) fn wait_for(&self, is_counted: impl Fn(&str) -> bool, bytes: u64) {
        let recording = self.out.path().join("recording");
        let written = || {
            let files = fs::read_dir(&recording).into_iter().flatten().flatten();
            let counted = files.filter(|file| is_counted(&file.file_name().to_string_lossy()));
            counted.filter_map(|file| Some(file.metadata().ok()?.len())).sum::<u64>()
        };
        let start = Instant::now();
        while written() <= bytes {
            assert!(start.elapsed() < PATIENCE, "nothing is recorded");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    pub(crate) fn pids(&self, name: &str) -> Vec<u32> {
        self.children.iter().filter(|(child, _)| child == name).map(|(_, pid)| *pid).collect()
    }

    pub(crate) fn interrupt(&self) {
        signal(self.manager.id(), Signal::SIGINT);
    }

    /// How the manager ended, and after how long.
    pub(crate) fn end(&mut self, patience: Duration) -> (ExitStatus, Duration) {
        let start = Instant::now();
        loop {
            if let Some(status) = self.manager.try_wait().expect("our own child") {
                return (status, start.elapsed());
            }
            if start.elapsed() > patience {
                signal(self.manager.id(), Signal::SIGKILL);
                panic!("still running after {patience:?}: {}", self.stderr());
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    pub(crate) fn stderr(&self) -> String {
        fs::read_to_string(self.stderr.path()).unwrap_or_default()
    }

    pub(crate) fn report(&self) -> Value {
        read_report(&self.out.path().join("report.json"))
    }

    pub(crate) fn assert_nobody_lives(&self) {
        let left: Vec<_> = self.children.iter().filter(|(_, pid)| lives(*pid)).collect();
        assert!(left.is_empty(), "left behind: {left:?}");
    }
}

pub(crate) fn decodes_as_png(path: &Path) -> bool {
    fs::read(path)
        .is_ok_and(|bytes| bytes.starts_with(b"\x89PNG\r\n\x1a\n") && bytes.ends_with(b"IEND\xae\x42\x60\x82"))
}

#[test]
fn nodes_that_are_killed_are_replaced_and_the_image_is_the_same() {
    let out = tempfile::tempdir().expect("temporary folder");
    let undisturbed = report_of(TEAPOT, out.path(), &SLOW);
    let mut running = Running::start(3);
    for pid in &running.pids("marti-node")[..2] {
        signal(*pid, Signal::SIGKILL);
        std::thread::sleep(Duration::from_millis(30));
    }
    let (status, _) = running.end(Duration::from_secs(120));
    assert!(status.success(), "{status}: {}", running.stderr());
    let report = running.report();
    assert_eq!(report["image"]["sha256"], undisturbed["image"]["sha256"]);
    assert_eq!(report["rays"], undisturbed["rays"], "counts are those of accepted attempts");
    assert_eq!(report["conservation"]["holds"], true, "{}", report["conservation"]);
    assert!(number(&report, "tiles.reissued") >= 1, "{}", report["tiles"]);
    let incidents = report["incidents"].as_array().expect("incidents are a list");
    assert!(incidents.len() >= 2 && incidents[0]["text"].as_str().is_some_and(|text| text.contains("SIGKILL")));
    running.assert_nobody_lives();
}

#[test]
fn a_node_that_falls_silent_is_killed_and_replaced() {
    let mut running = Running::start(3);
    signal(running.pids("marti-node")[1], Signal::SIGSTOP);
    let (status, _) = running.end(Duration::from_secs(120));
    assert!(status.success(), "{status}: {}", running.stderr());
    running.assert_nobody_lives();
}

#[test]
fn a_server_that_dies_is_replaced_and_the_image_is_the_same() {
    let out = tempfile::tempdir().expect("temporary folder");
    let undisturbed = report_of(TEAPOT, out.path(), &SLOW);
    for name in ["bus", "master", "display"] {
        let mut running = Running::start(3);
        signal(running.pids(&format!("marti-{name}"))[0], Signal::SIGKILL);
        let (status, _) = running.end(Duration::from_secs(120));
        assert!(status.success(), "{name}: {}", running.stderr());
        let report = running.report();
        assert_eq!(report["image"]["sha256"], undisturbed["image"]["sha256"], "{name}");
        assert_eq!(report["rays"], undisturbed["rays"], "{name}: counts are those of accepted attempts");
        let conservation = &report["conservation"];
        assert_eq!(conservation["holds"], true, "{name}: {conservation}");
        assert_eq!(conservation["unverifiable"].as_array().map_or(0, Vec::len), usize::from(name != "display"));
        let died = format!("the {name} died of signal 9 (SIGKILL)");
        let incidents = report["incidents"].as_array().expect("incidents are a list");
        assert!(incidents.iter().any(|incident| incident["text"] == died), "{incidents:?}");
        // The log of the former bus stays beside that of its successor.
        let logs = running.out.path().join("recording");
        assert_eq!(logs.join("epoch-1/bus.arrows").exists(), name != "display", "{name}");
        running.assert_nobody_lives();
    }
}

#[test]
fn a_signal_ends_the_run_within_two_seconds_and_keeps_the_partial_image() {
    for (sent, code) in [(Signal::SIGINT, 130), (Signal::SIGTERM, 143)] {
        let mut running = Running::start(3);
        signal(running.manager.id(), sent);
        let (status, took) = running.end(PATIENCE);
        assert_eq!(status.code(), Some(code), "{}", running.stderr());
        assert!(took < Duration::from_secs(2), "{sent}: {took:?}");
        assert!(decodes_as_png(&running.out.path().join("image.png")), "{sent}");
        let report = running.report();
        assert_eq!(report["status"], "interrupted");
        assert_eq!(report["conservation"]["holds"], true, "{}", report["conservation"]);
        assert!(number(&report, "tiles.done") < number(&report, "tiles.total"));
        running.assert_nobody_lives();
    }
}

#[test]
fn a_manager_that_is_killed_leaves_no_child_for_more_than_three_seconds() {
    let mut running = Running::start(3);
    signal(running.manager.id(), Signal::SIGKILL);
    running.end(PATIENCE);
    let start = Instant::now();
    while running.children.iter().any(|(_, pid)| lives(*pid)) {
        assert!(start.elapsed() < Duration::from_secs(3), "{:?}", running.children);
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn one_file_plays_all_roles_and_the_others_only_name_it() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let run = |program: &str, arguments: &[&str]| {
        let mut command = std::process::Command::new(folder.path().join(program));
        command.args(arguments).current_dir(folder.path()).stdin(std::process::Stdio::null());
        let output = command.output().expect("the copy can be started");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    fs::copy(env!("CARGO_BIN_EXE_marti-node"), folder.path().join("marti-node")).expect("it can be copied");
    let (code, stderr) = run("marti-node", &[]);
    assert_eq!(code, Some(1), "{stderr}");
    assert!(stderr.contains("/marti: ") && stderr.contains("belong in one folder"), "{stderr}");

    fs::copy(env!("CARGO_BIN_EXE_marti"), folder.path().join("marti")).expect("it can be copied");
    let (code, stderr) = run("marti-node", &["--host", "x"]);
    assert_eq!(code, Some(2), "{stderr}");
    assert!(stderr.contains("--host has no effect without --join") && stderr.contains("Usage: marti node"), "{stderr}");
    fs::remove_file(folder.path().join("marti-node")).expect("it is there");
    let teapot = format!("{}/{TEAPOT}", env!("CARGO_MANIFEST_DIR"));
    let (code, stderr) =
        run("marti", &["run", &teapot, "--set", "image.width=32", "--set", "image.height=32", "--out", "out"]);
    assert_eq!(code, Some(0), "{stderr}");
}
