//! What a node traces tiles from.

use super::tiles::Job;
use crate::protocol::connection::ConnectionError;
use crate::protocol::control::Packets;
use machine::hardware::local_memory::MemoryError;
use machine::hardware::stats::MemoryStats;
use machine::recording::RecordingError;
use trace::picture::{AovSet, Pixels};
use trace::tracer::TraceStats;

/// Why a tile is lost; a whole database has no such error.
#[derive(Debug, thiserror::Error)]
pub enum TraceError {
    #[error(transparent)]
    Memory(#[from] MemoryError<ConnectionError>),
    #[error(transparent)]
    Recording(#[from] RecordingError),
}

/// A memory that tiles are traced from, one after the other, and what traces them.
pub trait TileMemory {
    /// # Errors
    /// The memory's: the bus is lost, or a record is corrupt. The recording's: it cannot be written.
    fn trace(&mut self, job: &Job, aov: AovSet) -> Result<(Pixels, TraceStats), TraceError>;

    /// What crosses the bus from now on is for this tile.
    fn begin(&mut self, job: &Job);

    /// Tells the bus of the tile's pixels, for its log.
    ///
    /// # Errors
    /// The bus is gone.
    fn tell_pixels(&mut self, job: &Job) -> Result<(), ConnectionError>;

    /// What was counted since the last call; `None` where nothing is.
    fn take_stats(&mut self) -> Option<MemoryStats>;

    /// `None`: single rays.
    fn packets(&self) -> Option<Packets>;
}
