//! `marti replay RECORDING`: one file a question that it answers.

mod combinations;
mod contention;
mod curve;
mod export;
mod import;
mod objects;
mod origins;
mod to_bus;

use std::path::PathBuf;

use clap::Args;

use self::combinations::{Given, Question, Subject};
use self::export::Export;
use self::import::ImportArguments;
use self::origins::HeatMap;
use self::to_bus::ToBus;
use super::grid_options::{GridOptions, OF_LINES, OF_RECORDINGS, SETTINGS, TIMES};
use super::table::{Format, Hidden, Table};
use super::{Failure, output_path, print};
use cluster::topology::recorded::open_references;
use ground::outlet;
use ground::progress::Parts;
use machine::hardware::local_memory::{Geometry, LINE_BYTES_MAX};
use machine::recording::references::Opened;
use machine::replay::model::evaluation::{Evaluation, Row, evaluate};
use machine::replay::plan::setting::{Assignment, Setting};
use machine::replay::stream::subject;

/// Simulate a recorded trace with other memories, policies, node counts and buses
///
/// Varied settings take a list such as 1,4,9 or a range such as 1..16, 1..64x2 or 1/32..1/4; every combination
/// is simulated. What is not given stays as recorded.
#[derive(Clone, Debug, Args)]
#[command(after_long_help = combinations::help())]
pub struct ReplayArguments {
    // First: the other fields take their options away.
    #[command(flatten)]
    given: Given,
    /// Folder of a run with `--record references`; or a trace from elsewhere: a file, or - for standard input
    pub recording: PathBuf,
    #[command(flatten)]
    grid: GridOptions,
    #[command(flatten)]
    asked: Asked,
    #[command(flatten)]
    import: ImportArguments,
    #[command(flatten)]
    to_bus: ToBus,
    /// How tables are printed
    #[arg(long, value_enum, default_value_t = Format::Text)]
    format: Format,
    /// The file for what is exported or drawn
    #[arg(long, short, alias = "output", value_name = "FILE")]
    out: Option<PathBuf>,
    /// Replay what is whole of a damaged recording
    #[arg(long)]
    partial: bool,
    /// Print no progress
    #[arg(long, short)]
    quiet: bool,
}

/// What is to be answered; without any, a table of counts.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Reports")]
struct Asked {
    /// Divide misses into compulsory, capacity and conflict misses
    #[arg(long)]
    classes: bool,
    /// Simulate the buses too, in cycles of the cost model
    #[arg(long)]
    timings: bool,
    /// Print the exact misses of LRU memories of all sizes, by node and of all nodes
    #[arg(long, group = "mode")]
    curve: bool,
    /// Recompute a sample of the curve by brute force
    #[arg(long)]
    verify: bool,
    /// Print how nodes fare that share a bus, simulated and by formula; default for --nodes: 1..256x2
    #[arg(long, group = "mode")]
    contention: bool,
    /// Print where misses come from: sections, octree levels, ray kinds, tiles
    #[arg(long, group = "mode")]
    origins: bool,
    /// Draw a picture of the image's pixels
    #[arg(long, value_name = "WHAT", value_enum, group = "mode", requires = "out")]
    heat_map: Option<HeatMap>,
    /// Write the references, or the simulated bus, for other tools
    #[arg(long, value_name = "FORMAT", value_enum, group = "mode", requires = "out")]
    export: Option<Export>,
    /// The node whose references are exported
    #[arg(long, value_name = "N")]
    node: Option<u16>,
}

impl Asked {
    fn question(&self, to_bus: &ToBus) -> Question {
        match self {
            _ if to_bus.is_asked() => Question::ToBus,
            Self { curve: true, .. } => Question::Curve,
            Self { contention: true, .. } => Question::Contention,
            Self { origins: true, .. } => Question::Origins,
            Self { heat_map: Some(HeatMap::Misses), .. } => Question::HeatMapMisses,
            Self { heat_map: Some(HeatMap::Octree), .. } => Question::HeatMapOctree,
            Self { export: Some(export), .. } => export.question(),
            _ => Question::Counts,
        }
    }
}

impl ReplayArguments {
    /// An output is of a question that writes one, and no file of the recording.
    fn check_output(&self) -> Result<(), Failure> {
        let Some(output) = &self.out else { return Ok(()) };
        let is_png = output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png"));
        if self.asked.heat_map.is_some() && !is_png {
            let what = format!("--out {}: a heat map is a picture, expected a name ending in .png", output.display());
            return Err(Failure::bad_input(what));
        }
        output_path::check(output)?;
        let read: Vec<PathBuf> = match self.recording.is_file() {
            true => vec![self.recording.clone()],
            false => [self.recording.clone(), self.recording.join("recording")]
                .iter()
                .filter_map(|folder| std::fs::read_dir(folder).ok())
                .flat_map(|files| files.flatten().map(|file| file.path()))
                .collect(),
        };
        output_path::check_apart(&[("--out", output)], &read.iter().map(PathBuf::as_path).collect::<Vec<_>>())
    }
}

pub(super) fn replay(arguments: &ReplayArguments) -> Result<(), Failure> {
    let is_trace = arguments.import.is_of(&arguments.recording);
    let subject = if is_trace { Subject::Trace } else { Subject::Recording };
    let question = arguments.asked.question(&arguments.to_bus);
    arguments.given.check(question, subject)?;
    arguments.check_output()?;
    match (question, subject) {
        (Question::ToBus, _) => arguments.to_bus.play(&arguments.recording, arguments.partial, arguments.format),
        (_, Subject::Trace | Subject::Objects) => replay_trace(arguments),
        (_, Subject::Recording) => replay_recording(arguments, question),
    }
}

