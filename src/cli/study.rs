//! `marti study paper`, `marti study sweep TOPOLOGY`

use clap::{Args, Subcommand, ValueEnum};

use super::{Failure, json, print};
use crate::progress::Steps;
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
    let StudyOutput { format, quiet } = arguments.output;
    let steps = Steps::new(quiet, paper::STEPS);
    let found = Paper::study(|what| steps.begin(what));
    steps.clear();
    let paper = found.map_err(|error| Failure::failed(error.to_string()))?;
    print(&match format {
        Format::Text => paper::text(&paper),
        Format::Json => json(&paper)?,
        Format::Csv => paper::csv(&paper),
    })
}
