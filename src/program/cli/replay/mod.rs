//! `marti replay RECORDING`: one file a question that it answers.

mod contention;
mod curve;
mod export;
mod import;
mod origins;
mod to_bus;

use std::path::PathBuf;

use clap::Args;

use self::export::Export;
use self::import::ImportArguments;
use self::origins::HeatMap;
use self::to_bus::ToBus;
use super::grid_options::{GridOptions, SETTINGS};
use super::table::{Format, Table};
use super::{Failure, output_path, print};
use cluster::topology::recorded::open_references;
use ground::outlet;
use ground::progress::Parts;
use machine::hardware::local_memory::{Geometry, LINE_BYTES_MAX};
use machine::recording::references::Opened;
use machine::replay::model::evaluation::{Evaluation, Row, evaluate};
use machine::replay::plan::setting::Setting;
use machine::replay::stream::subject::Subject;

/// Put recorded references through other memories, node counts and buses
///
/// Options of what is varied take a list such as 1,4,9 or a range such as 1..16, 1..64x2 or 1/32..1/4; every combination
/// is simulated. What is not given stays as recorded.
#[derive(Clone, Debug, Args)]
pub struct ReplayArguments {
    /// Folder of a run with `--record references`; or a trace of others: a file, or - for standard input
    pub recording: PathBuf,
    #[command(flatten)]
    grid: GridOptions,
    #[command(flatten)]
    question: Question,
    #[command(flatten)]
    import: ImportArguments,
    #[command(flatten)]
    to_bus: ToBus,
    /// How tables are printed
    #[arg(long, value_enum, default_value_t = Format::Text)]
    format: Format,
    /// The file for what is exported or drawn
    #[arg(long, short, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Replay what is whole of a damaged recording
    #[arg(long)]
    partial: bool,
}

/// What is to be answered; without any, a table of counts.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "What is asked")]
struct Question {
    /// Also divide misses into compulsory, capacity and conflict misses
    #[arg(long)]
    classes: bool,
    /// Also simulate the buses, in cycles of the recorded cost model
    #[arg(long)]
    timings: bool,
    /// Print the exact misses of LRU memories of all sizes, by node and of all nodes
    #[arg(long, group = "mode")]
    curve: bool,
    /// Recompute a sample of the curve by brute force
    #[arg(long, requires = "curve")]
    verify: bool,
    /// Print how nodes fare that share a bus, simulated and by formula; default for --nodes: 1..256x2
    #[arg(long, group = "mode")]
    contention: bool,
    /// Print where misses come from: sections, octree levels, ray kinds, tiles
    #[arg(long, group = "mode")]
    origins: bool,
    /// Draw a picture of the image's pixels
    #[arg(long, value_name = "WHAT", value_enum, group = "mode", requires = "output")]
    heat_map: Option<HeatMap>,
    /// Write the references, or the simulated bus, for other tools
    #[arg(long, value_name = "FORMAT", value_enum, group = "mode", requires = "output")]
    export: Option<Export>,
    /// The node whose references are exported
    #[arg(long, value_name = "N", requires = "export")]
    node: Option<u16>,
}

