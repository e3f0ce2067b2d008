//! `marti replay RECORDING --export FORMAT -o FILE`

use std::io;
use std::path::Path;

use crate::atomic_file;
use crate::cli::{Failure, print};
use crate::recording::references::Recording;
use crate::replay::evaluation::schedule;
use crate::replay::exporters::accesses::Surroundings;
use crate::replay::exporters::{ExportError, csv, din, json, oracle_general};
use crate::replay::setting::{Assignment, Setting};
use crate::replay::subject::Subject;

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
    if setting.assignment == Assignment::OnDemand {
        return Err(Failure::bad_input("exports need to know who traces what: expected recorded or interleaved"));
    }
    let nodes = schedule(recording, setting).nodes;
    let tiles: Vec<u32> = match (node, format) {
        (Some(node), _) => match nodes.get(usize::from(node)) {
            Some(processes) => processes.concat(),
            None => return Err(Failure::bad_input(format!("node {node}, expected one below {}", nodes.len()))),
        },
        (None, Export::Din | Export::OracleGeneral) if nodes.len() > 1 => {
            return Err(Failure::bad_input(format!(
                "a trace of this format is that of one memory: expected --node, 0 to {}",
                nodes.len() - 1
            )));
        }
        (None, _) => nodes.concat().concat(),
    };
    let lines = recording.lines(setting.line);
    let surroundings =
        Surroundings { layout: &recording.layout, levels: &recording.octree_levels, tiling: recording.tiling };
    let mut written = 0;
    atomic_file::write(out, |file| {
        let exported = match format {
            Export::Din => din::write(file, recording, &tiles, &lines, setting.line),
            Export::OracleGeneral => oracle_general::write(file, recording, &tiles, &lines, setting.line),
            Export::Csv => csv::write(file, recording, &tiles, surroundings),
            Export::Json => json::write(file, recording, &tiles, surroundings),
            Export::Chrome | Export::Vcd => Err(ExportError::Io(io::Error::other("not built"))),
        };
        written = exported.map_err(io::Error::other)?;
        Ok(())
    })
    .map_err(|error| Failure::failed(error.to_string()))?;
    print(&format!("{}: {written} references\n", out.display()))
}