fn replay_recording(arguments: &ReplayArguments, question: Question) -> Result<(), Failure> {
    let Opened { recording, faults } =
        open_references(&arguments.recording).map_err(|error| Failure::bad_input(error.to_string()))?;
    let damage = damage(&faults, arguments.partial)?;
    let recorded = Setting::recorded(&recording.conditions.cluster, recording.conditions.tile_order);
    let mut grid = arguments.grid.grid();
    if question == Question::Contention && grid.nodes.is_empty() && !grid.assignment.contains(&Assignment::Recorded) {
        grid.nodes = contention::NODES.to_vec();
    }
    let settings = grid.settings(recorded).map_err(Failure::bad_input)?;
    check_lines(&settings)?;
    let (Asked { heat_map, export, node, .. }, format) = (&arguments.asked, arguments.format);
    match (question, heat_map, export, &arguments.out) {
        (Question::Origins, ..) => origins::print_origins(&recording, &settings, format)?,
        (_, Some(what), _, Some(out)) => origins::draw(&recording, &settings, *what, out)?,
        (.., Some(export), Some(out)) => export::export(&recording, &settings, *export, *node, out)?,
        _ => return arguments.print(&recording, &settings, damage, &[&TIMES]),
    }
    print_approximate(damage.as_deref(), format)
}

/// Recordings have lines of as many bytes as live memories.
fn check_lines(settings: &[Setting]) -> Result<(), Failure> {
    let checked = settings.iter().try_for_each(|setting| Geometry::check_line(setting.line, LINE_BYTES_MAX));
    checked.map_err(|error| Failure::bad_input(format!("--line: {error}")))
}

/// What a trace without tiles and rays can answer.
fn replay_trace(arguments: &ReplayArguments) -> Result<(), Failure> {
    let mut settings = arguments.grid.grid().settings(Setting::imported()).map_err(Failure::bad_input)?;
    let imported = arguments.import.import(&arguments.recording, &mut settings, &arguments.given)?;
    match imported.is_of_objects() {
        true if !arguments.import.ignores_object_sizes() => {
            arguments.given.check(arguments.asked.question(&arguments.to_bus), Subject::Objects)?;
            objects::print_objects(&imported, &settings, arguments.format, arguments.quiet)
        }
        true => arguments.print(&imported, &settings, None, &[&OF_LINES, &OF_RECORDINGS, &TIMES]),
        false => arguments.print(&imported, &settings, None, &[&OF_RECORDINGS, &TIMES]),
    }
}

impl ReplayArguments {
    /// Curves, contention, or the table of counts.
    fn print<S: subject::Subject>(
        &self,
        subject: &S,
        settings: &[Setting],
        damage: Option<String>,
        hidden: Hidden,
    ) -> Result<(), Failure> {
        let Asked { curve, verify, contention, timings, classes, .. } = self.asked;
        if curve {
            return curve::print_curves(subject, settings, self.format, verify, damage.is_some(), hidden);
        }
        if contention {
            contention::print_contention(subject, settings, self.format, self.quiet)?;
            return print_approximate(damage.as_deref(), self.format);
        }
        let writing = self.import.writing();
        let evaluation = Evaluation { timings: timings || self.grid.varies_times(), classes, damage, writing };
        let parts = Parts::new(self.quiet, "nodes");
        let rows = evaluate(subject, settings, &evaluation, |all| parts.done(all));
        parts.clear();
        let rows = rows.map_err(|error| Failure::bad_input(error.to_string()))?;
        print_rows(&rows, self.format, if are_timed(&rows) { &[] } else { hidden })
    }
}

/// Whether any of the rows has cycles, which on-demand assignment always has.
pub(super) fn are_timed(rows: &[Row]) -> bool {
    rows.iter().any(|row| row.cycles.is_some())
}

/// Why rows are approximate, each reason once.
pub(super) fn reasons(rows: &[Row]) -> Vec<&str> {
    let mut reasons: Vec<&str> = rows.iter().filter_map(|row| row.reason.as_deref()).collect();
    reasons.sort_unstable();
    reasons.dedup();
    reasons
}

fn print_rows(rows: &[Row], format: Format, hidden: Hidden) -> Result<(), Failure> {
    print(&Table::new(rows)?.hiding(hidden).print(format, &SETTINGS))?;
    reasons(rows).into_iter().try_for_each(|reason| print_approximate(Some(reason), format))
}

/// Below what is printed for people; for programs it is a column, or a warning on standard error.
fn print_approximate(reason: Option<&str>, format: Format) -> Result<(), Failure> {
    match (reason, format) {
        (Some(reason), Format::Text) => print(&format!("\napproximate: {reason}\n")),
        _ => Ok(()),
    }
}

/// Why nothing that comes of a damaged recording is exact.
fn damage(faults: &[String], partial: bool) -> Result<Option<String>, Failure> {
    if faults.is_empty() {
        return Ok(None);
    }
    if !partial {
        let told = faults.iter().map(|fault| format!("\n  {fault}")).collect::<String>();
        return Err(Failure::bad_input(format!(
            "the recording is damaged; --partial replays what is whole of it{told}"
        )));
    }
    for fault in faults {
        outlet::say(format_args!("warning: {fault}"));
    }
    Ok(Some(format!("the recording is damaged: {}", faults.join("; "))))
}
