//! A small scene for tests: the gears at 40×40 pixels.

use crate::study::runs::traced::{Run, Traced};
use machine::hardware::specification::{Bus, MemorySize, Processor};
use machine::replay::Captured;
use machine::replay::plan::setting::{Assignment, Policy, Setting};
use machine::tile_order::TileOrder;
use trace::picture::{ImageSettings, Sides, Tiling};
use trace::preparation::{self, Prepared, ViewChoices};
use trace::scene::SceneSource;
use trace::tracer::octree::Octree;

pub(in crate::study) const TILING: Tiling =
    Tiling::new(Sides { width: 40, height: 40, tile_width: 5, tile_height: 5 }).expect("possible");

pub(in crate::study) fn gears() -> (Prepared, Traced<Captured>) {
    let source: SceneSource = "gears:1".parse().expect("a procedural scene");
    let octree = Octree { leaf_size: 8, max_depth: 6, mailbox: true };
    let image = ImageSettings::new(TILING.sides().width, TILING.sides().height, 2, 0.0).expect("possible");
    let prepared = preparation::prepare(&source, octree, &ViewChoices::default(), |_| Ok(image)).expect("a scene");
    let captured = Captured::capture(&prepared.database, &prepared.view, TILING, octree.mailbox, 1);
    let run = Run {
        scene: source.to_string(),
        octree,
        tiling: TILING,
        seed: 1,
        processor: Processor::DEFAULT,
        bus: Bus::DEFAULT,
    };
    let traced = Traced::of(run, &prepared, captured).expect("in memory");
    (prepared, traced)
}

/// An eighth of the database, lines of 64.
pub(in crate::study) fn setting(nodes: u16) -> Setting {
    Setting {
        local_memory: MemorySize::Share { numerator: 1, denominator: 8 },
        line: 64,
        ways: None,
        replacement: Policy::Lru,
        nodes,
        clusters: 1,
        tile_order: TileOrder::Scanline,
        assignment: Assignment::Interleaved,
        bus: Bus::DEFAULT,
        processor: Processor::DEFAULT,
    }
}
