//! What a node traces from: all of the database, or a local memory that is filled over the bus.

use super::bus_lines::BusLines;
use super::whole_database::{self, PullError, WholeDatabase};
use crate::machine::local_memory::{Geometry, GeometryError, LocalMemory, MemoryError};
use crate::machine::replacement::{Clock, Fifo, Lru, Random, Replacement};
use crate::machine::stats::MemoryStats;
use crate::protocol::connection::ConnectionError;
use crate::protocol::control::{NodeConfiguration, Packets};
use crate::topology::{self, MemorySize};
use crate::tracer::simd::Simd;
use crate::tracer::wide::WideOctree;
use crate::tracer::{AovSet, Pixels, Rect, TileTracer, TraceStats};

/// Why a tile is lost; a whole database has no such error.
pub type TraceError = MemoryError<ConnectionError>;

/// A memory that tiles are traced from, one after the other, and what traces them.
pub trait TileMemory {
    /// # Errors
    /// The memory's: the bus is lost, or a record is corrupt.
    fn trace(&mut self, rect: Rect, aov: AovSet) -> Result<(Pixels, TraceStats), TraceError>;

    fn bus(&mut self) -> &mut BusLines;

    /// What was counted since the last call; `None` where nothing is.
    fn take_stats(&mut self) -> Option<MemoryStats>;

    /// `None`: single rays.
    fn packets(&self) -> Option<Packets>;
}

/// Makes the memory that a topology asks for and gives it to `serve`.
///
/// # Errors
/// The bus is lost, the database does not fit into this host's memory or is not sound, the size does not
/// fit the database; or those of `serve`.
pub fn with<E: From<MemoryStartError>>(
    configuration: &NodeConfiguration,
    mut bus: BusLines,
    serve: impl FnOnce(&mut dyn TileMemory) -> Result<(), E>,
) -> Result<(), E> {
    let NodeConfiguration { header, view, local_memory, .. } = configuration;
    if local_memory.size == MemorySize::All {
        let database = whole_database::pull(header, &mut bus).map_err(MemoryStartError::from)?;
        let octree = WideOctree::derive(&database);
        return serve(&mut WholeDatabase::new(&octree, &database, view, Simd::best(), bus));
    }
    match local_memory.replacement {
        topology::Replacement::Lru => serve(&mut Simulated::<Lru>::new(configuration, bus)?),
        topology::Replacement::Fifo => serve(&mut Simulated::<Fifo>::new(configuration, bus)?),
        topology::Replacement::Clock => serve(&mut Simulated::<Clock>::new(configuration, bus)?),
        topology::Replacement::Random => serve(&mut Simulated::<Random>::new(configuration, bus)?),
    }
}

#[derive(Debug, thiserror::Error)]
pub enum MemoryStartError {
    #[error(transparent)]
    Pull(#[from] PullError),
    #[error(transparent)]
    Geometry(#[from] GeometryError),
}

/// Less than the whole database: one ray at a time, every record through the local memory.
struct Simulated<R> {
    memory: LocalMemory<R, BusLines>,
    tracer: TileTracer,
}

impl<R: Replacement> Simulated<R> {
    fn new(configuration: &NodeConfiguration, bus: BusLines) -> Result<Self, MemoryStartError> {
        let NodeConfiguration { header, view, octree, local_memory, seed, .. } = configuration;
        let geometry = Geometry::new(local_memory, &header.layout)?;
        let memory = LocalMemory::new(geometry, &header.layout, *seed, bus);
        Ok(Self { memory, tracer: TileTracer::new(header, view, octree.mailbox) })
    }
}

impl<R: Replacement> TileMemory for Simulated<R> {
    fn trace(&mut self, rect: Rect, aov: AovSet) -> Result<(Pixels, TraceStats), TraceError> {
        self.tracer.trace(&mut self.memory, rect, aov)
    }

    fn bus(&mut self) -> &mut BusLines {
        self.memory.source_mut()
    }

    fn take_stats(&mut self) -> Option<MemoryStats> {
        let mut stats = self.memory.take_stats();
        stats.stall_nanoseconds = u64::try_from(self.bus().take_stall().as_nanos()).unwrap_or(u64::MAX);
        Some(stats)
    }

    fn packets(&self) -> Option<Packets> {
        None
    }
}
