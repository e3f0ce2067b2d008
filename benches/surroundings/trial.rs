//! One run, its resumes, and their faults.

use std::fs;
use std::path::Path;
use std::time::Instant;

use serde_json::Value;

use crate::kind::{End, Kind};
use crate::machine;
use crate::namespaces::{Namespaces, mount_memory};
use crate::random::Random;
use crate::surroundings::Surroundings;
use crate::undisturbed::undisturbed;
use crate::watch::{Attempt, attempt};

const TOPOLOGY: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/teapot-64.toml");

/// What kind and seed decide.
pub(crate) struct Trial {
    pub(crate) kind: Kind,
    pub(crate) seed: u64,
    scene: (&'static str, u32),
    side: u32,
    pub(crate) sets: Vec<String>,
    /// Of the run, and of resumes until one ends well.
    disturbed: Vec<Surroundings>,
}

/// What nothing disturbed gives.
#[derive(Clone)]
pub(crate) struct Expected {
    pub(crate) sha256: String,
    pub(crate) png: Vec<u8>,
}

pub(crate) struct Outcome {
    pub(crate) ends: Vec<End>,
    pub(crate) done: Vec<String>,
    pub(crate) confirmed: Vec<String>,
    pub(crate) faults: Vec<String>,
    pub(crate) seconds: f64,
}

impl Expected {
    /// `folder`: for files.
    pub(crate) fn of(trial: &Trial, folder: &Path) -> Self {
        let sha256 = undisturbed(trial.scene, trial.side, folder);
        Self { sha256, png: fs::read(folder.join("render.png")).expect("an image") }
    }
}

impl Trial {
    pub(crate) fn new(kind: Kind, seed: u64) -> Self {
        let mut random = Random::new(seed ^ (kind as u64) << 32);
        let scene = random.pick(&[("teapot", 6), ("balls", 3)]);
        // A second of processor time has to be needed.
        let side = if kind == Kind::LimitProcessor { 320 } else { random.pick(&[128, 160]) };
        let memory = random.pick(&["\"all\"", "1/8", "1/8", "4 KiB"]);
        let memory = if kind == Kind::LimitProcessor { "4 KiB" } else { memory };
        let clusters = 1 + random.below(2);
        let nodes = (2 + random.below(4)) / clusters + clusters - 1;
        let mut sets = vec![
            format!("scene.procedural={}", scene.0),
            format!("scene.size={}", scene.1),
            format!("image.width={side}"),
            format!("image.height={side}"),
            format!("image.tile={}", random.pick(&[4, 8, 16])),
            format!("cluster.count={clusters}"),
            format!("cluster.nodes={nodes}"),
            format!("cluster.local_memory.size={memory}"),
            // Far above what a busy machine makes of it.
            format!("run.deadlines.heartbeat_seconds={}", f64::from(10 + random.below(11)) / 10.0),
        ];
        // Where two disagree, a third one settles it.
        if nodes * clusters >= 3 && random.once_in(2) {
            sets.push("run.verify=0.05".to_owned());
        }
        let disturbed = (0..1 + random.below(3)).map(|_| Surroundings::new(kind, &mut random)).collect();
        Self { kind, seed, scene, side, sets, disturbed }
    }

