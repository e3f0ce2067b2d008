//! `marti study paper`, `marti study sweep TOPOLOGY`

use std::fs;
use std::io::{self, Write};
use std::path::PathBuf;

use clap::{Args, Subcommand};
use serde::Serialize;

use super::grid_options::{GridOptions, SETTINGS, TIMES};
use super::replay::{are_timed, reasons};
use super::table::{Format, Table};
use super::{Failure, json, output_path, print, provenance, subject};
use crate::study::page::Page;
use crate::study::paper::{self, Paper};
use crate::study::sweep::{self, Sweep};
use cluster::processes::scene_warnings;
use cluster::topology::Override;
use ground::atomic_file;
use ground::outlet;
use ground::progress::Steps;

/// Trace scenes once and replay them through many clusters
#[derive(Clone, Debug, Args)]
pub struct StudyArguments {
    #[command(subcommand)]
    study: Study,
}

#[derive(Clone, Debug, Subcommand)]
enum Study {
    Paper(PaperArguments),
    Sweep(Box<SweepArguments>),
}

/// Print the 1991 paper's figures beside this program's
#[derive(Clone, Debug, Args)]
struct PaperArguments {
    /// Search for the settings that come nearest to Table 1 instead; takes half an hour
    #[arg(long)]
    search: bool,
    #[command(flatten)]
    output: StudyOutput,
}

/// Put a topology's scene through every combination of memories, nodes and buses
///
/// Each list is one such as 1,4,9 or a range such as 1..16, 1..64x2 or 1/32..1/4. What is not given is as in the topology.
#[derive(Clone, Debug, Args)]
struct SweepArguments {
    /// Topology file (docs/topology.md), or a scene by itself, as for `marti run`
    topology: PathBuf,
    /// Set a key of the topology, such as scene.size=4
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<Override>,
    #[command(flatten)]
    grid: GridOptions,
    /// Also simulate the buses, in cycles of the topology's costs
    #[arg(long)]
    timings: bool,
    #[command(flatten)]
    output: StudyOutput,
}

#[derive(Clone, Debug, Args)]
struct StudyOutput {
    /// What is printed
    #[arg(long, value_enum, default_value_t = Format::Text)]
    format: Format,
    /// Folder that also gets study.html, with charts, study.csv and study.json
    #[arg(long, short, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print no progress
    #[arg(long, short)]
    quiet: bool,
}

/// What the folder gets. The page names the other two.
const FILES: [&str; 3] = ["study.json", "study.csv", "study.html"];

pub(super) fn study(arguments: &StudyArguments) -> Result<(), Failure> {
    match &arguments.study {
        Study::Paper(arguments) => study_paper(arguments),
        Study::Sweep(arguments) => study_sweep(arguments),
    }
}

fn study_paper(arguments: &PaperArguments) -> Result<(), Failure> {
    let output = &arguments.output;
    if arguments.search {
        return search_paper(output);
    }
    output.make_folder()?;
    let steps = Steps::new(output.quiet, paper::STEPS);
    let found = Paper::study(|what| steps.begin(what));
    steps.clear();
    let paper = found.map_err(|error| Failure::failed(error.to_string()))?;
    output.write(&paper, || paper::csv(&paper), || paper::page(&paper))?;
    print(&match output.format {
        Format::Text => paper::text(&paper),
        Format::Json => json(&paper)?,
        Format::Csv => paper::csv(&paper),
    })
}

fn search_paper(output: &StudyOutput) -> Result<(), Failure> {
    if output.out.is_some() || output.format == Format::Csv {
        return Err(Failure::bad_input("--search prints a table or JSON: expected it without --out and --format csv"));
    }
    let steps = Steps::new(output.quiet, paper::search::STEPS);
    let found = paper::Search::new(|what| steps.begin(what));
    steps.clear();
    let search = found.map_err(|error| Failure::failed(error.to_string()))?;
    print(&match output.format {
        Format::Json => json(&search)?,
        Format::Text | Format::Csv => paper::search_text(&search),
    })
}

fn study_sweep(arguments: &SweepArguments) -> Result<(), Failure> {
    let SweepArguments { output, grid, .. } = arguments;
    let timings = arguments.timings || grid.varies_times();
    let topology = subject::topology(&arguments.topology, &arguments.set)?;
    output.make_folder()?;
    if let Some(folder) = &output.out {
        let files = FILES.map(|name| folder.join(name));
        output_path::check_apart(&files.each_ref().map(|file| ("--out", file.as_path())), &[&arguments.topology])?;
    }
    let steps = Steps::new(output.quiet, sweep::STEPS);
    let found = Sweep::study(
        &topology,
        &grid.grid(),
        timings,
        |what| steps.begin(what),
        |warnings| scene_warnings::show(warnings),
    );
    steps.clear();
    let sweep = found.map_err(|error| Failure::bad_input(error.to_string()))?;
    let table = Table::new(&sweep.rows)?.hiding(if are_timed(&sweep.rows) { &[] } else { &[&TIMES] });
    let notes: String = reasons(&sweep.rows).iter().map(|reason| format!("\napproximate: {reason}\n")).collect();
    let text = || format!("{}\n{}{notes}", sweep.heading(), table.print(Format::Text, &SETTINGS));
    output.write(&sweep, || table.print(Format::Csv, &SETTINGS), || sweep::page(&sweep))?;
    print(&match output.format {
        Format::Text => text(),
        Format::Json => json(&sweep)?,
        Format::Csv => table.print(Format::Csv, &SETTINGS),
    })
}

impl StudyOutput {
    /// Before the work begins: where it cannot be, nothing is computed in vain.
    fn make_folder(&self) -> Result<(), Failure> {
        let Some(folder) = &self.out else { return Ok(()) };
        fs::create_dir_all(folder).map_err(|error| Failure::bad_input(format!("{}: {error}", folder.display())))
    }

    /// Into the folder, if there is to be one.
    fn write(
        &self,
        study: &impl Serialize,
        csv: impl FnOnce() -> String,
        page: impl FnOnce() -> Page,
    ) -> Result<(), Failure> {
        let Some(folder) = &self.out else { return Ok(()) };
        let texts = [json(study)?, csv(), page().html(&provenance::here())];
        for (name, text) in FILES.iter().zip(&texts) {
            atomic_file::write(&folder.join(name), |file| file.write_all(text.as_bytes()))
                .map_err(|error: io::Error| Failure::failed(error.to_string()))?;
        }
        if !self.quiet {
            outlet::say(format_args!("charts: {}", folder.join("study.html").display()));
        }
        Ok(())
    }
}
