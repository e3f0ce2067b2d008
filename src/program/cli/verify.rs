//! `marti verify`

use clap::{Args, value_parser};
use serde::Serialize;

use super::options::{OctreeOptions, RecordOptions};
use super::table::{Format, Table};
use super::{Failure, json, print, watertight};
use cluster::processes::scene_warnings;
use cluster::report::incident;
use trace::database::RecordLayout;
use trace::oracle::{self, AimedAt, KernelOutcomes, Outcomes, Verification};
use trace::picture::ImageSettings;
use trace::preparation::{self, BuildChoices, ViewChoices};
use trace::scene::Placement;
use trace::scene::SceneSource;
use trace::tracer::octree::Octree;

/// Shoot rays through the tracer and through brute force in exact arithmetic, and count where they differ
///
/// Every ray goes through each kernel: single, one ray at a time, and packets, with every set of vector instructions
/// that this processor has. All have to give the same bits.
#[derive(Clone, Debug, Args)]
#[command(override_usage = "marti verify [OPTIONS] <SCENE>\n       marti verify [OPTIONS] --watertight")]
pub struct VerifyArguments {
    /// An .nff or .obj file, or gears, teapot, balls, tetra, slivers, plane, decades, giant, corner, also with a size as in gears:2
    #[arg(required_unless_present = "watertight", conflicts_with = "watertight")]
    pub scene: Option<SceneSource>,
    /// Instead of a scene: rays from inside of closed meshes, aimed exactly at their edges and vertices, of which
    /// none may escape; they are dealt out to the kernels
    #[arg(long)]
    watertight: bool,
    /// Rays to shoot: through pixels, anywhere, along axes, at edges and vertices, from surfaces
    #[arg(long, value_name = "N", default_value_t = 100_000, value_parser = value_parser!(u64).range(1..))]
    rays: u64,
    /// The same seed gives the same rays
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// Multiply the scene's coordinates by this before it is compiled
    #[arg(long, value_name = "S", default_value_t = 1.0, value_parser = positive, conflicts_with = "watertight")]
    scale: f64,
    /// Add this to the scene's coordinates, on every axis and after scaling
    #[arg(
        long,
        value_name = "X",
        default_value_t = 0.0,
        allow_negative_numbers = true,
        value_parser = finite,
        conflicts_with = "watertight"
    )]
    translate: f64,
    #[command(flatten)]
    octree: OctreeOptions,
    #[command(flatten)]
    records: RecordOptions,
    /// How the result is printed
    #[arg(long, value_enum, default_value_t = Format::Text, conflicts_with = "quiet")]
    format: Format,
    /// As --format json
    #[arg(long, hide = true, conflicts_with_all = ["format", "quiet"])]
    json: bool,
    /// Print no progress and no result: the exit code is 0 if no ray is wrong
    #[arg(long, short)]
    quiet: bool,
}

/// Columns that name a row.
const SETTINGS: [&str; 2] = ["kernel", "aimed_at"];

impl VerifyArguments {
    /// `None`: nothing is printed.
    fn printed(&self) -> Option<Format> {
        let format = if self.json { Format::Json } else { self.format };
        Some(format).filter(|_| !self.quiet)
    }
}

pub(super) fn verify(arguments: &VerifyArguments) -> Result<(), Failure> {
    let octree = arguments.octree.octree(Octree::DEFAULT);
    match &arguments.scene {
        Some(source) => verify_scene(arguments, source, BuildChoices { octree, records: arguments.records.layout()? }),
        // Closed meshes consist of triangles.
        None if arguments.records.layout()? != RecordLayout::DEFAULT => {
            Err(Failure::bad_input("--records, --numbers and --record-bytes are of a scene, expected one"))
        }
        None => watertight::verify(arguments.rays, arguments.seed, octree, arguments.printed()),
    }
}

