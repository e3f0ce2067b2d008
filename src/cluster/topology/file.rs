//! A topology file as written: one struct a section, one field a key. The doc comments of the fields are
//! the descriptions of the published schema; docs/topology.md says more.

use std::fmt;
use std::marker::PhantomData;

use schemars::JsonSchema;
use serde::de::value::MapAccessDeserializer;
use serde::de::{IntoDeserializer, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

pub use super::host_file::Host;
use super::value::{
    Angle, Channel, Clusters, Coordinate, Cutoff, Cycles, CyclesPerWord, Depth, LeafSize, Line, MaxDepth, Nodes,
    ProceduralSize, Quantum, RecordBytes, Seconds, Seed, Side, Size, Threads, Tile, Verify, Version, Ways, Width,
};
use machine::hardware::specification::{self, MemorySize, Replacement, Transactions};
use machine::tile_order::{Assignment, TileOrder};
use trace::database::{Numbers, Objects};
use trace::picture::{ImageSettings, Terminator};
use trace::scene::UpAxis;
use trace::scene::procedural::{Board, Kind};

/// A topology of marti: what is rendered, by how many processing nodes, through how much local memory.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
#[schemars(title = "marti topology", extend("required" = ["scene"]))]
pub struct File {
    #[serde(deserialize_with = "table")]
    pub topology: Header,
    #[serde(deserialize_with = "table")]
    pub scene: Scene,
    /// Parts of the camera; what is left out is the scene's own, else such that the whole scene is seen.
    #[serde(deserialize_with = "some_table", skip_serializing_if = "Option::is_none")]
    pub camera: Option<Camera>,
    /// Instead of all lights of the scene.
    #[serde(deserialize_with = "tables", skip_serializing_if = "Vec::is_empty")]
    pub light: Vec<Light>,
    #[serde(deserialize_with = "table")]
    pub image: Image,
    #[serde(deserialize_with = "table")]
    pub octree: Octree,
    #[serde(deserialize_with = "table", skip_serializing_if = "Database::is_default")]
    pub database: Database,
    #[serde(deserialize_with = "table")]
    pub cluster: Cluster,
    #[serde(deserialize_with = "tables", skip_serializing_if = "Vec::is_empty")]
    pub host: Vec<Host>,
    #[serde(deserialize_with = "table")]
    pub run: Run,
}

/// About the file itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Header {
    /// Version of the file's format.
    pub version: Version,
    /// Names the output folder; default: the file's name without its extension.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
}

impl Default for Header {
    fn default() -> Self {
        Self { version: Version(1), name: None }
    }
}

/// What tells whether the rest can be understood; read before it.
#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Preamble {
    #[serde(rename = "topology", deserialize_with = "table")]
    _topology: PreambleHeader,
}

#[derive(Deserialize)]
#[serde(default)]
struct PreambleHeader {
    #[serde(rename = "version")]
    _version: Version,
}

impl Default for PreambleHeader {
    fn default() -> Self {
        Self { _version: Version(1) }
    }
}

/// What is rendered: exactly one of `file` and `procedural`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
#[schemars(extend("oneOf" = [{ "required": ["file"] }, { "required": ["procedural"] }]))]
pub struct Scene {
    /// An NFF or OBJ file, relative to the topology file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// A scene of the Standard Procedural Databases.
    #[serde(deserialize_with = "some_name", skip_serializing_if = "Option::is_none")]
    pub procedural: Option<Kind>,
    /// Size factor of the procedural scene, in its kind's range; default: its kind's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub size: Option<ProceduralSize>,
    /// What a procedural teapot stands on; default: "squares".
    #[serde(deserialize_with = "some_name", skip_serializing_if = "Option::is_none")]
    pub board: Option<Board>,
    /// Linear RGB where a ray hits nothing; default: the scene's own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub background: Option<[Channel; 3]>,
    /// Which axis is up where neither the scene nor `camera` has a camera that says so; default: "y".
    #[serde(deserialize_with = "some_name", skip_serializing_if = "Option::is_none")]
    pub up: Option<UpAxis>,
}

/// A pinhole camera: at least one of its parts.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
#[schemars(extend("minProperties" = 1))]
pub struct Camera {
    /// The eye, world units; default: the scene's own, else where the whole scene is seen from.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub from: Option<[Coordinate; 3]>,
    /// The point in the middle of the image, world units; default: the scene's own, else the middle of the scene.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at: Option<[Coordinate; 3]>,
    /// The direction that is up in the image; need not be perpendicular to the view; default: the scene's own, else the
    /// axis `scene.up`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub up: Option<[Coordinate; 3]>,
    /// Full vertical field of view, degrees; default: the scene's own, else 45.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub angle: Option<Angle>,
}