    /// What decides the image.
    pub(crate) fn image(&self) -> ((&'static str, u32), u32) {
        (self.scene, self.side)
    }

    /// What does it again.
    pub(crate) fn command(&self) -> String {
        format!("cargo bench --bench surroundings -- --kinds {} --seed {}", self.kind.name(), self.seed)
    }

    /// In namespaces of its own, on a thread of its own; `room` is an empty folder. If there are faults, what the run
    /// left is copied to `keep`.
    ///
    /// # Errors
    /// Why it cannot be done here.
    pub(crate) fn run(&self, room: &Path, expected: &Expected, keep: Option<&Path>) -> Result<Outcome, String> {
        let run = || {
            let namespaces = Namespaces::enter(room)?;
            let outcome = self.run_in(&namespaces, expected)?;
            if let Some(keep) = keep.filter(|_| !outcome.faults.is_empty()) {
                let to = keep.join(format!("{}-{}", self.kind.name(), self.seed));
                fs::create_dir_all(&to).map_err(|error| format!("{}: {error}", to.display()))?;
                let mut copy = std::process::Command::new("cp");
                // A fault is a fault without its files.
                let _ = copy.arg("-r").arg(room).arg(to).status();
            }
            Ok(outcome)
        };
        std::thread::scope(|scope| scope.spawn(run).join().map_err(|_| "the harness panicked".to_owned())?)
    }

    fn run_in(&self, namespaces: &Namespaces, expected: &Expected) -> Result<Outcome, String> {
        let (start, devices) = (Instant::now(), machine::devices());
        let disk = namespaces.room.join("disk");
        fs::create_dir(&disk).map_err(|error| format!("{}: {error}", disk.display()))?;
        mount_memory(&disk, "mode=1777")?;
        let mut outcome = Outcome { ends: vec![], done: vec![], confirmed: vec![], faults: vec![], seconds: 0.0 };
        let mut out = disk.join("out");
        for (number, surroundings) in self.disturbed.iter().enumerate() {
            // Where the run before it had not begun, there is nothing to resume.
            if number > 0 && !out.join("topology.toml").is_file() {
                out = disk.join(format!("out-{number}"));
            }
            let attempt = self.attempt(namespaces, surroundings, &out, number)?;
            let end = attempt.end;
            self.judge(&attempt, surroundings, &out, expected, &mut outcome);
            outcome.take(attempt);
            if end == End::Code(0) {
                break;
            }
        }
        self.resume_undisturbed(namespaces, &mut out, expected, &mut outcome)?;
        if machine::devices() != devices {
            outcome.faults.push(format!("devices changed: {:?}", machine::devices()));
        }
        outcome.seconds = start.elapsed().as_secs_f64();
        Ok(outcome)
    }

    /// Must always end well.
    fn resume_undisturbed(
        &self,
        namespaces: &Namespaces,
        out: &mut std::path::PathBuf,
        expected: &Expected,
        outcome: &mut Outcome,
    ) -> Result<(), String> {
        let calm = Surroundings::calm();
        if !out.join("topology.toml").is_file() {
            *out = namespaces.room.join("disk/anew");
        }
        let mut attempt = self.attempt(namespaces, &Surroundings { user: self.disturbed[0].user, ..calm }, out, 9)?;
        if attempt.end != End::Code(0) {
            outcome.faults.push(format!("undisturbed resume: {:?}: {}", attempt.end, attempt.error()));
        }
        outcome.faults.extend(wrong(out, expected, true));
        attempt.confirmed.clear();
        outcome.take(attempt);
        Ok(())
    }

    fn attempt(
        &self,
        namespaces: &Namespaces,
        surroundings: &Surroundings,
        out: &Path,
        n: usize,
    ) -> Result<Attempt, String> {
        let path = out.display().to_string();
        let mut arguments = vec!["run".to_owned()];
        if out.join("topology.toml").is_file() {
            arguments.extend(["--resume".to_owned(), path]);
        } else {
            arguments.extend([TOPOLOGY.to_owned(), "--out".to_owned(), path]);
            arguments.extend(self.sets.iter().flat_map(|set| ["--set".to_owned(), set.clone()]));
        }
        // Pixels alone: what says how far the run is need not be exact.
        let bytes = 12 * u64::from(self.side) * u64::from(self.side);
        attempt(namespaces, surroundings, &arguments, (&out.join("tiles"), bytes), &format!("stream-{n}"))
    }

    fn judge(
        &self,
        attempt: &Attempt,
        surroundings: &Surroundings,
        out: &Path,
        expected: &Expected,
        outcome: &mut Outcome,
    ) {
        let end = attempt.end;
        let is_good = end == End::Code(0);
        let is_ours = attempt.killed && end == End::Signal(9);
        let never_began = !surroundings.limits.is_empty() && attempt.could_not_begin();
        if !is_good && !self.kind.allows(end) && !is_ours && end != End::Hang && !never_began {
            outcome.faults.push(format!("ended with {end:?}: {}", attempt.error()));
        }
        let is_silent =
            matches!(end, End::Code(1..) | End::Signal(6)) && attempt.keeps_errors && attempt.error().is_empty();
        if is_silent {
            outcome.faults.push(format!("ended with {end:?} without a word"));
        }
        outcome.faults.extend(wrong(out, expected, is_good));
    }
}

impl Outcome {
    fn take(&mut self, attempt: Attempt) {
        self.ends.push(attempt.end);
        self.done.extend(attempt.done);
        self.confirmed.extend(attempt.confirmed);
        self.faults.extend(attempt.faults);
        // The language's own: a thread that gets no memory for its signal stack.
        let is_panic = |line: &&str| line.contains("panicked") && !line.contains("sys/pal/unix/stack_overflow.rs");
        let panic = attempt.said.lines().chain(attempt.logs.lines()).find(is_panic);
        self.faults.extend(panic.map(|line| format!("panic: {}", line.trim())));
    }
}

/// What is wrong with the image in `out`, if the run claims to have one or must have one.
fn wrong(out: &Path, expected: &Expected, must_be: bool) -> Option<String> {
    let report = fs::read_to_string(out.join("report.json")).ok();
    let report: Option<Value> = report.and_then(|text| serde_json::from_str(&text).ok());
    let report = report.filter(|report| report["status"] == "done");
    let Some(report) = report else {
        return must_be.then(|| "no image: no report of a run that is done".to_owned());
    };
    if report["image"]["sha256"] != expected.sha256.as_str() {
        return Some(format!("wrong image: sha256 {}", report["image"]["sha256"]));
    }
    let is_same = fs::read(out.join("image.png")).is_ok_and(|png| png == expected.png);
    (!is_same).then(|| "wrong image: image.png is not what report.json says".to_owned())
}
