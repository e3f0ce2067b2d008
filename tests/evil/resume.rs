//! Runs that end early beside an evil node, and are resumed without it.

use std::fs;
use std::process::Child;
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

use crate::run::{COUNTED, Folder, WHOLE, options, right};

const FILES: u32 = 20_000;
const PATIENCE: Duration = Duration::from_secs(30);

fn wait_for(what: &str, is_so: impl Fn() -> bool) {
    let start = Instant::now();
    while !is_so() {
        assert!(start.elapsed() < PATIENCE, "{what} does not come");
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn signal(manager: &Child, signal: Signal) {
    kill(Pid::from_raw(manager.id() as i32), signal).expect("our own child");
}

/// Resumes a run to its end, all nodes honest.
fn resume(folder: &Folder) {
    let out = folder.out.to_str().expect("UTF-8");
    let outcome = folder.end(folder.start(None, FILES, &["--resume", out]));
    assert_eq!(outcome.status.code(), Some(0), "{}", outcome.stderr);
    assert_eq!(&outcome.report()["image"]["sha256"], right(), "{:?}", outcome.incidents());
}

/// Wrong tiles of a process that nobody has found out yet are in the journal when the manager is killed.
#[test]
fn greylater_and_resumed() {
    let folder = Folder::new();
    let verified = options(&folder.out, &[COUNTED, "run.verify=0.001"]);
    let manager = folder.start(Some("greylater"), FILES, &verified);
    // Half of the image, of which the evil node has done a quarter.
    let journal = folder.out.join("tiles");
    wait_for("half of the image", || fs::metadata(&journal).is_ok_and(|file| file.len() > 128 * 128 * 12 / 2));
    signal(&manager, Signal::SIGKILL);
    let killed = folder.end(manager);
    assert!(killed.evil_log.contains("evil: sends other pixels"), "{}", killed.evil_log);
    assert!(killed.report.is_none(), "it was over before it was killed");
    resume(&folder);
}

/// A process is found out, and the run interrupted at that moment: what it did stays revoked.
#[test]
fn grey_and_interrupted() {
    for _ in 0..5 {
        let folder = Folder::new();
        let verified = options(&folder.out, &[WHOLE, "image.tile=1", "run.verify=0.001"]);
        let manager = folder.start(Some("grey"), FILES, &verified);
        let log = folder.out.join("logs/manager.log");
        let is_found = || fs::read_to_string(&log).is_ok_and(|log| log.contains("node 0 is set aside"));
        wait_for("a verdict", is_found);
        signal(&manager, Signal::SIGINT);
        let interrupted = folder.end(manager);
        assert_eq!(interrupted.status.code(), Some(130), "{}", interrupted.stderr);
        resume(&folder);
    }
}
