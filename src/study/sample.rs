//! A small scene for tests: the gears at 40×40 pixels.

use super::traced::Traced;
use crate::preparation::{self, Fallback, Prepared};
use crate::replay::Captured;
use crate::topology::Octree;
use crate::tracer::Tiling;
use crate::tracer::view::ImageSettings;

pub(super) const TILING: Tiling = Tiling { width: 40, height: 40, tile_width: 5, tile_height: 5 };

pub(super) fn gears() -> (Prepared, Traced<Captured>) {
    let source = "gears:1".parse().expect("a procedural scene");
    let octree = Octree { leaf_size: 8, max_depth: 6, mailbox: true };
    let image = ImageSettings { width: TILING.width, height: TILING.height, depth: 2, cutoff: 0.0 };
    let prepared = preparation::prepare(&source, octree, &Fallback::default(), |_| Ok(image)).expect("a scene");
    let captured = Captured::capture(&prepared.database, &prepared.view, TILING, octree.mailbox, 1);
    let traced = Traced::new(source.to_string(), octree, &prepared.database, captured).expect("in memory");
    (prepared, traced)
}
