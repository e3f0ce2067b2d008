//! Runs that end early beside an evil node, and are resumed without it.

use std::fs;
use std::process::Child;
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

use crate::run::{COUNTED, Folder, WHOLE, options, right};

const FILES: u32 = 20_000;
const PATIENCE: Duration = Duration::from_secs(30);

/// Looks all the time.
fn wait_for(what: &str, is_so: impl Fn() -> bool) {
    let start = Instant::now();
    while !is_so() {
        assert!(start.elapsed() < PATIENCE, "{what} does not come");
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

/// Wrong tiles of a process that is not condemned yet are in the journal when the manager is killed.
#[test]
fn greylater_and_resumed() {
    let folder = Folder::new();
    let verified = options(&folder.out, &[COUNTED, "run.verify=0.001"]);
    let manager = folder.start(Some("greylater"), FILES, &verified);
    let log = folder.out.join("logs/node-0.log");
    let wrong = || fs::read_to_string(&log).map_or(0, |log| log.matches("evil: sends other pixels").count());
    wait_for("a third of its tiles", || wrong() > 20);
    signal(&manager, Signal::SIGKILL);
    let killed = folder.end(manager);
    assert!(killed.report.is_none(), "it was over before it was killed");
    resume(&folder);
}

/// A process is found out, and the run interrupted at that moment: nothing that it did is in the image, nor what it has
/// not even reported done. The moment is short, hence several runs.
#[test]
fn greyheld_and_interrupted() {
    for _ in 0..10 {
        let folder = Folder::new();
        let verified = options(&folder.out, &[WHOLE, "run.verify=0.001"]);
        let manager = folder.start(Some("greyheld"), FILES, &verified);
        let log = folder.out.join("logs/manager.log");
        let is_found = || fs::read_to_string(&log).is_ok_and(|log| log.contains("node 0 is set aside"));
        wait_for("a verdict", is_found);
        // Reports that arrive meanwhile, and the signal, come at one time.
        for (sent, pause) in [(Signal::SIGSTOP, 0), (Signal::SIGINT, 20), (Signal::SIGCONT, 0)] {
            signal(&manager, sent);
            std::thread::sleep(Duration::from_millis(pause));
        }
        let interrupted = folder.end(manager);
        // The others may have done the rest by then.
        assert!(matches!(interrupted.status.code(), Some(0 | 130)), "{}", interrupted.stderr);
        resume(&folder);
    }
}
