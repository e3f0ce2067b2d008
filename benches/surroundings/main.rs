//! Real processes in hostile surroundings: full disks, broken streams, limits on every resource, stopped and killed
//! processes, alone and together, and resumes under the same. A run may fail, with words; it must never give a wrong image,
//! panic, hang, or leave a process behind, and an undisturbed resume must end it well.
//!
//! `cargo bench --bench surroundings -- --runs 12`: so many of each kind, not counting those in which the disturbance is not
//! seen to have taken effect; `--kinds a,b` takes these alone, `--first N` begins with another seed, `--seed N` runs one seed
//! alone, `--csv FILE` says where the rows go (target/surroundings.csv), `--keep DIR` where the files of a bad run are copied.
//! Needs root, util-linux and iproute2; each trial has mount, process and network namespaces of its own. Ends with 1 if
//! any run was not as it must be.

mod campaign;
mod disk;
mod kind;
mod machine;
mod memory_group;
mod namespaces;
mod pipes;
mod random;
mod surroundings;
mod trial;
#[path = "../chaos/undisturbed.rs"]
mod undisturbed;
mod watch;

use std::collections::HashMap;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use campaign::Campaign;
use kind::Kind;
use machine::Machine;
use trial::{Expected, Trial};

/// Seeds a run that counts may take.
const TRIES: usize = 5;

fn main() -> ExitCode {
    let options = Options::parse(std::env::args().skip(1));
    let temporary = tempfile::tempdir().expect("a temporary folder");
    let room = temporary.path().join("room");
    fs::create_dir(&room).expect("a folder for output");
    let mut rows = File::create(&options.csv).expect("a writable file of rows");
    writeln!(rows, "{}", campaign::COLUMNS).expect("written");
    let (mut campaign, mut images, mut missing) = (Campaign::default(), HashMap::new(), 0);
    for &kind in &options.kinds {
        let tries = if options.alone { 1 } else { options.runs * TRIES };
        for seed in (options.first..).take(tries) {
            if campaign.runs(kind) >= options.runs {
                break;
            }
            let trial = Trial::new(kind, seed);
            let expected = images.entry(trial.image()).or_insert_with(|| Expected::of(&trial, temporary.path()));
            let before = Machine::now();
            let mut outcome = match trial.run(&room, expected, options.keep.as_deref()) {
                Ok(outcome) => outcome,
                Err(why) => {
                    println!("{} {seed} CANNOT BE DONE HERE: {why}", kind.name());
                    break;
                }
            };
            let changes = Machine::now().changes(&before);
            outcome.faults.extend(changes.iter().map(|change| format!("machine changed: {change}")));
            writeln!(rows, "{}", campaign::row(&trial, &outcome)).expect("written");
            if !outcome.faults.is_empty() {
                println!("{} {seed}: {}\n    {}", kind.name(), outcome.faults.join("; "), trial.command());
            }
            campaign.add(&trial, &outcome);
        }
        if campaign.runs(kind) < options.runs && !options.alone {
            println!("{}: {} runs took effect instead of {}", kind.name(), campaign.runs(kind), options.runs);
            missing += 1;
        }
    }
    println!("\n{}rows are in {}", campaign.table(), options.csv.display());
    if campaign.bad() + missing == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

struct Options {
    runs: usize,
    first: u64,
    /// The first seed and no other.
    alone: bool,
    kinds: Vec<Kind>,
    csv: PathBuf,
    keep: Option<PathBuf>,
}

impl Options {
    fn parse(mut arguments: impl Iterator<Item = String>) -> Self {
        let csv = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/surroundings.csv");
        let mut options = Self { runs: 12, first: 0, alone: false, kinds: Kind::ALL.to_vec(), csv, keep: None };
        while let Some(argument) = arguments.next() {
            let mut value = || arguments.next().unwrap_or_else(|| panic!("{argument} needs a value"));
            match argument.as_str() {
                // cargo itself passes it.
                "--bench" => {}
                "--runs" => options.runs = value().parse().expect("a number of runs"),
                "--first" => options.first = value().parse().expect("a number"),
                "--seed" => (options.first, options.alone) = (value().parse().expect("a number"), true),
                "--kinds" => options.kinds = value().split(',').map(kind).collect(),
                "--csv" => options.csv = value().into(),
                "--keep" => options.keep = Some(value().into()),
                other => panic!("{other}: expected --runs, --first, --seed, --kinds, --csv or --keep"),
            }
        }
        options
    }
}

fn kind(name: &str) -> Kind {
    let found = Kind::ALL.iter().find(|kind| kind.name() == name);
    *found.unwrap_or_else(|| {
        panic!("--kinds {name}: expected {}", Kind::ALL.iter().map(|kind| kind.name()).collect::<Vec<_>>().join(", "))
    })
}
