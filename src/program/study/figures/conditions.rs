//! What is beside every figure: all that was chosen where the paper leaves it open.

use std::fmt;

use serde::Serialize;

use crate::study::runs::traced::Traced;
use machine::tile_order::TileOrder;
use trace::tracer::octree::Octree;

/// How a figure came about. Local memories are fully associative and LRU, tiles interleaved, unless it says otherwise.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Conditions {
    pub scene: String,
    #[serde(flatten)]
    pub octree: Octree,
    pub database_bytes: u64,
    pub line_bytes: u32,
    pub order: TileOrder,
}

impl Conditions {
    pub fn new<T>(traced: &Traced<T>, line_bytes: u32, order: TileOrder) -> Self {
        let database_bytes = traced.layout.database_bytes();
        Self { scene: traced.run.scene.clone(), octree: traced.run.octree, database_bytes, line_bytes, order }
    }

    /// Scene and octree.
    pub fn subject(&self) -> String {
        format!("{}, {}", self.scene, octree(self.octree))
    }
}

/// The octree of a setting.
pub fn octree(octree: Octree) -> String {
    let Octree { leaf_size, max_depth, mailbox } = octree;
    format!("leaves of {leaf_size}, depth {max_depth}{}", if mailbox { "" } else { ", no mailbox" })
}

/// All but the octree.
impl fmt::Display for Conditions {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { line_bytes, order, .. } = self;
        write!(out, "lines of {line_bytes} bytes, LRU, fully associative; tiles in {order} order, interleaved")
    }
}
