//! A run beside an evil node, and what must be so when it is over.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serde_json::Value;
use tempfile::TempDir;

const TOPOLOGY: &str = "tests/data/teapot-64.toml";
/// Every node has tiles of its own, so that the run cannot end before the evil one has done its deed.
const SETS: [&str; 5] = [
    "cluster.nodes=4",
    "image.width=128",
    "image.height=128",
    "run.assignment=interleaved",
    "run.deadlines.tile_seconds=5",
];
/// A fetch for nearly every record, and each of them counted.
pub(crate) const COUNTED: &str = "cluster.local_memory.size=4 KiB";
/// All of the database, and nothing counted.
pub(crate) const WHOLE: &str = "cluster.local_memory.size=all";
pub(crate) const VERIFIED: &str = "run.verify=0.05";
/// For modes that keep a node busy for longer than a tile may take.
pub(crate) const PATIENT: &str = "run.deadlines.tile_seconds=60";
/// For a whole run, on a busy machine: three processes that let the deadline of a tile pass fit many times.
const DEADLINE: Duration = Duration::from_secs(90);
/// From the manager's end to that of its children.
const GRACE: Duration = Duration::from_secs(3);
const REPORT_BYTES_MAX: u64 = 1 << 20;
const LOG_BYTES_MAX: u64 = 2 << 20;

/// The program that plays the evil node too; and the folder of one run after the other.
pub(crate) struct Folder {
    programs: TempDir,
    pub(crate) out: PathBuf,
}

impl Folder {
    pub(crate) fn new() -> Self {
        let programs = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).expect("temporary folder");
        let marti = programs.path().join("marti");
        fs::hard_link(env!("CARGO_BIN_EXE_evil-node"), marti).expect("one file system");
        let out = programs.path().join("out");
        Self { programs, out }
    }

    /// `None`: all are honest. No process may have more than `files` open, unless it asks for more.
    pub(crate) fn start(&self, mode: Option<&str>, files: u32, arguments: &[&str]) -> Child {
        let file = |name: &str| fs::File::create(self.programs.path().join(name)).expect("writable folder");
        let mut command = Command::new("sh");
        command.args(["-c", &format!("ulimit -S -n {files} && exec \"$@\""), "sh"]);
        command.arg(self.programs.path().join("marti")).arg("run").args(arguments);
        command.current_dir(env!("CARGO_MANIFEST_DIR")).env_remove("MARTI_LOG").env_remove("MARTI_EVIL");
        command.envs(mode.map(|mode| ("MARTI_EVIL", mode)));
        command.stdin(Stdio::null()).stdout(file("stdout")).stderr(file("stderr"));
        command.spawn().expect("marti can be started")
    }

    /// Waits until the run is over, and for all of its processes.
    pub(crate) fn end(&self, mut manager: Child) -> Outcome {
        let start = Instant::now();
        let status = loop {
            if let Some(status) = manager.try_wait().expect("our own child") {
                break status;
            }
            if start.elapsed() > DEADLINE {
                kill(Pid::from_raw(manager.id() as i32), Signal::SIGKILL).expect("our own child");
                manager.wait().expect("our own child");
                panic!("still running after {DEADLINE:?}: {}", self.text("out/logs/manager.log"));
            }
            std::thread::sleep(Duration::from_millis(10));
        };
        let start = Instant::now();
        while !self.living().is_empty() {
            assert!(start.elapsed() < GRACE, "left behind: {:?}", self.living());
            std::thread::sleep(Duration::from_millis(10));
        }
        let report = fs::read_to_string(self.out.join("report.json")).ok();
        Outcome {
            status,
            stdout: self.text("stdout"),
            stderr: self.text("stderr"),
            evil_log: self.text("out/logs/node-0.log"),
            report: report.map(|text| serde_json::from_str(&text).expect("a report is JSON")),
        }
    }

    /// Processes of these programs.
    fn living(&self) -> Vec<PathBuf> {
        let processes = fs::read_dir("/proc").expect("Linux has /proc").filter_map(Result::ok);
        let programs = processes.filter_map(|process| fs::read_link(process.path().join("exe")).ok());
        programs.filter(|program| program.starts_with(self.programs.path())).collect()
    }

    fn text(&self, name: &str) -> String {
        String::from_utf8_lossy(&fs::read(self.programs.path().join(name)).unwrap_or_default()).into_owned()
    }
}

/// What a run left behind.
pub(crate) struct Outcome {
    pub(crate) status: ExitStatus,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
    /// The evil node's own.
    pub(crate) evil_log: String,
    pub(crate) report: Option<Value>,
}

/// The options of a run into a folder.
pub(crate) fn options<'a>(out: &'a Path, sets: &[&'a str]) -> Vec<&'a str> {
    let sets = SETS.iter().chain(sets).flat_map(|&set| ["--set", set]);
    [TOPOLOGY, "--out", out.to_str().expect("UTF-8")].into_iter().chain(sets).collect()
}

/// The hash of the image that honest nodes render.
pub(crate) fn right() -> &'static Value {
    static SHA256: OnceLock<Value> = OnceLock::new();
    SHA256.get_or_init(|| {
        let folder = Folder::new();
        let outcome = folder.end(folder.start(None, 20_000, &options(&folder.out, &[WHOLE])));
        assert!(outcome.status.success(), "{}", outcome.stderr);
        outcome.report()["image"]["sha256"].clone()
    })
}

