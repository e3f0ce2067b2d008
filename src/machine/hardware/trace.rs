//! What is replayed: the references of tiles, as some node once made them.

use std::ops::Range;

use crate::hardware::local_memory::GeometryError;
use ground::ids::{Attempt, Epoch, NodeId, TileId};

/// A tile that a node traced to its end, and where its references are.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct TracedTile {
    pub node: NodeId,
    /// Of the node's process: each begins with an empty local memory.
    pub epoch: Epoch,
    pub tile: TileId,
    pub attempt: Attempt,
    /// Whether it was accepted. A tile that was traced and then lost with its node is not: it filled the node's
    /// local memory, and counts for nothing.
    pub accepted: bool,
    /// Its parts in order.
    pub parts: Range<u32>,
}

/// Why references cannot be read: which file, and what is wrong with it.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error("{0}")]
pub struct TraceError(pub String);

impl From<GeometryError> for TraceError {
    fn from(error: GeometryError) -> Self {
        Self(format!("local memory: {error}"))
    }
}

/// References that can be replayed any number of times, from any number of threads.
pub trait Trace: Sync {
    /// All tiles that were traced, those of one node process in the order in which it traced them.
    fn tiles(&self) -> &[TracedTile];

    /// Replaces `words` with those of a part: [`ReferenceWord`](crate::hardware::references::ReferenceWord)s.
    ///
    /// # Errors
    /// The part cannot be read any more, or is not what it was.
    fn read(&self, part: u32, words: &mut Vec<u32>) -> Result<(), TraceError>;
}
