//! A bus transaction: who asks for what, and what is recorded of it once it is complete.

use bytes::Bytes;

use ground::ids::{Address, Attempt, ClusterId, Epoch, NodeId, TileId};
use trace::database::Section;

/// Modelled bytes of a job handed to a node: the tile's number.
pub const JOB_BYTES: u32 = 4;
/// Modelled bytes of an end of job: the tile's number.
pub const END_OF_JOB_BYTES: u32 = 4;
/// Modelled bytes of a pixel written.
pub const PIXEL_BYTES: u32 = 3;

/// Who may ask for the bus. The order is that of [`fixed_priority`](super::arbiter::FixedPriority): the few
/// requests of the loader and the master go before those of the nodes.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum Initiator {
    /// The manager, which uploads the image.
    Loader,
    Master,
    Node(NodeId),
}

/// All missing lines of one record.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct FetchRequest {
    pub section: Section,
    /// The first missing line; a multiple of `line_bytes`.
    pub address: Address,
    /// A power of two, 16 to 256.
    pub line_bytes: u32,
    /// Bit i: the line at `address + i · line_bytes` is wanted. Bit 0 is set.
    pub lines: u32,
    /// The local memory's record accesses before this one, since it was made.
    pub accesses_before: u64,
}

impl FetchRequest {
    /// How many bytes the wanted lines are, at most 32 · 256 for a request within its ranges.
    pub fn bytes(&self) -> u32 {
        self.lines.count_ones().saturating_mul(self.line_bytes)
    }
}

/// What the bus is asked to carry.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Request {
    /// By a node, while it traces a tile.
    Fetch { tile: TileId, attempt: Attempt, fetch: FetchRequest },
    /// A range, by a node that holds all of the database.
    Bulk { address: Address, bytes: u32 },
    /// By the loader.
    Write { address: Address, data: Bytes },
    /// By the master: a job was handed to a node, or its end was reported. Modelled: no data move.
    Job { node: NodeId, tile: TileId, attempt: Attempt, bytes: u32 },
    /// By a node: a tile's pixel intensities. Modelled: no data move.
    Pixels { tile: TileId, attempt: Attempt, bytes: u32 },
}

impl Request {
    pub fn kind(&self) -> Kind {
        match self {
            Self::Fetch { .. } => Kind::Fetch,
            Self::Bulk { .. } => Kind::Bulk,
            Self::Write { .. } => Kind::Write,
            Self::Job { .. } => Kind::Job,
            Self::Pixels { .. } => Kind::Pixels,
        }
    }

    /// Bytes that cross the bus, moved or modelled.
    pub fn bytes(&self) -> u32 {
        match self {
            Self::Fetch { fetch, .. } => fetch.bytes(),
            Self::Bulk { bytes, .. } | Self::Job { bytes, .. } | Self::Pixels { bytes, .. } => *bytes,
            Self::Write { data, .. } => u32::try_from(data.len()).unwrap_or(u32::MAX),
        }
    }
}

/// The kinds of transactions that a recording distinguishes.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
#[repr(u8)]
pub enum Kind {
    Fetch,
    Bulk,
    Allocate,
    Write,
    Publish,
    Job,
    Pixels,
}

impl Kind {
    pub const COUNT: usize = 7;
    /// In the order of their codes in a recording.
    pub const ALL: [Self; Self::COUNT] =
        [Self::Fetch, Self::Bulk, Self::Allocate, Self::Write, Self::Publish, Self::Job, Self::Pixels];

    /// The name used in reports and recordings.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Fetch => "fetch",
            Self::Bulk => "bulk",
            Self::Allocate => "allocate",
            Self::Write => "write",
            Self::Publish => "publish",
            Self::Job => "job",
            Self::Pixels => "pixels",
        }
    }
}

/// What a recording keeps of a completed transaction. Times are nanoseconds since the bus started.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Transaction {
    /// From 0, without gaps, in order of grant.
    pub sequence: u64,
    /// Of the bus.
    pub epoch: Epoch,
    pub cluster: ClusterId,
    pub kind: Kind,
    /// The node that asked; of a job, the node it is for. `None` for the loader.
    pub node: Option<NodeId>,
    pub tile: Option<TileId>,
    pub attempt: Option<Attempt>,
    /// Of a fetch.
    pub section: Option<Section>,
    /// Of the first byte moved.
    pub address: Option<Address>,
    /// Moved, or modelled for a job and for pixels.
    pub bytes: u32,
    /// Of a fetch: bit i is set when the line at `address + i · line` was moved.
    pub lines: Option<u32>,
    /// Of the bytes moved, in ascending order of address.
    pub crc32c: Option<u32>,
    /// Of a fetch: the record accesses of the node's local memory before this one.
    pub accesses_before: Option<u64>,
    pub request_nanoseconds: u64,
    pub grant_nanoseconds: u64,
    pub completion_nanoseconds: u64,
}