/// A point light, not attenuated by distance.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Light {
    /// World units.
    pub position: [Coordinate; 3],
    /// Linear RGB intensity.
    #[serde(default = "Light::white")]
    pub colour: [Channel; 3],
}

impl Light {
    fn white() -> [Channel; 3] {
        [Channel(1.0); 3]
    }
}

/// The image, and the tiles that it is cut into.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Image {
    /// Pixels; default: the scene file's resolution, else 512.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub width: Option<Side>,
    /// Pixels; default: the scene file's resolution, else 512.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub height: Option<Side>,
    /// Pixels, at most the image: one number for a square tile, or [width, height]; default: 16, or the image
    /// where that is smaller.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tile: Option<Tile>,
    /// How many reflections or refractions may follow one another.
    pub depth: Depth,
    /// A reflected or refracted ray is cast when its weight in the pixel exceeds this.
    pub cutoff: Cutoff,
    /// Where smooth surfaces turn away from a light; default: as is usual for the scene's kind of file.
    #[serde(deserialize_with = "some_name", skip_serializing_if = "Option::is_none")]
    pub terminator: Option<Terminator>,
}

impl Default for Image {
    fn default() -> Self {
        let depth = Depth(ImageSettings::DEPTH_DEFAULT);
        Self { width: None, height: None, tile: None, depth, cutoff: Cutoff(0.0), terminator: None }
    }
}

/// How the octree is built. None of these changes the image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Octree {
    /// A leaf that holds more primitives than this is divided.
    pub leaf_size: LeafSize,
    /// Deepest level; the root is level 0.
    pub max_depth: MaxDepth,
    /// Whether a primitive that stands in many leaves is tested only once a ray.
    pub mailbox: bool,
}

impl Default for Octree {
    fn default() -> Self {
        let super::Octree { leaf_size, max_depth, mailbox } = trace::tracer::octree::Octree::DEFAULT;
        Self { leaf_size: LeafSize(leaf_size), max_depth: MaxDepth(max_depth), mailbox }
    }
}

/// How the database's records are laid out: what is an object of the octree, and what sizes are modelled. None of it changes
/// the image.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Database {
    /// What the octree lists of a polygon: each of its triangles, or the polygon as a whole.
    #[serde(deserialize_with = "name")]
    pub records: Objects,
    /// For which numbers the records of triangles, spheres, cones and normals have room; their values stay f32.
    #[serde(deserialize_with = "name")]
    pub numbers: Numbers,
    /// Bytes of a triangle's record, or of a polygon's where polygons are objects: a multiple of 4, at least what it holds;
    /// default: just that.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub record_bytes: Option<RecordBytes>,
}

impl Database {
    fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// The processing nodes that share a bus and the cluster memory behind it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Cluster {
    /// Clusters, each with a bus, a master and nodes of its own.
    pub count: Clusters,
    /// Processing nodes of each.
    pub nodes: Nodes,
    /// Threads of each node; more than one with cluster.local_memory.size = "all" only.
    pub threads: Threads,
    #[serde(deserialize_with = "table")]
    pub processor: Processor,
    #[serde(deserialize_with = "table")]
    pub local_memory: LocalMemory,
    #[serde(deserialize_with = "table")]
    pub bus: Bus,
}

impl Default for Cluster {
    fn default() -> Self {
        Self {
            count: Clusters(1),
            nodes: Nodes(4),
            threads: Threads(1),
            processor: Processor::default(),
            local_memory: LocalMemory::default(),
            bus: Bus::default(),
        }
    }
}

/// What a processing node's work costs, for replays: a model that changes no count.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Processor {
    /// Cycles of a step to an octree node.
    pub octree_node: Cycles,
    /// Cycles of a ray against a triangle, sphere or cone.
    pub primitive_test: Cycles,
    /// Cycles of a surface that light falls on.
    pub shading: Cycles,
    /// Cycles of a record that is read from local memory, on top of what is done with it.
    pub local_access: Cycles,
}

impl Default for Processor {
    fn default() -> Self {
        specification::Processor::DEFAULT.into()
    }
}

/// What a processing node holds of the database: a cache of lines.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct LocalMemory {
    /// "all", a share of the database such as "1/8", or bytes such as 4096 or "64 KiB"; at least 16 lines.
    pub size: Size,
    /// Bytes of a line.
    pub line: Line,
    /// Lines of a set; default: fully associative.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ways: Option<Ways>,
    /// Which line of a full set is evicted.
    #[serde(deserialize_with = "name")]
    pub replacement: Replacement,
}

