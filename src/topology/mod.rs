//! A topology file: read as written in [`mod@file`], proven into a [`Topology`]. Nothing after it checks again.

mod document;
pub mod file;
pub mod host;
pub mod host_file;
mod memory_size;
pub mod overrides;
pub mod placement;
mod prove;
mod prove_hosts;
mod read;
mod scene_source;
pub mod schema;
pub mod value;
mod write;

use std::fmt;
use std::path::PathBuf;
use std::time::Duration;

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use host::{Host, Launch};
pub use memory_size::NotASize;
pub use overrides::Override;
pub use placement::Placement;

use crate::ids::{ClusterId, NodeId};
use crate::picture::{ImageSettings, Sides, Tiling, TilingError};
use crate::scene::{Camera, Light, procedural::Procedural};

/// A proven topology: every value is within its range, every combination possible.
#[derive(Clone, Debug, PartialEq)]
pub struct Topology {
    /// The file's stem; names the output folder.
    pub name: String,
    pub scene: SceneSource,
    /// For scenes without one of their own; it does not override the file's.
    pub camera: Option<Camera>,
    /// For scenes without lights of their own.
    pub lights: Vec<Light>,
    pub background: Option<DVec3>,
    pub image: Image,
    pub octree: Octree,
    pub cluster: Cluster,
    /// The first is the manager's own; empty: everything is there, on the loopback interface.
    pub hosts: Vec<Host>,
    pub run: Run,
}

#[derive(Clone, Debug, PartialEq)]
pub enum SceneSource {
    /// Resolved against the topology file's folder (or the working directory, for an override).
    File(PathBuf),
    Procedural(Procedural),
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

/// How the octree is built. None of these changes the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Octree {
    /// A leaf that holds more primitives than this is divided, 1 to 1024.
    pub leaf_size: u32,
    /// Deepest level, 0 to 20.
    pub max_depth: u32,
    /// Whether a primitive that stands in many leaves is tested once a ray.
    pub mailbox: bool,
}

impl Octree {
    pub const DEFAULT: Self = Self { leaf_size: 8, max_depth: 12, mailbox: true };
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cluster {
    /// Clusters of this kind, each with a bus, a master and nodes of its own, 1 to 64.
    pub count: u16,
    /// Processing nodes of each, 1 to 256. Node ids go on from cluster to cluster.
    pub nodes: u16,
    pub processor: Processor,
    pub local_memory: LocalMemory,
    pub bus: Bus,
}

impl Cluster {
    /// Processing nodes of all clusters.
    pub fn all_nodes(&self) -> u16 {
        self.count * self.nodes
    }

    /// The cluster that a node belongs to.
    pub fn of(&self, node: NodeId) -> ClusterId {
        ClusterId(node.0 / self.nodes)
    }

    /// The first node of a cluster.
    pub fn first_node(&self, cluster: ClusterId) -> NodeId {
        NodeId(cluster.0 * self.nodes)
    }

    pub fn ids(&self) -> impl Iterator<Item = ClusterId> + use<> {
        (0..self.count).map(ClusterId)
    }
}

/// What a processing node's work costs, cycles, each 0 to 1,000,000. A model that a replay applies to what was counted:
/// no live process knows of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Processor {
    /// Of a step to an octree node.
    pub octree_node: u32,
    /// Of a ray against a triangle, sphere or cone.
    pub primitive_test: u32,
    /// Of a surface that light falls on.
    pub shading: u32,
    /// Of a record that is read from local memory, whatever it is.
    pub local_access: u32,
}

impl Processor {
    /// Of the order of a floating-point microprocessor of 1991: a few cycles an operation, tens of operations a test.
    pub const DEFAULT: Self = Self { octree_node: 20, primitive_test: 60, shading: 200, local_access: 1 };
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LocalMemory {
    pub size: MemorySize,
    /// Bytes, a power of two, 16 to 256.
    pub line: u32,
    /// Lines a set; `None`: fully associative.
    pub ways: Option<u32>,
    pub replacement: Replacement,
}

impl LocalMemory {
    /// The longest record spans a few lines, and all of them are held at once.
    pub const LINES_MIN: u64 = 16;
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum MemorySize {
    /// The renderer's mode: the database is pulled once, then read without a check.
    All,
    /// Of the database's bytes, above 0 and at most 1.
    Share {
        numerator: u32,
        denominator: u32,
    },
    Bytes(u64),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Replacement {
    Lru,
    Fifo,
    Clock,
    Random,
}

/// Its name in a topology file.
impl fmt::Display for Replacement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Bus {
    pub arbiter: Arbiter,
    /// Bytes of a bus word, a power of two, 1 to 64. This and what follows is a model as [`Processor`] is.
    pub width: u32,
    /// Cycles in which a word crosses the bus, 1 to 1024.
    pub cycles_per_word: u32,
    /// Cycles of the cluster memory before the first word of data, 0 to 1,000,000.
    pub latency: u32,
    pub transactions: Transactions,
}

impl Bus {
    /// A bus of 1991: 32 bits a cycle, and a dynamic memory that answers after eight.
    pub const DEFAULT: Self =
        Self { arbiter: Arbiter::Fifo, width: 4, cycles_per_word: 1, latency: 8, transactions: Transactions::Locked };
}

/// Whether the bus is free while the cluster memory looks for the data.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Transactions {
    /// Held from the address to the last word of data.
    #[default]
    Locked,
    /// Held for the address, and again for the data.
    Split,
}

/// Its name in a topology file.
impl fmt::Display for Transactions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

/// Who is granted the bus when several wait.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Arbiter {
    /// The longest waiting.
    Fifo,
    /// Each node in turn may hold the bus for up to `quantum` transactions (1 to 1024).
    RoundRobin { quantum: u32 },
    /// The lowest node id.
    FixedPriority,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Run {
    pub order: TileOrder,
    pub assignment: Assignment,
    /// Seeds random replacement, random tile order, and the choice of tiles that are verified.
    pub seed: u64,
    /// Share of the tiles that is rendered twice, by different nodes, and compared, 0 to 1.
    pub verify: f64,
    pub deadlines: Deadlines,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TileOrder {
    /// Row by row from the top.
    Scanline,
    /// Along a Z-shaped curve, so that tiles handed out together lie together.
    Morton,
    /// Shuffled with the run's seed.
    Random,
}

/// Its name in a topology file.
impl fmt::Display for TileOrder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Assignment {
    /// A node that asks gets the next tile: balanced, not reproducible.
    OnDemand,
    /// The i-th tile in order goes to node i mod nodes: counts are reproducible.
    Interleaved,
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

    /// The image settings, once the scene's own resolution is known.
    ///
    /// # Errors
    /// The tile is larger than the image, or too small for it.
    pub fn image_settings(&self, camera: &Camera) -> Result<ImageSettings, String> {
        let (width, height) = camera.resolution.unwrap_or((512, 512));
        let settings = ImageSettings {
            width: self.image.width.unwrap_or(width),
            height: self.image.height.unwrap_or(height),
            depth: self.image.depth,
            cutoff: self.image.cutoff,
        };
        self.image.check_tile(Some(settings.width), Some(settings.height))?;
        Ok(settings)
    }
}
