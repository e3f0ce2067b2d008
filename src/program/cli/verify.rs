//! `marti verify`

use std::fmt;

use clap::{Args, value_parser};
use serde::Serialize;

use super::options::{OctreeOptions, RecordOptions};
use super::{Failure, print, watertight};
use cluster::processes::scene_warnings;
use cluster::report::incident;
use trace::database::RecordLayout;
use trace::oracle::{self, AimedAt, Outcomes, Verification};
use trace::picture::ImageSettings;
use trace::preparation::{self, BuildChoices, ViewChoices};
use trace::scene::Placement;
use trace::scene::SceneSource;
use trace::tracer::octree::Octree;

/// Shoot rays through the tracer and through brute force in exact arithmetic, and count where they differ
///
/// Every ray goes through each kernel: hero, one ray at a time, and wide, in batches, with every set of vector
/// instructions that this processor has. All have to give the same bits.
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
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

pub(super) fn verify(arguments: &VerifyArguments) -> Result<(), Failure> {
    let octree = arguments.octree.octree(Octree::DEFAULT);
    match &arguments.scene {
        Some(source) => verify_scene(arguments, source, BuildChoices { octree, records: arguments.records.layout()? }),
        // Closed meshes consist of triangles.
        None if arguments.records.layout()? != RecordLayout::DEFAULT => {
            Err(Failure::bad_input("--records, --numbers and --record-bytes are of a scene, expected one"))
        }
        None => watertight::verify(arguments.rays, arguments.seed, octree, arguments.json),
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
    if arguments.json {
        print(&super::json(&report)?)?;
    } else {
        print(&report.to_string())?;
    }
    let mut faults = Outcomes::default();
    for kernel in &report.verification.kernels {
        faults.sum(&kernel.total);
    }
    if report.verification.holds() {
        Ok(())
    } else {
        Err(Failure::failed(format!(
            "{} lost hits, {} false hits, {} self-hits, {} answers that are not HERO's",
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

impl fmt::Display for Report {
    /// A row a kernel, and what HERO's rays were aimed at; JSON has that of every kernel.
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Placement { scale, translation } = self.placement;
        writeln!(out, "scene     {}, scaled by {scale:e}, moved by {translation:e}", incident::line(&self.scene))?;
        let kernels = &self.verification.kernels;
        write_head(out, "kernel")?;
        for kernel in kernels {
            write_row(out, &kernel.kernel.to_string(), &kernel.total)?;
        }
        if let Some(hero) = kernels.first() {
            writeln!(out)?;
            write_head(out, "hero, at")?;
            for aim in AimedAt::ALL {
                write_row(out, aim.name(), &hero.by_aim[aim as usize])?;
            }
        }
        for d in &self.verification.disagreements {
            writeln!(
                out,
                "{}, {:?}: from {:?} along {:?} found {:?}, expected {:?} of {:?}",
                d.kernel, d.fault, d.origin, d.direction, d.found, d.nearest, d.candidates
            )?;
        }
        Ok(())
    }
}

fn write_head(out: &mut fmt::Formatter<'_>, first: &str) -> fmt::Result {
    write!(out, "{first:<12}")?;
    for column in ["rays", "hits", "agreeing", "lost", "false", "other", "self-hits", "differing", "depth error"] {
        write!(out, "{column:>12}")?;
    }
    writeln!(out)
}

fn write_row(out: &mut fmt::Formatter<'_>, name: &str, c: &Outcomes) -> fmt::Result {
    write!(out, "{name:<12}")?;
    for count in [c.rays, c.hits, c.agreeing, c.lost, c.false_hits, c.other_primitive, c.self_hits, c.differing] {
        write!(out, "{count:>12}")?;
    }
    writeln!(out, "{:>12.2e}", c.worst_depth_error)
}
