//! `marti verify SCENE`

use std::fmt::Write;

use clap::Args;
use serde::Serialize;

use super::options::OctreeOptions;
use super::{Failure, print};
use crate::oracle::{self, AimedAt, Verification};
use crate::preparation::{self, Fallback};
use crate::scene::Placement;
use crate::topology::{Octree, SceneSource};
use crate::tracer::view::ImageSettings;

/// Shoot rays through the tracer and through brute force in exact arithmetic, and count where they differ
#[derive(Clone, Debug, Args)]
pub struct VerifyArguments {
    /// An .nff or .obj file, or gears, teapot, balls, tetra, slivers, plane, decades, giant, corner, also with a size as in gears:2
    pub scene: SceneSource,
    /// Rays to shoot: through pixels, anywhere, along axes, at edges and vertices, from surfaces
    #[arg(long, value_name = "N", default_value_t = 100_000)]
    rays: u64,
    /// The same seed gives the same rays
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// Multiply the scene's coordinates by this before it is compiled
    #[arg(long, value_name = "S", default_value_t = 1.0, value_parser = positive)]
    scale: f64,
    /// Add this to the scene's coordinates, on every axis and after scaling
    #[arg(long, value_name = "X", default_value_t = 0.0, allow_negative_numbers = true, value_parser = finite)]
    translate: f64,
    #[command(flatten)]
    octree: OctreeOptions,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

pub(super) fn verify(arguments: &VerifyArguments) -> Result<(), Failure> {
    let mut scene = preparation::load(&arguments.scene)?;
    let placement = Placement { scale: arguments.scale, translation: arguments.translate };
    scene.place(placement).map_err(|error| Failure::bad_input(error.to_string()))?;
    let image = |_: &_| Ok(ImageSettings { width: 1000, height: 1000, depth: 0, cutoff: 0.0 });
    let view = preparation::view(&scene, &Fallback::default(), image).map_err(Failure::bad_input)?;
    let octree = arguments.octree.octree(Octree::DEFAULT.mailbox);
    let database = preparation::build(&arguments.scene, scene, octree)?;
    let verification = oracle::verify(&database, &view, arguments.rays, arguments.seed);
    let report = Report { scene: arguments.scene.to_string(), placement, seed: arguments.seed, verification };
    if arguments.json {
        let json = serde_json::to_string_pretty(&report).map_err(|error| Failure::failed(error.to_string()))?;
        print(&(json + "\n"))?;
    } else {
        print(&report.text())?;
    }
    let total = &report.verification.total;
    if report.verification.holds() {
        Ok(())
    } else {
        Err(Failure::failed(format!("{} lost hits, {} false hits", total.lost, total.false_hits)))
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

impl Report {
    fn text(&self) -> String {
        let mut text = String::new();
        // Writing to a string cannot fail.
        let _ = self.write(&mut text);
        text
    }

    fn write(&self, out: &mut String) -> std::fmt::Result {
        let Placement { scale, translation } = self.placement;
        writeln!(out, "scene     {}, scaled by {scale:e}, moved by {translation:e}", self.scene)?;
        let columns = ["rays", "hits", "agreeing", "lost", "false", "other", "self-hits", "depth error"];
        write!(out, "{:<12}", "aimed at")?;
        for column in columns {
            write!(out, "{column:>12}")?;
        }
        writeln!(out)?;
        let rows = AimedAt::ALL.map(|aim| (aim.name(), &self.verification.by_aim[aim as usize]));
        for (name, c) in rows.into_iter().chain([("all", &self.verification.total)]) {
            let counts = [c.rays, c.hits, c.agreeing, c.lost, c.false_hits, c.other_primitive, c.self_hits];
            write!(out, "{name:<12}")?;
            for count in counts {
                write!(out, "{count:>12}")?;
            }
            writeln!(out, "{:>12.2e}", c.worst_depth_error)?;
        }
        for d in &self.verification.disagreements {
            writeln!(
                out,
                "from {:?} along {:?}: found {:?}, expected {:?} of {:?}",
                d.origin, d.direction, d.found, d.nearest, d.candidates
            )?;
        }
        Ok(())
    }
}