impl ReplayArguments {
    /// An output is of a question that writes one, and no file of the recording.
    fn check_output(&self) -> Result<(), Failure> {
        let Some(output) = &self.output else { return Ok(()) };
        if self.question.export.is_none() && self.question.heat_map.is_none() {
            return Err(Failure::bad_input("--output has no effect without --export or --heat-map"));
        }
        let is_png = output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png"));
        if self.question.heat_map.is_some() && !is_png {
            let what =
                format!("--output {}: a heat map is a picture, expected a name ending in .png", output.display());
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
        output_path::check_apart(&[("--output", output)], &read.iter().map(PathBuf::as_path).collect::<Vec<_>>())
    }
}

pub(super) fn replay(arguments: &ReplayArguments) -> Result<(), Failure> {
    arguments.check_output()?;
    let is_imported = arguments.import.are_for(&arguments.recording);
    if !is_imported || arguments.to_bus.is_asked() {
        arguments.import.check_absent()?;
    }
    if arguments.to_bus.is_asked() {
        return arguments.to_bus.play(&arguments.recording, arguments.partial, arguments.format);
    }
    if is_imported {
        return replay_imported(arguments);
    }
    let Opened { recording, faults } =
        open_references(&arguments.recording).map_err(|error| Failure::bad_input(error.to_string()))?;
    let damage = damage(&faults, arguments.partial)?;
    let settings =
        arguments.settings(Setting::recorded(&recording.conditions.cluster, recording.conditions.tile_order))?;
    check_lines(&settings)?;
    let (question, format) = (&arguments.question, arguments.format);
    match (question.origins, question.heat_map, question.export, &arguments.output) {
        (true, ..) => origins::print_origins(&recording, &settings, format)?,
        (_, Some(what), _, Some(out)) => origins::draw(&recording, &settings, what, out)?,
        (.., Some(export), Some(out)) => export::export(&recording, &settings, export, question.node, out)?,
        _ => return arguments.print(&recording, &settings, damage),
    }
    print_approximate(damage.as_deref(), format)
}

/// Recordings have lines of as many bytes as live memories.
fn check_lines(settings: &[Setting]) -> Result<(), Failure> {
    let checked = settings.iter().try_for_each(|setting| Geometry::check_line(setting.line, LINE_BYTES_MAX));
    checked.map_err(|error| Failure::bad_input(format!("--line: {error}")))
}

/// What a trace without tiles and rays can answer.
fn replay_imported(arguments: &ReplayArguments) -> Result<(), Failure> {
    let Question { origins, heat_map, export, .. } = &arguments.question;
    if *origins || heat_map.is_some() || export.is_some() {
        return Err(Failure::bad_input("a trace of others has no tiles, rays or sections: expected a recording"));
    }
    if arguments.partial {
        return Err(Failure::bad_input("--partial: a trace of others is read whole, expected a recording"));
    }
    let settings = arguments.settings(Setting::imported())?;
    if settings.iter().any(|setting| setting.all_nodes() > 1) {
        return Err(Failure::bad_input("a trace of others is that of one node: expected one node and one cluster"));
    }
    let line_bytes = settings.iter().map(|setting| setting.line).min().unwrap_or(Setting::imported().line);
    let imported = arguments.import.import(&arguments.recording, line_bytes)?;
    arguments.print(&imported, &settings, None)
}

impl ReplayArguments {
    fn settings(&self, recorded: Setting) -> Result<Vec<Setting>, Failure> {
        self.grid.grid().settings(recorded).map_err(Failure::bad_input)
    }

    /// Curves, contention, or the table of counts.
    fn print<S: Subject>(&self, subject: &S, settings: &[Setting], damage: Option<String>) -> Result<(), Failure> {
        let Question { curve, verify, contention, timings, classes, .. } = self.question;
        if curve {
            return curve::print_curves(subject, settings, self.format, verify, damage.is_some());
        }
        if contention {
            contention::print_contention(subject, settings, self.grid.has_nodes(), self.format)?;
            return print_approximate(damage.as_deref(), self.format);
        }
        let evaluation = Evaluation { timings: timings || self.grid.varies_bus(), classes, damage };
        let parts = Parts::new("nodes");
        let rows = evaluate(subject, settings, &evaluation, |all| parts.done(all));
        parts.clear();
        print_rows(&rows.map_err(|error| Failure::bad_input(error.to_string()))?, self.format)
    }
}

fn print_rows(rows: &[Row], format: Format) -> Result<(), Failure> {
    let mut reasons: Vec<&str> = rows.iter().filter_map(|row| row.reason.as_deref()).collect();
    reasons.sort_unstable();
    reasons.dedup();
    print(&Table::new(rows)?.print(format, &SETTINGS))?;
    reasons.into_iter().try_for_each(|reason| print_approximate(Some(reason), format))
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
