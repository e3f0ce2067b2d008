//! Plans for the tests of this folder, and for the simulation.

use std::time::Duration;

use glam::DVec3;

use super::plan::Plan;
use crate::protocol::mac::MacKey;
use crate::topology::{Deadlines, Placement, Run};
use ground::ids::RunId;
use machine::hardware::specification::{Bus, Cluster, LocalMemory, MemorySize, Processor, Replacement};
use machine::tile_order::{Assignment, TileOrder};
use trace::database::{Header, Layout, Normalisation, Section};
use trace::picture::{AovSet, ImageSettings, Sides, Tiling};
use trace::scene::Camera;
use trace::tracer::View;
use trace::tracer::octree::Octree;

pub(super) const RUN: RunId = RunId(1);
pub(super) const KEY: MacKey = MacKey::new([1; 32]);

pub(super) fn run() -> Run {
    let deadlines = Deadlines {
        startup: Duration::from_secs(10),
        heartbeat: Duration::from_secs(5),
        tile: Duration::from_secs(60),
        join: Duration::from_secs(600),
    };
    Run { order: TileOrder::Scanline, assignment: Assignment::OnDemand, seed: 1, verify: 0.0, threads: 1, deadlines }
}

/// An image of `tiles` tiles.
pub(super) fn plan(nodes: u16, tiles: u32) -> Plan {
    let local_memory = LocalMemory { size: MemorySize::All, line: 64, ways: None, replacement: Replacement::Lru };
    let camera = Camera { from: DVec3::ZERO, at: DVec3::Z, up: DVec3::Y, angle_degrees: 45.0, resolution: None };
    let image = ImageSettings::new(tiles, 1, 4, 0.0).expect("possible");
    let layout = Layout::new([8; Section::COUNT]).expect("small");
    let cluster = Cluster { count: 1, nodes, processor: Processor::DEFAULT, local_memory, bus: Bus::DEFAULT };
    Plan {
        placement: Placement::new(&[], &cluster),
        cluster,
        octree: Octree { leaf_size: 8, max_depth: 12, mailbox: true },
        run: run(),
        id: RUN,
        key: KEY,
        header: Header {
            layout,
            normalisation: Normalisation::new(None),
            max_depth: 12,
            scene_primitives: 1,
            has_sheets: false,
        },
        view: View { camera, lights: Vec::new(), background: DVec3::ZERO, image },
        tiling: Tiling::new(Sides { width: tiles, height: 1, tile_width: 1, tile_height: 1 }).expect("possible"),
        aov: AovSet::default(),
        exr: false,
        record_references: false,
        journal: "out/tiles".into(),
        resume: false,
        fingerprint: [0; 32],
        image: "out/image.png".into(),
        recording: "out/recording".into(),
    }
}