impl Default for LocalMemory {
    fn default() -> Self {
        Self {
            size: Size(MemorySize::Share { numerator: 1, denominator: 8 }),
            line: Line(64),
            ways: None,
            replacement: Replacement::Lru,
        }
    }
}

/// The bus between the processing nodes and the cluster memory.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Bus {
    /// Who is granted the bus when several wait.
    #[serde(deserialize_with = "name")]
    pub arbiter: Arbiter,
    /// With `round_robin`: transactions that a node may be granted in a row; default: 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quantum: Option<Quantum>,
    /// Bytes of a bus word, for replays.
    pub width: Width,
    /// Cycles in which a word crosses the bus, for replays.
    pub cycles_per_word: CyclesPerWord,
    /// Cycles of the cluster memory before the first word of data, for replays.
    pub latency: Cycles,
    /// Whether the bus is free while the cluster memory looks for the data, for replays.
    #[serde(deserialize_with = "name")]
    pub transactions: Transactions,
}

impl Default for Bus {
    fn default() -> Self {
        specification::Bus::DEFAULT.into()
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Arbiter {
    /// The longest waiting.
    #[default]
    Fifo,
    /// Each node in turn.
    RoundRobin,
    /// The lowest node id.
    FixedPriority,
}

/// How the work is handed out, and how long to wait for it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Run {
    /// The order of the tiles.
    #[serde(deserialize_with = "name")]
    pub order: TileOrder,
    /// Which node gets which tile.
    #[serde(deserialize_with = "name")]
    pub assignment: Assignment,
    /// Seeds random replacement, random tile order, and the choice of tiles that are verified.
    pub seed: Seed,
    /// Share of the tiles that is rendered twice, by different nodes, and compared.
    pub verify: Verify,
    #[serde(deserialize_with = "table")]
    pub deadlines: Deadlines,
}

impl Default for Run {
    fn default() -> Self {
        Self {
            order: TileOrder::Scanline,
            assignment: Assignment::OnDemand,
            seed: Seed(1),
            verify: Verify(0.0),
            deadlines: Deadlines::default(),
        }
    }
}

/// How long to wait before a silent process counts as dead.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Deadlines {
    /// From spawning a process until it is connected and configured.
    pub startup_seconds: Seconds,
    /// Between two signs of life.
    pub heartbeat_seconds: Seconds,
    /// From a tile's issue to its acknowledgement.
    pub tile_seconds: Seconds,
    /// For somebody to join who takes a place on an external host.
    pub join_seconds: Seconds,
}

impl Default for Deadlines {
    fn default() -> Self {
        Self {
            startup_seconds: Seconds(10.0),
            heartbeat_seconds: Seconds(5.0),
            tile_seconds: Seconds(600.0),
            join_seconds: Seconds(600.0),
        }
    }
}

/// Reads a section from a table alone: serde would also take an array as its keys in order.
fn table<'de, D: Deserializer<'de>, T: Deserialize<'de>>(deserializer: D) -> Result<T, D::Error> {
    struct TableVisitor<T>(PhantomData<T>);

    impl<'de, T: Deserialize<'de>> Visitor<'de> for TableVisitor<T> {
        type Value = T;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("a table")
        }

        fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<T, A::Error> {
            T::deserialize(MapAccessDeserializer::new(map))
        }
    }

    deserializer.deserialize_map(TableVisitor(PhantomData))
}

fn some_table<'de, D: Deserializer<'de>, T: Deserialize<'de>>(deserializer: D) -> Result<Option<T>, D::Error> {
    table(deserializer).map(Some)
}

fn tables<'de, D: Deserializer<'de>, T: Deserialize<'de>>(deserializer: D) -> Result<Vec<T>, D::Error> {
    #[derive(Deserialize)]
    #[serde(transparent, bound = "T: Deserialize<'de>")]
    struct Row<T>(#[serde(deserialize_with = "table")] T);

    let rows = Vec::<Row<T>>::deserialize(deserializer)?;
    Ok(rows.into_iter().map(|Row(row)| row).collect())
}

/// Reads a name from a string alone: toml would also take a table for an enum.
fn name<'de, D: Deserializer<'de>, T: Deserialize<'de>>(deserializer: D) -> Result<T, D::Error> {
    let text = String::deserialize(deserializer)?;
    let read = |text: String| T::deserialize(text.into_deserializer());
    let other = read(text.replace('-', "_")).or_else(|_: D::Error| read(text.replace('_', "-")));
    read(text).or_else(|error| other.map_err(|_: D::Error| error))
}

fn some_name<'de, D: Deserializer<'de>, T: Deserialize<'de>>(deserializer: D) -> Result<Option<T>, D::Error> {
    name(deserializer).map(Some)
}
