//! What the bus and the master of a cluster count over a run, by which its books are closed.

use serde::{Deserialize, Serialize};

use ground::ids::{Attempt, TileId};

/// What crossed the bus.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
pub struct BusTotals {
    pub transactions: u64,
    pub fetches: u64,
    pub fetched_bytes: u64,
    pub bulk_bytes: u64,
    /// Modelled jobs and pixels.
    pub message_bytes: u64,
    /// Bytes that really went over the sockets, both directions.
    pub wire_bytes: u64,
    pub log_rows: u64,
    pub fetches_of_lost_attempts: u64,
    pub fetched_bytes_of_lost_attempts: u64,
    /// How often a transaction waited for the log's writer.
    pub log_waits: u64,
}

/// An attempt whose completion never arrived. Its number is never given twice for a tile.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub struct LostAttempt {
    pub tile: TileId,
    pub attempt: Attempt,
}

/// What became of the attempts at tiles.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
pub struct MasterTotals {
    pub attempts_issued: u64,
    pub attempts_accepted: u64,
    /// Completions of attempts that were no longer awaited.
    pub attempts_stale: u64,
    pub attempts_lost: u64,
}
