//! What a replay needs of the topology of a recorded run.

use crate::hardware::specification::Cluster;
use crate::tile_order::TileOrder;

/// Under what a run was recorded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conditions {
    pub cluster: Cluster,
    pub tile_order: TileOrder,
    /// Of random replacement and random tile order.
    pub seed: u64,
}
