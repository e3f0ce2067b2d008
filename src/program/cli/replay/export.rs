//! `marti replay RECORDING --export FORMAT -o FILE`

use std::io::{self, Write};
use std::path::Path;

use super::combinations::Question;
use crate::cli::{Failure, print};
use ground::atomic_file::{self, Writer};
use ground::ids::ClusterId;
use machine::hardware::local_memory::Geometry;
use machine::recording::references::Recording;
use machine::replay::contention::Cycle;
use machine::replay::contention::timing::simulate_cluster;
use machine::replay::exporters::accesses::Surroundings;
use machine::replay::exporters::chrome::ChromeTrace;
use machine::replay::exporters::vcd::BusWaves;
use machine::replay::exporters::{csv, din, json, oracle_general};
use machine::replay::plan::schedule::schedule;
use machine::replay::plan::setting::{Assignment, Policy, Setting};
use machine::replay::stream::subject::Subject;

/// Windows in which a Chrome trace tells how much the bus was used.
const UTILISATION_WINDOW: Cycle = 10_000;

/// Formats of other tools.
#[derive(Clone, Copy, PartialEq, Eq, Debug, clap::ValueEnum)]
pub(super) enum Export {
    /// Dinero: line references of one node, as text
    Din,
    /// libCacheSim's oracleGeneral: line references of one node, with the next use of each
    OracleGeneral,
    /// Every record read, with all that is known of it
    Csv,
    /// The same, one JSON object a line
    Json,
    /// Chrome trace events for ui.perfetto.dev: tiles, stalls and the bus, in simulated cycles
    Chrome,
    /// Value change dump of the bus, in simulated cycles
    Vcd,
}

impl Export {
    pub(super) fn question(self) -> Question {
        match self {
            Self::Din | Self::OracleGeneral => Question::ExportLines,
            Self::Csv | Self::Json => Question::ExportReads,
            Self::Chrome | Self::Vcd => Question::ExportBus,
        }
    }
}

/// Those of the references of nodes.
#[derive(Clone, Copy, PartialEq, Eq)]
enum ReferenceFormat {
    Din,
    OracleGeneral,
    Csv,
    Json,
}

/// Those of a simulated bus.
#[derive(Clone, Copy, PartialEq, Eq)]
enum BusFormat {
    Chrome,
    Vcd,
}

pub(super) fn export(
    recording: &Recording,
    settings: &[Setting],
    format: Export,
    node: Option<u16>,
    out: &Path,
) -> Result<(), Failure> {
    let [setting] = settings else {
        return Err(Failure::bad_input(format!("{} settings, expected one value of each option", settings.len())));
    };
    let of_nodes = |format| export_references(recording, setting, format, node, out);
    let of_bus = |format| export_bus(recording, setting, format, out);
    match format {
        Export::Din => of_nodes(ReferenceFormat::Din),
        Export::OracleGeneral => of_nodes(ReferenceFormat::OracleGeneral),
        Export::Csv => of_nodes(ReferenceFormat::Csv),
        Export::Json => of_nodes(ReferenceFormat::Json),
        Export::Chrome => of_bus(BusFormat::Chrome),
        Export::Vcd => of_bus(BusFormat::Vcd),
    }
}

fn export_references(
    recording: &Recording,
    setting: &Setting,
    format: ReferenceFormat,
    node: Option<u16>,
    out: &Path,
) -> Result<(), Failure> {
    if setting.assignment == Assignment::OnDemand {
        return Err(Failure::bad_input(
            "references of nodes need a fixed assignment: expected recorded or interleaved",
        ));
    }
    let nodes = schedule(recording, setting).nodes;
    let is_of_one_memory = matches!(format, ReferenceFormat::Din | ReferenceFormat::OracleGeneral);
    let tiles: Vec<u32> = match node {
        Some(node) => match nodes.get(usize::from(node)) {
            Some(processes) if is_of_one_memory && processes.len() > 1 => {
                return Err(Failure::bad_input(format!(
                    "node {node} was replaced: its references are those of {} memories, and this format has no mark for \
                     a new one; expected a node that lived, or --assignment interleaved",
                    processes.len()
                )));
            }
            Some(processes) => processes.concat(),
            None => return Err(Failure::bad_input(format!("node {node}, expected one below {}", nodes.len()))),
        },
        None if is_of_one_memory && nodes.len() > 1 => {
            return Err(Failure::bad_input(format!(
                "a trace of this format is that of one memory: expected --node, 0 to {}",
                nodes.len() - 1
            )));
        }
        None => nodes.concat().concat(),
    };
    let lines = recording.lines(setting.line);
    let surroundings =
        Surroundings { layout: &recording.layout, levels: &recording.octree_levels, tiling: recording.tiling };
    let mut references = 0;
    write(out, |file| {
        references = match format {
            ReferenceFormat::Din => din::write(file, recording, &tiles, &lines, setting.line),
            ReferenceFormat::OracleGeneral => oracle_general::write(file, recording, &tiles, &lines, setting.line),
            ReferenceFormat::Csv => csv::write(file, recording, &tiles, surroundings),
            ReferenceFormat::Json => json::write(file, recording, &tiles, surroundings),
        }
        .map_err(io::Error::other)?;
        Ok(())
    })?;
    print(&format!("{}: {references} references\n", out.display()))
}

/// The clusters one after the other, each from cycle 0 on; waves are those of the first.
fn export_bus(recording: &Recording, setting: &Setting, format: BusFormat, out: &Path) -> Result<(), Failure> {
    if setting.replacement == Policy::Optimal {
        return Err(Failure::bad_input(
            "a bus is not simulated with optimal, which has no times: expected another policy",
        ));
    }
    let geometry = Geometry::new(&setting.memory(), &recording.layout)
        .map_err(|error| Failure::bad_input(format!("local memory: {error}")))?;
    let mut transactions = 0;
    write(out, |file| {
        if format == BusFormat::Vcd {
            let waves = BusWaves::new(file, ClusterId(0), setting.nodes);
            let simulated = simulate_cluster(recording, setting, geometry, 0, &mut &waves, |step| waves.step(step));
            transactions = simulated.map_err(io::Error::other)?.0.transactions;
            return waves.finish().map(drop);
        }
        let trace = ChromeTrace::new(file, UTILISATION_WINDOW);
        for cluster in 0..setting.clusters {
            trace.cluster(ClusterId(cluster), setting.nodes);
            let simulated =
                simulate_cluster(recording, setting, geometry, cluster, &mut &trace, |step| trace.step(step));
            transactions += simulated.map_err(io::Error::other)?.0.transactions;
        }
        trace.finish().map(drop)
    })?;
    print(&format!("{}: {transactions} transactions\n", out.display()))
}

fn write(out: &Path, contents: impl FnOnce(&mut Writer) -> io::Result<()>) -> Result<(), Failure> {
    atomic_file::write(out, |file| {
        contents(file)?;
        file.flush()
    })
    .map_err(|error| Failure::failed(error.to_string()))
}
