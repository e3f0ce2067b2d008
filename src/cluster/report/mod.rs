//! What a run tells at its end, schema version 4. Every field is documented in docs/report.md.
//!
//! Plain data: counting is done elsewhere, printing in [`json`] and [`text`]. What does not apply to a run is left out.

pub mod conservation;
pub mod incident;
pub mod json;
pub mod memory;
pub mod schema;
pub mod text;
pub mod verification;
pub mod view;

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use conservation::Conservation;
pub use incident::Incident;
pub use memory::{Memory, NodeMemory};
pub use verification::Verification;
pub use view::{Bounds, Camera};

use machine::hardware::totals::BusTotals;
use trace::preparation::Prepared;
use trace::scene::Warning;
use trace::tracer::octree::census::Census;
use trace::tracer::simd::Simd;
use trace::tracer::{RayKind, TraceStats};

/// Raised with every change that a reader of report.json could notice.
pub const SCHEMA_VERSION: u32 = 4;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Report {
    pub schema_version: u32,
    /// Version of the program.
    pub build: String,
    pub status: Status,
    /// Why it failed.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub error: Option<String>,
    pub scene: Scene,
    /// `None` in reports of version 1.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub camera: Option<Camera>,
    pub image: Image,
    /// `None` where nothing traced.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub kernel: Option<Kernel>,
    pub rays: Rays,
    pub octree: Octree,
    /// `None` where packets traced: these are counts of the single-ray kernel.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub tests: Option<Tests>,
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub tiles: Option<Tiles>,
    /// By node id.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub nodes: Vec<Node>,
    /// `None` where every node holds all of the database.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub memory: Option<Memory>,
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub bus: Option<Bus>,
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub conservation: Option<Conservation>,
    /// `None` where no display lived to report what it has.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub verification: Option<Verification>,
    pub incidents: Vec<Incident>,
    /// About the scene.
    #[serde(default)]
    pub warnings: Vec<Warning>,
    /// `None` where no fault was asked for.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub chaos: Option<Chaos>,
    pub seconds: Seconds,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    Done,
    TilesMissing,
    Interrupted,
    Failed,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Scene {
    /// The file, or the procedural scene and its size.
    pub source: String,
    /// Polygons before triangulation, spheres and cones.
    pub primitives: u64,
    pub database_bytes: u64,
    /// `None` where there are no primitives.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub bounds: Option<Bounds>,
}

impl Scene {
    pub fn new(source: String, prepared: &Prepared) -> Self {
        let header = &prepared.database.database().header;
        Self {
            source,
            primitives: header.scene_primitives,
            database_bytes: header.layout.database_bytes(),
            bounds: prepared.bounds.map(Bounds::new),
        }
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Image {
    /// Pixels.
    pub width: u32,
    pub height: u32,
    /// Of the linear f32 RGB, row-major, little-endian; `None` when the display did not live to tell.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub sha256: Option<String>,
    /// Pixels whose radiance was not finite and was written as 0.
    pub non_finite_pixels: u64,
    /// Why the image is not to be relied on; `None`: nothing speaks against it.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub unverified: Option<String>,
    /// The image first.
    pub files: Vec<PathBuf>,
    /// Of the bytes of `image.png` in the output folder; `None` where there is none.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub file_sha256: Option<String>,
}

/// What traced.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "name", rename_all = "snake_case")]
pub enum Kernel {
    /// One ray at a time over the shared image, whose records are counted.
    Single,
    /// Packets over a structure that every process that traces derived from the image, besides it.
    Packets { simd: Simd, derived_bytes: u64 },
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Rays {
    pub primary: u64,
    pub shadow: u64,
    pub reflection: u64,
    pub refraction: u64,
}

impl Rays {
    pub fn new(trace: &TraceStats) -> Self {
        let cast = |kind: RayKind| trace.rays[kind as usize];
        Self {
            primary: cast(RayKind::Primary),
            shadow: cast(RayKind::Shadow),
            reflection: cast(RayKind::Reflection),
            refraction: cast(RayKind::Refraction),
        }
    }

    pub fn total(self) -> u64 {
        self.primary + self.shadow + self.reflection + self.refraction
    }
}

#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Octree {
    /// Branches and leaves.
    pub nodes: u64,
    pub leaves: u64,
    /// Entries in all leaf lists.
    pub references: u64,
    /// Level of the deepest node; the root's is 0.
    pub depth: u32,
    /// From the root's on.
    pub levels: Vec<OctreeLevel>,
}

impl Octree {
    /// Of an octree whose visits were not counted.
    pub fn new(census: &Census) -> Self {
        let total = census.total();
        Self {
            nodes: total.nodes(),
            leaves: total.leaves + total.empty_leaves,
            references: total.references,
            depth: census.depth(),
            levels: census.levels.iter().map(|level| OctreeLevel { nodes: level.nodes(), accesses: None }).collect(),
        }
    }

    #[must_use]
    pub fn with_accesses(mut self, trace: &TraceStats) -> Self {
        for (level, accesses) in self.levels.iter_mut().zip(trace.octree_accesses) {
            level.accesses = Some(accesses);
        }
        self
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct OctreeLevel {
    pub nodes: u64,
    /// Visits by rays; `None` where packets traced.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub accesses: Option<u64>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Tests {
    pub primitive: u64,
    /// Of triangles within polygons that are objects; each polygon is one primitive test.
    #[serde(skip_serializing_if = "is_zero", default)]
    pub polygon_triangles: u64,
    pub mailbox_skips: u64,
}

impl Tests {
    pub fn new(trace: &TraceStats) -> Self {
        let TraceStats { primitive_tests, polygon_triangles, mailbox_skips, .. } = *trace;
        Self { primitive: primitive_tests, polygon_triangles, mailbox_skips }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Tiles {
    pub total: u64,
    pub done: u64,
    /// Attempts after a tile's first.
    pub reissued: u64,
    /// Results that came too late: pixels of a tile that was there already, completions no longer awaited.
    pub stale: u64,
    /// Taken over from an earlier run.
    #[serde(default)]
    pub resumed: u64,
    /// Rendered at least twice, with the same bytes.
    #[serde(default)]
    pub verified: u64,
    /// Rendered twice with different bytes.
    #[serde(default)]
    pub disagreements: u64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Node {
    pub id: u16,
    /// Accepted ones.
    pub tiles: u64,
    /// `None` where the node holds all of the database.
    #[serde(flatten)]
    pub memory: Option<NodeMemory>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Bus {
    pub transactions: u64,
    pub fetches: u64,
    /// Lines and bulk transfers, as granted by the bus.
    pub bytes: u64,
    /// Modelled jobs and pixels.
    pub message_bytes: u64,
    /// Really sent and received by the bus.
    pub wire_bytes: u64,
    pub log_rows: u64,
    /// How often a transaction waited for the log's writer.
    pub log_waits: u64,
}

impl From<BusTotals> for Bus {
    fn from(totals: BusTotals) -> Self {
        Self {
            transactions: totals.transactions,
            fetches: totals.fetches,
            bytes: totals.fetched_bytes + totals.bulk_bytes,
            message_bytes: totals.message_bytes,
            wire_bytes: totals.wire_bytes,
            log_rows: totals.log_rows,
            log_waits: totals.log_waits,
        }
    }
}

impl Bus {
    /// The sum of two.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            transactions: self.transactions + other.transactions,
            fetches: self.fetches + other.fetches,
            bytes: self.bytes + other.bytes,
            message_bytes: self.message_bytes + other.message_bytes,
            wire_bytes: self.wire_bytes + other.wire_bytes,
            log_rows: self.log_rows + other.log_rows,
            log_waits: self.log_waits + other.log_waits,
        }
    }
}

/// What faults on purpose came to; each of them is an incident as well.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Chaos {
    /// The faults, nothing left to chance.
    pub schedule: String,
    pub carried_out: u64,
    /// The longest time without another tile done, from the first fault to the last tile.
    pub longest_wait_seconds: f64,
}

/// Wall clock, but `render_cpu`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Seconds {
    pub load: f64,
    pub octree: f64,
    /// From the first tile issued to the last acknowledged.
    pub render: f64,
    /// Processor time of the tracing threads, summed.
    pub render_cpu: f64,
    pub total: f64,
}

impl Report {
    /// Rays of all kinds a second of rendering; 0 when nothing was rendered.
    pub fn rays_per_second(&self) -> f64 {
        ratio(self.rays.total() as f64, self.seconds.render)
    }
}

fn is_zero(count: &u64) -> bool {
    *count == 0
}

/// 0 for nothing of nothing, so that JSON never meets a NaN.
fn ratio(part: f64, whole: f64) -> f64 {
    if whole > 0.0 { part / whole } else { 0.0 }
}

#[cfg(test)]
pub(crate) mod fixture {
    //! A report with every part present, its numbers worked by hand.

    use super::*;
    use machine::hardware::local_memory::MemoryShape;
    use machine::hardware::stats::{Counters, MemoryStats, octree_class, section_class};
    use trace::database::{Layout, Section};

    /// Records without padding; how many there are does not matter.
    pub(crate) fn layout() -> Layout {
        Layout::new([8; Section::COUNT]).expect("small")
    }

    /// 64 sets of four ways.
    pub(crate) const SHAPE: MemoryShape = MemoryShape { local_bytes: 8192, sets: 64, lines_per_set: 4 };

    /// 32-byte lines, two nodes with the same counts each.
    pub(crate) fn memory_stats() -> MemoryStats {
        let mut stats = MemoryStats { stall_nanoseconds: 1_500_000_000, ..MemoryStats::default() };
        let counters = |record_accesses, record_misses, line_accesses, line_misses| Counters {
            record_accesses,
            record_misses,
            line_accesses,
            line_misses,
        };
        // Octree words are 1 word each, triangles 10.
        stats.counters[RayKind::Primary as usize][octree_class(0)] = counters(100, 1, 100, 1);
        stats.counters[RayKind::Primary as usize][octree_class(2)] = counters(300, 30, 300, 30);
        stats.counters[RayKind::Shadow as usize][octree_class(2)] = counters(50, 9, 50, 9);
        stats.counters[RayKind::Shadow as usize][section_class(Section::Triangles)] = counters(40, 10, 80, 15);
        stats
    }

    pub(crate) fn report() -> Report {
        let stats = memory_stats();
        let mut all = stats.clone();
        all.add(&stats);
        let node = |id| Node { id, tiles: 2, memory: Some(NodeMemory::new(&stats, &layout(), 32)) };
        Report {
            schema_version: SCHEMA_VERSION,
            build: "0.1.0".to_owned(),
            status: Status::Failed,
            error: Some("the display died".to_owned()),
            scene: Scene {
                source: "gears 2".to_owned(),
                primitives: 1169,
                database_bytes: 65_536,
                bounds: Some(Bounds { low: [-1.0; 3], high: [1.0, 2.0, 4.0] }),
            },
            camera: Some(Camera {
                from: [0.0, 0.0, 9.0],
                at: [0.0; 3],
                up: [0.0, 1.0, 0.0],
                angle: 45.0,
                source: view::CameraSource::Framing,
                chosen: vec!["from".to_owned()],
            }),
            image: Image {
                width: 64,
                height: 48,
                sha256: Some("00ff".to_owned()),
                non_finite_pixels: 0,
                unverified: Some("a = b: 1 against 2".to_owned()),
                files: vec![PathBuf::from("out/image.png")],
                file_sha256: Some("11ee".to_owned()),
            },
            kernel: Some(Kernel::Packets { simd: Simd::Avx2, derived_bytes: 93_520 }),
            rays: Rays { primary: 3072, shadow: 2000, reflection: 500, refraction: 28 },
            octree: Octree {
                nodes: 9,
                leaves: 8,
                references: 20,
                depth: 1,
                levels: vec![
                    OctreeLevel { nodes: 1, accesses: Some(5600) },
                    OctreeLevel { nodes: 8, accesses: Some(9000) },
                ],
            },
            tests: Some(Tests { primitive: 12_345, polygon_triangles: 0, mailbox_skips: 678 }),
            tiles: Some(Tiles { total: 5, done: 4, reissued: 1, stale: 0, ..Tiles::default() }),
            nodes: vec![node(0), node(1)],
            memory: Some(Memory::new(&all, &layout(), 32, SHAPE)),
            bus: Some(Bus {
                transactions: 120,
                fetches: 103,
                bytes: 3616,
                message_bytes: 9000,
                wire_bytes: 9876,
                log_rows: 120,
                log_waits: 0,
            }),
            conservation: Some(Conservation::new(vec![conservation::Check::new("a = b", 1, 1)])),
            verification: Some(verification::fixture()),
            incidents: vec![Incident { seconds: 1.25, text: "node 1 died: signal 9".to_owned() }],
            warnings: vec![Warning {
                file: Some(PathBuf::from("a.obj")),
                line: Some(7),
                column: Some(2),
                kind: "short-face".to_owned(),
                count: 3,
                text: "a face of two corners, is left out".to_owned(),
            }],
            chaos: Some(Chaos { schedule: "kill node 1@10%".to_owned(), carried_out: 1, longest_wait_seconds: 0.75 }),
            seconds: Seconds { load: 0.5, octree: 0.25, render: 2.0, render_cpu: 3.5, total: 3.0 },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_a_second_are_all_rays_over_the_render_time() {
        let mut report = fixture::report();
        assert_eq!(report.rays_per_second(), 2800.0);
        report.seconds.render = 0.0;
        assert_eq!(report.rays_per_second(), 0.0);
    }

    #[test]
    fn what_does_not_apply_is_left_out() {
        let render = Report {
            error: None,
            camera: None,
            kernel: None,
            tests: None,
            tiles: None,
            nodes: vec![],
            memory: None,
            bus: None,
            conservation: None,
            verification: None,
            chaos: None,
            ..fixture::report()
        };
        let json = serde_json::to_value(&render).expect("plain data");
        for key in [
            "error",
            "camera",
            "kernel",
            "tests",
            "tiles",
            "nodes",
            "memory",
            "bus",
            "conservation",
            "verification",
            "chaos",
        ] {
            assert!(json.get(key).is_none(), "{key}");
        }
        assert_eq!(serde_json::from_value::<Report>(json).expect("reads back"), render);
    }
}
