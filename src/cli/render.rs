//! `marti render SCENE`

use std::path::PathBuf;

use clap::{Args, value_parser};

use super::Failure;
use super::options::{ImageSize, OctreeOptions, OutputOptions, Switch, png_path};
use crate::topology::value::{Cutoff, Depth};
use crate::topology::{Octree, SceneSource};
use crate::tracer::view::ImageSettings;

/// Render a scene in this one process: the fastest way on one machine
#[derive(Clone, Debug, Args)]
pub struct RenderArguments {
    /// An .nff or .obj file, or gears, teapot, balls, tetra, also with a size as in gears:2
    pub scene: SceneSource,
    /// Image to write [default: the scene's name with .png]
    #[arg(long, short, value_name = "NAME.png", value_parser = png_path)]
    output: Option<PathBuf>,
    /// Pixels of the image [default: the scene file's resolution, else 512x512]
    #[arg(long, value_name = "WxH")]
    pub size: Option<ImageSize>,
    /// Threads that trace [default: one a processor]
    #[arg(long, value_name = "N", value_parser = value_parser!(u32).range(1..=1024))]
    pub threads: Option<u32>,
    /// Render so many times; the seconds reported are medians
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = value_parser!(u32).range(1..=1000))]
    pub repeat: u32,
    /// How many reflections or refractions may follow one another
    #[arg(long, value_name = "N", default_value_t = Depth(ImageSettings::DEPTH_DEFAULT))]
    pub depth: Depth,
    /// A reflected or refracted ray is cast when its weight in the pixel exceeds this
    #[arg(long, value_name = "X", default_value_t = Cutoff(0.0), allow_negative_numbers = true)]
    pub cutoff: Cutoff,
    #[command(flatten)]
    octree: OctreeOptions,
    /// Test a primitive that stands in many leaves only once a ray
    #[arg(long, value_enum, default_value_t = Switch::On)]
    mailbox: Switch,
    #[command(flatten)]
    pub planes: OutputOptions,
    /// Also write a report as JSON (docs/report.md)
    #[arg(long, value_name = "FILE.json")]
    pub report: Option<PathBuf>,
}

impl RenderArguments {
    pub fn octree(&self) -> Octree {
        self.octree.octree(self.mailbox == Switch::On)
    }

    /// The image to write.
    pub fn image(&self) -> PathBuf {
        self.output.clone().unwrap_or_else(|| PathBuf::from(self.scene.name() + ".png"))
    }
}

pub(super) fn render(arguments: &RenderArguments) -> Result<(), Failure> {
    Err(Failure::failed(format!("not built yet: rendering {} to {}", arguments.scene, arguments.image().display())))
}
