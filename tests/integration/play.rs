//! A recording, played to a bus by itself.

use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead, BufReader};
use std::net::SocketAddr;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use cluster::processes::player::{Pace, PlayError, PlayOutcome, PlayRequest, play};
use ground::ids::NodeId;
use machine::hardware::transaction::{Kind, Transaction};
use machine::recording::Writer;
use machine::recording::bus_log::Reader;
use nix::sys::signal::Signal;

use crate::command::{TEAPOT, number, report_of};
use crate::processes::{peak_memory_kib, signal};

/// `marti-bus --recording`, killed when it does not end by itself.
struct Bus {
    process: Child,
    address: SocketAddr,
    out: tempfile::TempDir,
}

impl Bus {
    fn of(recording: &Path) -> Self {
        let out = tempfile::tempdir().expect("temporary folder");
        let mut process = bus(recording).arg("--out").arg(out.path()).stdout(Stdio::piped()).spawn().expect("a bus");
        let mut line = String::new();
        BufReader::new(process.stdout.take().expect("piped")).read_line(&mut line).expect("a line");
        let address = line.trim().parse().unwrap_or_else(|_| panic!("not an address: {line:?}"));
        Self { process, address, out }
    }

    fn token(&self) -> PathBuf {
        self.out.path().join("bus.token")
    }

    fn request(&self, recording: &Path, pace: Pace) -> PlayRequest {
        PlayRequest {
            recording: recording.to_owned(),
            bus: self.address,
            token: self.token(),
            pace,
            scene_sha256: None,
            may_be_damaged: false,
        }
    }

    /// The log of a bus that has ended by itself, in good order.
    fn log(&mut self) -> Vec<Transaction> {
        let start = Instant::now();
        let status = loop {
            match self.process.try_wait().expect("our own child") {
                Some(status) => break status,
                None => assert!(start.elapsed() < Duration::from_secs(10), "the bus does not end"),
            }
            std::thread::sleep(Duration::from_millis(5));
        };
        assert!(status.success(), "{status}");
        assert!(!self.token().exists());
        rows(self.out.path())
    }
}