fn verify_scene(arguments: &VerifyArguments, source: &SceneSource, choices: BuildChoices) -> Result<(), Failure> {
    let mut scene = source.load()?;
    let placement = Placement { scale: arguments.scale, translation: arguments.translate };
    scene.place(placement).map_err(|error| Failure::bad_input(error.to_string()))?;
    let image = |_: &_| ImageSettings::new(1000, 1000, 0, 0.0).map_err(|error| error.to_string());
    let chosen = preparation::choose(&scene, &ViewChoices::default(), image).map_err(Failure::bad_input)?;
    let (database, warnings) = preparation::build(source, scene, choices)?;
    scene_warnings::show(warnings.iter().chain(&chosen.warnings));
    let verification = oracle::verify(&database, &chosen.view, arguments.rays, arguments.seed);
    let report = Report { scene: source.to_string(), placement, seed: arguments.seed, verification };
    arguments.printed().map_or(Ok(()), |format| report.print(format))?;
    let mut faults = Outcomes::default();
    for kernel in &report.verification.kernels {
        faults.sum(&kernel.total);
    }
    if report.verification.holds() {
        Ok(())
    } else {
        Err(Failure::failed(format!(
            "{} lost hits, {} false hits, {} self-hits, {} answers that differ from those of the single kernel",
            faults.lost, faults.false_hits, faults.self_hits, faults.differing
        )))
    }
}

fn positive(text: &str) -> Result<f64, String> {
    finite(text).ok().filter(|&scale| scale > 0.0).ok_or_else(|| "expected a positive number".to_owned())
}

fn finite(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|x: &f64| x.is_finite()).ok_or_else(|| "expected a finite number".to_owned())
}

#[derive(Clone, Debug, PartialEq, Serialize)]
struct Report {
    scene: String,
    placement: Placement,
    seed: u64,
    #[serde(flatten)]
    verification: Verification,
}

/// What came of a kernel's rays: of all, or of those that were aimed at something.
#[derive(Serialize)]
struct Row {
    kernel: String,
    aimed_at: &'static str,
    #[serde(flatten)]
    outcomes: Outcomes,
}

impl Row {
    /// A row per kernel.
    fn of_kernels(verification: &Verification) -> Vec<Self> {
        let row = |of: &KernelOutcomes| Self { kernel: of.kernel.to_string(), aimed_at: "all", outcomes: of.total };
        verification.kernels.iter().map(row).collect()
    }

    /// A row per thing that a kernel's rays were aimed at.
    fn of_aims(of: &KernelOutcomes) -> impl Iterator<Item = Self> + '_ {
        AimedAt::ALL.into_iter().map(move |aim| Self {
            kernel: of.kernel.to_string(),
            aimed_at: aim.name(),
            outcomes: of.by_aim[aim as usize],
        })
    }
}

impl Report {
    fn print(&self, format: Format) -> Result<(), Failure> {
        let Verification { kernels, disagreements } = &self.verification;
        let mut rows = Row::of_kernels(&self.verification);
        match format {
            Format::Json => return print(&json(self)?),
            Format::Csv => {
                rows.extend(kernels.iter().flat_map(Row::of_aims));
                return print(&Table::new(&rows)?.print(Format::Csv, &SETTINGS));
            }
            Format::Text => {}
        }
        let Placement { scale, translation } = self.placement;
        let scene = incident::line(&self.scene);
        let mut text = format!("scene {scene}, scaled by {scale:e}, moved by {translation:e}\n\n");
        text += &Table::new(&rows)?.hiding(&[&["aimed_at"]]).print(Format::Text, &SETTINGS);
        if let Some(first) = kernels.first() {
            text += "\n";
            text += &Table::new(&Row::of_aims(first).collect::<Vec<_>>())?.print(Format::Text, &SETTINGS);
        }
        for d in disagreements {
            text += &format!(
                "{}, {:?}: from {:?} along {:?} found {:?}, expected {:?} of {:?}\n",
                d.kernel, d.fault, d.origin, d.direction, d.found, d.nearest, d.candidates
            );
        }
        print(&text)
    }
}
