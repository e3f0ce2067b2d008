//! Real processes through many schedules of faults: each a small scene, clusters, nodes, a memory and faults that
//! its number decides. Every run must end by itself, well, with the image of an undisturbed render and all its tiles.
//!
//! `cargo bench --bench chaos -- --schedules 500`; `--first N` begins with another number, `--without
//! servers,corrupt,clusters,verify` leaves out what is named, `--csv FILE` says where the rows go (target/chaos.csv).
//! Ends with 1 if any run was not as it must be.

use std::collections::{BTreeMap, HashMap};
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode, Stdio};
use std::time::{Duration, Instant};

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64;
use serde_json::Value;

/// A run that takes longer hangs: undisturbed ones take some seconds at most.
const PATIENCE: Duration = Duration::from_secs(120);
const TOPOLOGY: &str = "tests/data/teapot-64.toml";

fn main() -> ExitCode {
    let options = Options::parse(std::env::args().skip(1));
    if !options.without.is_empty() {
        println!("LEFT OUT: {}", options.without.join(", "));
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut rows = File::create(&options.csv).expect("a writable file of rows");
    writeln!(rows, "{}", Outcome::COLUMNS).expect("written");
    let (mut campaign, mut images) = (Campaign::default(), HashMap::new());
    for number in options.first..options.first + options.schedules {
        let trial = Trial::new(number, &options);
        let expected = images.entry(trial.image()).or_insert_with(|| undisturbed(&trial, folder.path()));
        let outcome = trial.run(folder.path(), expected);
        writeln!(rows, "{}", outcome.row(&trial)).expect("written");
        if outcome.verdict != "good" {
            println!("schedule {number}: {}: {}", outcome.verdict, trial.command_line());
        }
        campaign.add(&trial, outcome);
        if (number + 1 - options.first).is_multiple_of(25) {
            println!("{} schedules, {} not good", number + 1 - options.first, campaign.bad());
        }
    }
    println!("\n{}rows are in {}", campaign.table(), options.csv.display());
    if campaign.bad() == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

struct Options {
    schedules: u64,
    first: u64,
    without: Vec<String>,
    csv: PathBuf,
}

impl Options {
    fn parse(mut arguments: impl Iterator<Item = String>) -> Self {
        let csv = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/chaos.csv");
        let mut options = Self { schedules: 20, first: 0, without: Vec::new(), csv };
        while let Some(argument) = arguments.next() {
            let mut value = || arguments.next().unwrap_or_else(|| panic!("{argument} needs a value"));
            match argument.as_str() {
                // cargo itself passes it.
                "--bench" => {}
                "--schedules" => options.schedules = value().parse().expect("a number of schedules"),
                "--first" => options.first = value().parse().expect("a number"),
                "--without" => options.without = value().split(',').map(str::to_owned).collect(),
                "--csv" => options.csv = value().into(),
                other => panic!("{other}: expected --schedules, --first, --without or --csv"),
            }
        }
        let known = ["servers", "corrupt", "clusters", "verify"];
        let unknown = options.without.iter().find(|what| !known.contains(&what.as_str()));
        assert!(unknown.is_none(), "--without {unknown:?}: expected some of {known:?}");
        options
    }

    fn has(&self, what: &str) -> bool {
        !self.without.iter().any(|without| without == what)
    }
}

/// One run: what its number decides.
struct Trial {
    number: u64,
    scene: (&'static str, u32),
    side: u32,
    sets: Vec<String>,
    chaos: String,
}

impl Trial {
    fn new(number: u64, options: &Options) -> Self {
        let mut random = Pcg64::seed_from_u64(number);
        let mut below = |limit: u32| ((u64::from(random.next_u32()) * u64::from(limit)) >> 32) as u32;
        let scene = [("teapot", 6), ("gears", 2), ("balls", 3), ("tetra", 5)][below(4) as usize];
        let side = [64, 96, 128][below(3) as usize];
        let memory = ["all", "1/4", "1/8", "4 KiB"][below(4) as usize];
        let clusters = if options.has("clusters") { 1 + below(3) } else { 1 };
        // Of three results two agree; one cluster's nodes have to be three for that.
        let nodes = (2 + below(3)).max(if options.has("verify") && clusters == 1 { 3 } else { 2 });
        // Shorter than some of the stops and cuts, longer than the others.
        let heartbeat = f64::from(4 + below(12)) / 10.0;
        let mut sets = vec![
            format!("scene.procedural={}", scene.0),
            format!("scene.size={}", scene.1),
            format!("image.width={side}"),
            format!("image.height={side}"),
            format!("cluster.nodes={nodes}"),
            format!("cluster.local_memory.size={memory}"),
            format!("run.deadlines.heartbeat_seconds={heartbeat}"),
        ];
        if options.has("clusters") {
            sets.push(format!("cluster.count={clusters}"));
        }
        if options.has("verify") {
            sets.push(format!("run.verify={}", [0.02, 0.1][below(2) as usize]));
        }
        // One fault alone in half of the runs, so that its cost can be told.
        let faults = [1, 1, 1, 2, 3, 4][below(6) as usize];
        let kind = if options.has("servers") { "" } else { " node" };
        let mut chaos = format!("random({faults}{kind})");
        let corrupt = options.has("corrupt") && options.has("verify") && below(4) == 0;
        if corrupt {
            let fault = format!("corrupt node@{}%", 1 + below(90));
            chaos = if faults == 1 { fault } else { format!("{chaos}; {fault}") };
        }
        Self { number, scene, side, sets, chaos: format!("{chaos}; seed={number}") }
    }

    /// What decides the image.
    fn image(&self) -> ((&'static str, u32), u32) {
        (self.scene, self.side)
    }

    fn command_line(&self) -> String {
        let sets: String = self.sets.iter().map(|set| format!(" --set '{set}'")).collect();
        format!("marti run {TOPOLOGY}{sets} --chaos '{}'", self.chaos)
    }

    fn run(&self, folder: &Path, expected: &str) -> Outcome {
        let out = folder.join("run");
        let _ = fs::remove_dir_all(&out);
        let mut command = marti();
        command.args(["run", TOPOLOGY, "--quiet", "--chaos", &self.chaos, "--out"]).arg(&out);
        command.args(self.sets.iter().flat_map(|set| ["--set", set]));
        let start = Instant::now();
        let exit = end_of(command.spawn().expect("marti can be started"), PATIENCE);
        let seconds = start.elapsed().as_secs_f64();
        let report = fs::read_to_string(out.join("report.json")).ok();
        let report = report.and_then(|text| serde_json::from_str(&text).ok()).unwrap_or(Value::Null);
        let tiles = &report["tiles"];
        let verdict = match exit {
            None => "hangs",
            Some(Some(3)) => "tiles missing",
            Some(Some(2)) => "refused",
            Some(code) if code != Some(0) => "failed",
            _ if report["image"]["sha256"] != expected => "wrong image",
            _ if tiles["done"] != tiles["total"] || tiles["total"].is_null() => "lost tiles",
            _ if report["conservation"]["holds"] == false => "books do not balance",
            _ => "good",
        };
        Outcome { verdict, exit: exit.flatten(), seconds, report }
    }
}

struct Outcome {
    verdict: &'static str,
    exit: Option<i32>,
    seconds: f64,
    report: Value,
}

impl Outcome {
    const COLUMNS: &str =
        "schedule,verdict,exit,seconds,tiles,reissued,faults,longest_wait_seconds,books,chaos,command";

    fn row(&self, trial: &Trial) -> String {
        let Self { verdict, seconds, report, .. } = self;
        let exit = self.exit.map_or_else(String::new, |code| code.to_string());
        let (tiles, chaos, holds) = (&report["tiles"], &report["chaos"], &report["conservation"]["holds"]);
        let wait = chaos["longest_wait_seconds"].as_f64().unwrap_or_default();
        format!(
            "{},{verdict},{exit},{seconds:.3},{},{},{},{wait:.3},{holds},\"{}\",\"{}\"",
            trial.number,
            tiles["done"],
            tiles["reissued"],
            chaos["carried_out"],
            chaos["schedule"].as_str().unwrap_or(&trial.chaos),
            trial.command_line(),
        )
    }
}

#[derive(Default)]
struct Campaign {
    verdicts: BTreeMap<&'static str, usize>,
    faults: u64,
    /// Runs whose bus or master did not live to close its books.
    without_books: usize,
    /// Seconds; of runs with one fault that came to pass, by what was done to whom.
    waits: BTreeMap<String, Vec<f64>>,
    all_waits: Vec<(f64, u64)>,
}

impl Campaign {
    fn add(&mut self, trial: &Trial, outcome: Outcome) {
        *self.verdicts.entry(outcome.verdict).or_default() += 1;
        let (chaos, books) = (&outcome.report["chaos"], &outcome.report["conservation"]);
        let carried_out = chaos["carried_out"].as_u64().unwrap_or_default();
        self.faults += carried_out;
        self.without_books += usize::from(books.is_null());
        let (Some(wait), Some(schedule)) = (chaos["longest_wait_seconds"].as_f64(), chaos["schedule"].as_str()) else {
            return;
        };
        self.all_waits.push((wait, trial.number));
        if carried_out == 1 && !schedule.contains(';') {
            // "kill node 3@10% …"
            let done_to = schedule.split([' ', '@']).take(2).collect::<Vec<_>>().join(" ");
            self.waits.entry(done_to).or_default().push(wait);
        }
    }

    fn bad(&self) -> usize {
        self.verdicts.iter().filter(|(verdict, _)| **verdict != "good").map(|(_, count)| count).sum()
    }

    fn table(&mut self) -> String {
        let mut table = String::new();
        let mut line = |text: String| table.push_str(&(text + "\n"));
        for (verdict, count) in &self.verdicts {
            line(format!("{verdict:24} {count:6}"));
        }
        line(format!("{:24} {:6}", "faults carried out", self.faults));
        line(format!("{:24} {:6}", "runs without books", self.without_books));
        if let Some((wait, number)) = self.all_waits.iter().max_by(|a, b| a.0.total_cmp(&b.0)) {
            line(format!("{:24} {wait:6.3} s, schedule {number}", "longest wait for a tile"));
        }
        line("\none fault alone            runs  median  longest wait, s".to_owned());
        for (done_to, waits) in &mut self.waits {
            waits.sort_by(f64::total_cmp);
            let (median, longest) = (waits[waits.len() / 2], waits[waits.len() - 1]);
            line(format!("{done_to:24} {:6} {median:7.3} {longest:7.3}", waits.len()));
        }
        table
    }
}

/// The hash of the image, rendered by one process.
fn undisturbed(trial: &Trial, folder: &Path) -> String {
    let ((scene, size), side) = trial.image();
    let report = folder.join("render.json");
    let mut command = marti();
    command.args(["render", &format!("{scene}:{size}"), "--size", &format!("{side}x{side}"), "-o"]);
    command.arg(folder.join("render.png")).arg("--report").arg(&report);
    assert!(command.status().expect("marti can be started").success());
    let text = fs::read_to_string(report).expect("a report");
    let report: Value = serde_json::from_str(&text).expect("a report is JSON");
    report["image"]["sha256"].as_str().expect("image.sha256").to_owned()
}

fn marti() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_marti"));
    command.current_dir(env!("CARGO_MANIFEST_DIR")).stdout(Stdio::null()).stderr(Stdio::null());
    command
}

/// How a process ended; `None`: it did not, and was killed.
fn end_of(mut process: Child, patience: Duration) -> Option<Option<i32>> {
    let start = Instant::now();
    while start.elapsed() < patience {
        if let Some(status) = process.try_wait().expect("our own child") {
            return Some(status.code());
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    process.kill().expect("our own child");
    process.wait().expect("our own child");
    None
}