impl Drop for Bus {
    fn drop(&mut self) {
        // An error means that it has ended already.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn bus(recording: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_marti-bus"));
    command.arg("--recording").arg(recording).env_remove("MARTI_LOG").stdin(Stdio::null());
    command
}

fn rows(out: &Path) -> Vec<Transaction> {
    let mut log = Reader::open(&out.join("recording")).expect("a whole log");
    let mut rows = Vec::new();
    while let Some(more) = log.next_rows().expect("a whole log") {
        rows.extend(more);
    }
    rows
}

/// What each node said, and the master about it, without numbers of rows and times.
fn said(rows: &[Transaction]) -> BTreeMap<(Option<NodeId>, bool), Vec<Transaction>> {
    let mut said: BTreeMap<_, Vec<_>> = BTreeMap::new();
    for row in rows {
        let timeless = Transaction {
            sequence: 0,
            request_nanoseconds: 0,
            grant_nanoseconds: 0,
            completion_nanoseconds: 0,
            ..*row
        };
        said.entry((row.node, row.kind == Kind::Job)).or_default().push(timeless);
    }
    said
}

/// A copy of a run's folder whose log has these rows.
fn copy(run: &Path, change: impl FnOnce(&mut Vec<Transaction>)) -> tempfile::TempDir {
    let copy = tempfile::tempdir().expect("temporary folder");
    let recording = copy.path().join("recording");
    fs::create_dir(&recording).expect("writable");
    fs::copy(run.join("topology.toml"), copy.path().join("topology.toml")).expect("writable");
    let mut rows = rows(run);
    change(&mut rows);
    let metadata = Reader::open(&run.join("recording")).expect("whole").metadata().clone();
    let mut writer = Writer::create(&recording, &metadata).expect("writable");
    rows.into_iter().for_each(|row| writer.push(row).expect("written"));
    writer.finish().expect("whole");
    copy
}

fn check(outcome: &PlayOutcome, recorded: &[Transaction]) {
    let count = |kind| recorded.iter().filter(|row| row.kind == kind).count() as u64;
    assert_eq!((outcome.mismatches, &outcome.first_mismatch, &outcome.left_out), (0, &None, &None));
    assert_eq!(outcome.transactions, recorded.len() as u64 - count(Kind::Write));
    assert_eq!([outcome.fetches, outcome.bulk_reads], [count(Kind::Fetch), count(Kind::Bulk)]);
    assert_eq!([outcome.jobs, outcome.pixels], [count(Kind::Job), count(Kind::Pixels)]);
    let latency = outcome.latency_microseconds.expect("fetches were answered");
    assert!(latency.min > 0.0 && latency.min <= latency.p50 && latency.p50 <= latency.p99);
    assert!(latency.p99 <= latency.max && latency.max / 1e6 < outcome.seconds);
}

#[test]
fn a_run_is_played_again_and_every_answer_is_the_recorded_one() {
    let run = tempfile::tempdir().expect("temporary folder");
    let report = report_of(TEAPOT, run.path(), &["cluster.local_memory.size=1/16", "cluster.bus.arbiter=round_robin"]);
    let recorded = rows(run.path());
    assert_eq!(recorded.len() as u64, number(&report, "bus.log_rows"));

    for pace in [Pace::Fastest, Pace::Recorded] {
        let mut bus = Bus::of(run.path());
        let mode = fs::metadata(bus.token()).expect("written before the address").permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
        let outcome = play(&bus.request(run.path(), pace)).expect("played");
        check(&outcome, &recorded);
        assert_eq!(outcome.moved_bytes, number(&report, "bus.bytes"));
        assert!(outcome.text().contains("mismatches   0\n"), "{}", outcome.text());
        if pace == Pace::Recorded {
            assert!(outcome.seconds >= outcome.recorded_seconds * 0.99, "{}", outcome.text());
        }
        let played = bus.log();
        assert!(said(&played) == said(&recorded), "each said what it had said, in the same order");
    }
}

#[test]
fn a_pulled_database_is_played_again() {
    let run = tempfile::tempdir().expect("temporary folder");
    report_of(TEAPOT, run.path(), &["cluster.local_memory.size=all"]);
    let recorded = rows(run.path());
    let mut bus = Bus::of(&run.path().join("recording"));
    let outcome = play(&bus.request(run.path(), Pace::Fastest)).expect("played");
    check(&outcome, &recorded);
    assert!(outcome.bulk_reads > 0 && outcome.fetches == 0);
    assert!(said(&bus.log()) == said(&recorded));
}

#[test]
fn an_answer_that_is_not_the_recorded_one_is_counted_and_named() {
    let run = tempfile::tempdir().expect("temporary folder");
    report_of(TEAPOT, run.path(), &["cluster.local_memory.size=1/16"]);
    let mut altered = 0;
    let copy = copy(run.path(), |rows| {
        altered = rows.len() / 2 + rows[rows.len() / 2..].iter().position(|row| row.kind == Kind::Fetch).expect("one");
        rows[altered].crc32c = rows[altered].crc32c.map(|crc| crc ^ 1);
    });
    let bus = Bus::of(copy.path());
    let outcome = play(&bus.request(copy.path(), Pace::Fastest)).expect("played");
    assert_eq!(outcome.mismatches, 1);
    let first = outcome.first_mismatch.expect("one");
    assert!(first.starts_with(&format!("sequence {altered}, fetch at address ")), "{first}");
}

#[test]
fn what_cannot_be_played_is_refused_with_the_reason() {
    let run = tempfile::tempdir().expect("temporary folder");
    report_of(TEAPOT, run.path(), &["cluster.local_memory.size=1/16"]);
    let bus = Bus::of(run.path());
    let refused = |request: &PlayRequest, expected: &str| {
        let error = play(request).expect_err(expected);
        assert!(error.is_bad_input() && error.to_string().contains(expected), "{error}");
    };
    let good = bus.request(run.path(), Pace::Fastest);
    refused(&PlayRequest { scene_sha256: Some("00".repeat(32)), ..good.clone() }, "recorded was 0000");
    let nowhere = run.path().join("nowhere");
    refused(&PlayRequest { recording: nowhere.clone(), ..good.clone() }, "topology.toml");
    refused(&PlayRequest { token: nowhere, ..good.clone() }, "nowhere: No such file");

    let written = copy(run.path(), |rows| {
        let write = rows[0];
        let last = rows.last_mut().expect("rows");
        let (sequence, time) = (last.sequence, last.grant_nanoseconds);
        let times = (time, last.completion_nanoseconds);
        *last = Transaction { sequence, request_nanoseconds: time, ..write };
        (last.grant_nanoseconds, last.completion_nanoseconds) = times;
    });
    refused(&PlayRequest { recording: written.path().to_owned(), ..good.clone() }, "a write after the first fetch");

    // Another scene than the one that was recorded.
    let other = copy(run.path(), |_| ());
    let path = other.path().join("topology.toml");
    let topology = fs::read_to_string(&path).expect("TOML");
    fs::write(&path, topology.replace("leaf_size = 8", "leaf_size = 9")).expect("writable");
    refused(&PlayRequest { recording: other.path().to_owned(), ..good.clone() }, "the scene or marti is another");

    // Cut: named with what can be used, and played as far as that when it is asked for.
    let cut = copy(run.path(), |_| ());
    let log = cut.path().join("recording/bus.arrows");
    let bytes = fs::read(&log).expect("a log");
    fs::write(&log, &bytes[..bytes.len() * 9 / 10]).expect("writable");
    let request = PlayRequest { recording: cut.path().to_owned(), ..good };
    let Err(PlayError::Recording(error)) = play(&request) else { panic!("a cut log was played") };
    assert!(error.to_string().contains("bytes of body, the file ends after"), "{error}");
    assert!(error.usable.unaltered && error.usable.rows > 0, "{error}");
    let outcome = play(&PlayRequest { may_be_damaged: true, ..request }).expect("played as far as it goes");
    let writes = rows(run.path()).iter().filter(|row| row.kind == Kind::Write).count() as u64;
    assert_eq!((outcome.transactions, outcome.mismatches), (error.usable.rows - writes, 0));
    assert!(outcome.left_out.expect("cut").contains("the file ends after"));
}

/// A gibibyte of nothing that claims to be a log, and lengths that claim as much.
#[test]
fn absurd_lengths_take_no_memory() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path().join("bus.arrows");
    let before = peak_memory_kib(std::process::id());
    for prefix in [[0; 8], [255, 255, 255, 255, 255, 255, 255, 127], [255, 255, 255, 255, 0, 0, 0, 64]] {
        fs::write(&path, prefix).expect("writable");
        fs::File::options().append(true).open(&path).and_then(|file| file.set_len(1 << 30)).expect("a sparse file");
        let error = Reader::open(folder.path()).expect_err("no log");
        assert_eq!(error.usable.rows, 0, "{error}");
    }
    // The other tests of this process take some too.
    assert!(peak_memory_kib(std::process::id()) - before < 256 << 10);
}

#[test]
fn a_bus_by_itself_ends_when_it_is_told_to_and_serves_this_host_alone() {
    let run = tempfile::tempdir().expect("temporary folder");
    report_of(TEAPOT, run.path(), &["cluster.local_memory.size=1/16"]);
    for end in [Signal::SIGINT, Signal::SIGTERM] {
        let mut bus = Bus::of(run.path());
        signal(bus.process.id(), end);
        assert!(bus.log().is_empty());
    }
    let out = tempfile::tempdir().expect("temporary folder");
    let missing = out.path().join("missing");
    for (recording, arguments, expected) in [
        (run.path(), vec!["--bind", "0.0.0.0:0"], "is not an address of this host alone"),
        (run.path(), vec!["--out", run.path().to_str().expect("UTF-8")], "is the recording that is to be served"),
        (&missing, vec![], "missing/bus.arrows: No such file"),
    ] {
        let output = bus(recording).current_dir(out.path()).args(&arguments).output().expect("a bus");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(1) && said.contains(expected), "{arguments:?}: {said}");
    }
    assert!(!rows(run.path()).is_empty(), "the recording is as it was");
}
