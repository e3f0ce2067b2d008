//! `marti study paper`, `marti study sweep TOPOLOGY`

use std::fs;
use std::io::{self, Write};
use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};

use serde::Serialize;

use super::{Failure, json, print};
use crate::atomic_file;
use crate::progress::Steps;
use crate::study::page::Page;
use crate::study::paper::{self, Paper};

/// Trace scenes once and replay them through many clusters
#[derive(Clone, Debug, Args)]
pub struct StudyArguments {
    #[command(subcommand)]
    study: Study,
}

#[derive(Clone, Debug, Subcommand)]
enum Study {
    Paper(PaperArguments),
}

/// Print the 1991 paper's figures beside this program's
#[derive(Clone, Debug, Args)]
struct PaperArguments {
    #[command(flatten)]
    output: StudyOutput,
}

#[derive(Clone, Debug, Args)]
struct StudyOutput {
    /// What is printed
    #[arg(long, value_enum, default_value_t = Format::Text)]
    format: Format,
    /// Folder that also gets study.html, with plots, and study.json
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print no progress
    #[arg(long, short)]
    quiet: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Format {
    Text,
    Json,
    Csv,
}

pub(super) fn study(arguments: &StudyArguments) -> Result<(), Failure> {
    match &arguments.study {
        Study::Paper(arguments) => study_paper(arguments),
    }
}

fn study_paper(arguments: &PaperArguments) -> Result<(), Failure> {
    let output = &arguments.output;
    let steps = Steps::new(output.quiet, paper::STEPS);
    let found = Paper::study(|what| steps.begin(what));
    steps.clear();
    let paper = found.map_err(|error| Failure::failed(error.to_string()))?;
    output.write(&paper, || paper::page(&paper))?;
    print(&match output.format {
        Format::Text => paper::text(&paper),
        Format::Json => json(&paper)?,
        Format::Csv => paper::csv(&paper),
    })
}

impl StudyOutput {
    /// Into the folder, if there is to be one.
    fn write(&self, study: &impl Serialize, page: impl FnOnce() -> Page) -> Result<(), Failure> {
        let Some(folder) = &self.out else { return Ok(()) };
        let failed = |error: io::Error| Failure::failed(error.to_string());
        fs::create_dir_all(folder).map_err(|error| Failure::failed(format!("{}: {error}", folder.display())))?;
        let json = json(study)?;
        atomic_file::write(&folder.join("study.json"), |file| file.write_all(json.as_bytes())).map_err(failed)?;
        let html = page().to_string();
        atomic_file::write(&folder.join("study.html"), |file| file.write_all(html.as_bytes())).map_err(failed)
    }
}
