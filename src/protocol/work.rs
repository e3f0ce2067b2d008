//! Nodes (who ask for tiles) with the master (which hands them out).

use serde::{Deserialize, Serialize};

use crate::ids::{Attempt, TileId};
use crate::machine::stats::MemoryStats;
use crate::tracer::TraceStats;

/// How many tiles a node may hold at once: one to trace, one to begin with at once after it, and two on their way to
/// the display and back, which takes a while when every processor is busy tracing.
pub const JOBS_PER_NODE: usize = 4;

#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub enum WorkRequest {
    /// The node can take one more tile.
    Ready,
    /// The display has acknowledged the tile.
    Done(Box<TileDone>),
}

#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub enum WorkReply {
    Job { tile: TileId, attempt: Attempt },
}

/// A tile's completion carries its counters, so that a crash loses those of unfinished tiles only.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct TileDone {
    pub tile: TileId,
    pub attempt: Attempt,
    pub trace: TraceStats,
    /// `None` where all of the database is in local memory: nothing is counted.
    pub memory: Option<MemoryStats>,
    pub render_cpu_nanoseconds: u64,
}