/// A run to its end, and what must be so of any: the evil node did its deed, and nothing of what it says does more than
/// it should.
pub(crate) fn run(mode: &str, sets: &[&str]) -> Outcome {
    run_with_files(mode, 20_000, sets)
}

pub(crate) fn run_with_files(mode: &str, files: u32, sets: &[&str]) -> Outcome {
    let folder = Folder::new();
    let outcome = folder.end(folder.start(Some(mode), files, &options(&folder.out, sets)));
    assert!(outcome.evil_log.contains("evil: "), "{mode}: it did nothing\n{}{}", outcome.evil_log, outcome.stderr);
    let bytes = |name: &str| fs::metadata(folder.out.join(name)).map_or(0, |file| file.len());
    assert!(bytes("report.json") < REPORT_BYTES_MAX, "{mode}: {} bytes of report", bytes("report.json"));
    for log in ["manager", "master", "bus", "display", "node-1"] {
        let log = format!("logs/{log}.log");
        assert!(bytes(&log) < LOG_BYTES_MAX, "{mode}: {} bytes of {log}", bytes(&log));
    }
    let said = [&outcome.stdout, &outcome.stderr, &folder.text("out/logs/manager.log")];
    for text in said.into_iter().map(String::as_str).chain(outcome.incidents()) {
        let controls = |c: char| (c.is_control() && !matches!(c, '\n' | '\r')) || c == '\u{202e}';
        assert!(!text.contains(controls), "{mode}: control characters in {text:.300?}");
    }
    assert!(outcome.stdout.lines().filter(|line| line.starts_with("image ")).count() <= 1, "{mode}: a forged line");
    outcome
}

/// [`run()`] where the image is right, and no process but the evil node is ended.
pub(crate) fn survives(mode: &str, sets: &[&str]) -> Outcome {
    let outcome = run(mode, sets);
    outcome.assert_right(mode);
    outcome
}

/// [`survives`], and the evil node gets no more tiles.
pub(crate) fn finds(mode: &str, sets: &[&str]) -> Outcome {
    let outcome = survives(mode, sets);
    assert!(outcome.is_set_aside(), "{mode}: it is not set aside: {:?}", outcome.incidents());
    outcome
}

impl Outcome {
    pub(crate) fn report(&self) -> &Value {
        self.report.as_ref().unwrap_or_else(|| panic!("there is no report: {}", self.stderr))
    }

    pub(crate) fn incidents(&self) -> Vec<&str> {
        let incidents = self.report.iter().filter_map(|report| report["incidents"].as_array()).flatten();
        incidents.filter_map(|incident| incident["text"].as_str()).collect()
    }

    fn is_set_aside(&self) -> bool {
        self.incidents().iter().any(|text| text.starts_with("node 0 ") && text.contains("is set aside"))
    }

    /// Of nodes 1 to 3, and of the servers: that they died, were killed, or set aside. What they report of others does not count,
    /// nor that the display lacks tiles: an honest node may have done a tile again while the display still had that of a condemned
    /// one, and then took it out.
    fn harmed(&self) -> Vec<&str> {
        let honest = ["node 1", "node 2", "node 3", "the bus", "the master", "the display"];
        let is_harm = |text: &&str| {
            let rest = honest.iter().find_map(|name| text.strip_prefix(name));
            rest.is_some_and(|rest| {
                !rest.starts_with(':') && !text.contains(" disagree about ") && !rest.starts_with(" lacks ")
            })
        };
        self.incidents().into_iter().filter(is_harm).collect()
    }

    pub(crate) fn assert_right(&self, mode: &str) {
        assert_eq!(self.status.code(), Some(0), "{mode}: {}", self.stderr);
        let report = self.report();
        assert_eq!(&report["image"]["sha256"], right(), "{mode}: another image; {:.600?}", self.incidents());
        assert_eq!(report["conservation"]["holds"], true, "{mode}: {}", report["conservation"]);
        assert!(self.harmed().is_empty(), "{mode}: {:?}", self.harmed());
    }

    /// The run failed for this reason, and there is an image all the same.
    pub(crate) fn assert_failed(&self, mode: &str, why: &str) {
        assert_eq!(self.status.code(), Some(1), "{mode}: {}", self.stderr);
        assert!(self.stderr.contains(why), "{mode}: {}", self.stderr);
        assert_eq!(self.report()["status"], "failed", "{mode}");
        let files = self.report()["image"]["files"].as_array().expect("files are a list");
        assert!(!files.is_empty(), "{mode}: no image");
    }
}

/// A test for each mode, of its name: what must be so with each of these options.
macro_rules! modes {
    ($($(#[$doc:meta])* $mode:ident: $($check:ident $([$($set:expr),*])+)+;)+) => {$(
        $(#[$doc])*
        #[test]
        fn $mode() {
            $($($check(stringify!($mode), &[$($set),*]);)+)+
        }
    )+};
}
pub(crate) use modes;
