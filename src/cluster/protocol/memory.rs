//! Nodes, the master and the manager as loader (who ask) with the bus (which answers, in order of grant).

use serde::{Deserialize, Serialize};

use super::frame::messages;
use ground::ids::{Address, Attempt, NodeId, TileId};
use trace::database::Section;

/// Asked of the bus. Only `Fetch`, `Bulk` and `Store` are answered.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub enum MemoryRequest {
    /// All missing lines of one record, by a node. Answered by [`MemoryReply::Data`] with the lines in ascending order.
    Fetch {
        tile: TileId,
        attempt: Attempt,
        section: Section,
        /// The first missing line; a multiple of `line_bytes`.
        address: Address,
        /// A power of two, 16 to 256.
        line_bytes: u16,
        /// Bit i: the line at `address + i · line_bytes` is wanted. Bit 0 is set.
        lines: u32,
        /// The node's record accesses before this one, for the recording.
        accesses_before: u64,
    },
    /// A range, by a node that holds all of the database. Answered by [`MemoryReply::Data`].
    Bulk { address: Address, bytes: u32 },
    /// By the loader: write the frame's bulk bytes. Answered by [`MemoryReply::Stored`].
    Store { address: Address },
    /// By the master: a job was handed to a node, or its end was reported. Paper traffic, modelled; not answered.
    Job { node: NodeId, tile: TileId, attempt: Attempt, bytes: u32 },
    /// By a node: a tile's pixel intensities are written, three bytes each. Paper traffic, modelled; not answered.
    Pixels { tile: TileId, attempt: Attempt, bytes: u32 },
}

#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub enum MemoryReply {
    /// The bytes follow in the frame.
    Data {
        bytes: u32,
    },
    Stored,
    /// The connection ends after this.
    Refused(String),
}

/// Most bytes one `Bulk` or `Store` may move.
pub const BULK_BYTES_MAX: u32 = 4 << 20;

messages! {
    MemoryRequest: 64, bulk BULK_BYTES_MAX as usize;
    MemoryReply: 4 << 10, bulk BULK_BYTES_MAX as usize;
}
