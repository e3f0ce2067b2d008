//! Real processes through many schedules of faults: each a small scene, clusters, nodes, a memory and faults that
//! its number decides. Every run must end by itself, well, with the image of an undisturbed render and all its tiles.
//!
//! `cargo bench --bench chaos -- --schedules 500`; `--first N` begins with another number, `--without
//! servers,corrupt,clusters,verify` leaves out what is named, `--csv FILE` says where the rows go (target/chaos.csv), `--folder DIR` where the last run's
//! output stays.
//! `--namespaces` has every run on three hosts, which are network namespaces, by mutual TLS, and cuts one of them off
//! from the others by its link; it needs root and iproute2. Ends with 1 if any run was not as it must be.

mod campaign;
mod network;
mod trial;
mod undisturbed;

use std::collections::HashMap;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use campaign::{Campaign, Outcome};
use network::Network;
use trial::Trial;
use undisturbed::undisturbed;

fn main() -> ExitCode {
    let options = Options::parse(std::env::args().skip(1));
    if !options.without.is_empty() {
        println!("LEFT OUT: {}", options.without.join(", "));
    }
    let temporary = tempfile::tempdir().expect("a temporary folder");
    let folder = options.folder.as_deref().unwrap_or(temporary.path());
    fs::create_dir_all(folder).expect("a folder for output");
    let network = options.namespaces.then(|| Network::new(temporary.path()));
    let mut rows = File::create(&options.csv).expect("a writable file of rows");
    writeln!(rows, "{}", Outcome::COLUMNS).expect("written");
    let (mut campaign, mut images) = (Campaign::default(), HashMap::new());
    for number in options.first..options.first + options.schedules {
        let trial = Trial::new(number, &options, network.as_ref());
        let (scene, side) = trial.image();
        let expected = images.entry((scene, side)).or_insert_with(|| undisturbed(scene, side, folder));
        let outcome = trial.run(folder, network.as_ref(), expected);
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
    namespaces: bool,
    folder: Option<PathBuf>,
}

impl Options {
    fn parse(mut arguments: impl Iterator<Item = String>) -> Self {
        let csv = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/chaos.csv");
        let mut options = Self { schedules: 20, first: 0, without: Vec::new(), csv, namespaces: false, folder: None };
        while let Some(argument) = arguments.next() {
            let mut value = || arguments.next().unwrap_or_else(|| panic!("{argument} needs a value"));
            match argument.as_str() {
                // cargo itself passes it.
                "--bench" => {}
                "--schedules" => options.schedules = value().parse().expect("a number of schedules"),
                "--first" => options.first = value().parse().expect("a number"),
                "--without" => options.without = value().split(',').map(str::to_owned).collect(),
                "--csv" => options.csv = value().into(),
                "--namespaces" => options.namespaces = true,
                "--folder" => options.folder = Some(value().into()),
                other => panic!("{other}: expected --schedules, --first, --without, --csv, --namespaces or --folder"),
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
