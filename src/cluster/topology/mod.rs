//! A topology file: read as written in [`mod@file`], proven into a [`Topology`]. Nothing after it checks again.

mod document;
mod effect;
pub mod file;
pub mod host;
pub mod host_file;
pub mod overrides;
pub mod placement;
mod prove;
mod prove_hosts;
mod read;
pub mod recorded;
mod scene_topology;
pub mod schema;
mod settings;
pub mod value;
mod write;

use std::time::Duration;

pub use host::{Host, Launch};
pub use overrides::Override;
pub use placement::Placement;

use machine::hardware::specification::Cluster;
use machine::tile_order::{Assignment, TileOrder};
use trace::database::RecordLayout;
use trace::picture::{ImageSettings, Sides, Terminator, Tiling, TilingError};
use trace::preparation::{self, BuildChoices, ImageDefaults, PreparationError, Prepared, ViewChoices};
use trace::scene::SceneSource;
use trace::tracer::octree::Octree;

/// A proven topology: every value is within its range, every combination possible.
#[derive(Clone, Debug, PartialEq)]
pub struct Topology {
    /// The file's stem; names the output folder.
    pub name: String,
    pub scene: SceneSource,
    /// What it says of the view; the rest is the scene's.
    pub view: ViewChoices,
    pub image: Image,
    pub octree: Octree,
    pub records: RecordLayout,
    pub cluster: Cluster,
    /// The first is the manager's own; empty: everything is there, on the loopback interface.
    pub hosts: Vec<Host>,
    pub run: Run,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Image {
    /// `None`: the scene file's resolution, else 512.
    pub width: Option<u32>,
    pub height: Option<u32>,
    /// Pixels, at most the image.
    pub tile: (u32, u32),
    pub depth: u32,
    pub cutoff: f32,
    /// `None`: as is usual for the scene's kind of file.
    pub terminator: Option<Terminator>,
}

impl Image {
    /// Checks the tile against what is known of the image's sides.
    fn check_tile(&self, width: Option<u32>, height: Option<u32>) -> Result<(), String> {
        let (tile_width, tile_height) = self.tile;
        let (width_max, height_max) =
            (width.unwrap_or(ImageSettings::SIDE_MAX), height.unwrap_or(ImageSettings::SIDE_MAX));
        if tile_width > width_max || tile_height > height_max {
            return Err(format!(
                "image.tile is {tile_width}x{tile_height} pixels, expected at most the image's {width_max}x{height_max}"
            ));
        }
        if let (Some(width), Some(height)) = (width, height) {
            self.tiling(width, height).map(drop)?;
        }
        Ok(())
    }

    /// The image settings of a scene with these defaults, whatever the tiles.
    ///
    /// # Errors
    /// A setting is beyond what an image can have; those of a proven topology are not.
    pub fn settings(&self, defaults: &ImageDefaults) -> Result<ImageSettings, String> {
        let (width, height) = defaults.resolution;
        let (width, height) = (self.width.unwrap_or(width), self.height.unwrap_or(height));
        let settings = ImageSettings::new(width, height, self.depth, self.cutoff).map_err(|error| error.to_string())?;
        Ok(settings.with_terminator(self.terminator.unwrap_or(defaults.terminator)))
    }

    /// The tiles of an image of these sides.
    ///
    /// # Errors
    /// There would be too many.
    pub fn tiling(&self, width: u32, height: u32) -> Result<Tiling, String> {
        let (tile_width, tile_height) = self.tile;
        Tiling::try_from(Sides { width, height, tile_width, tile_height }).map_err(|error| match error {
            TilingError::TooManyTiles { tiles, .. } => format!(
                "image.tile is {tile_width}x{tile_height} pixels, which makes {tiles} tiles, expected at most {}",
                Tiling::TILES_MAX
            ),
            error @ TilingError::Side { .. } => error.to_string(),
        })
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Run {
    pub order: TileOrder,
    pub assignment: Assignment,
    /// Seeds random replacement, random tile order, and the choice of tiles that are verified.
    pub seed: u64,
    /// Share of the tiles that is rendered twice, by different nodes, and compared, 0 to 1.
    pub verify: f64,
    /// Threads of a node, `cluster.threads`; more than one where it has the whole database.
    pub threads: u16,
    pub deadlines: Deadlines,
}

/// How long to wait before a silent process counts as dead.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Deadlines {
    /// From spawning a process until it is connected and configured.
    pub startup: Duration,
    /// Between two signs of life on a control connection.
    pub heartbeat: Duration,
    /// From a tile's issue to its acknowledgement.
    pub tile: Duration,
    /// For somebody to join who takes a place on an external host.
    pub join: Duration,
}

impl Topology {
    /// Which host holds which process.
    pub fn placement(&self) -> Placement {
        Placement::new(&self.hosts, &self.cluster)
    }

    /// How its database is built.
    pub fn build_choices(&self) -> BuildChoices {
        BuildChoices { octree: self.octree, records: self.records }
    }

    /// Reads its scene and builds its database.
    ///
    /// # Errors
    /// The scene cannot be read or is too large, or the image settings do not fit its resolution.
    pub fn prepare(&self) -> Result<Prepared, PreparationError> {
        preparation::prepare(&self.scene, self.build_choices(), &self.view, |defaults| self.image_settings(defaults))
    }

    /// The image settings, once the scene's own are known.
    ///
    /// # Errors
    /// The tile is larger than the image, or too small for it.
    pub fn image_settings(&self, defaults: &ImageDefaults) -> Result<ImageSettings, String> {
        let settings = self.image.settings(defaults)?;
        self.image.check_tile(Some(settings.width()), Some(settings.height()))?;
        Ok(settings)
    }
}
