//! What a node traces from: all of the database, or a local memory that is filled over the bus.

use std::sync::Arc;

use super::bus_lines::BusLines;
use crate::database::verify::{Corrupt, Verified};
use crate::database::{Database, Header};
use crate::ids::Address;
use crate::machine::local_memory::{Geometry, GeometryError, LocalMemory, MemoryError};
use crate::machine::replacement::{self, Clock, Fifo, Lru, Random};
use crate::machine::stats::MemoryStats;
use crate::protocol::connection::ConnectionError;
use crate::protocol::control::NodeConfiguration;
use crate::protocol::memory::BULK_BYTES_MAX;
use crate::topology::{MemorySize, Replacement};
use crate::tracer::slices::Slices;
use crate::tracer::{AovSet, Pixels, Rect, TileTracer, TraceStats};

/// Why a tile is lost; a whole database has no such error.
pub type TraceError = MemoryError<ConnectionError>;

/// A memory that tiles are traced from, one after the other.
pub trait TileMemory {
    /// # Errors
    /// The memory's: the bus is lost, or a record is corrupt.
    fn trace(&mut self, tracer: &mut TileTracer, rect: Rect, aov: AovSet) -> Result<(Pixels, TraceStats), TraceError>;

    fn bus(&mut self) -> &mut BusLines;

    /// What was counted since the last call; `None` where nothing is.
    fn take_stats(&mut self) -> Option<MemoryStats>;
}

/// The memory that a topology asks for, ready to be traced from.
///
/// # Errors
/// The bus is lost, the database does not fit into this host's memory or is not sound, the size does not
/// fit the database.
pub fn new(configuration: &NodeConfiguration, bus: BusLines) -> Result<Box<dyn TileMemory>, MemoryStartError> {
    let NodeConfiguration { header, local_memory, seed, .. } = configuration;
    if local_memory.size == MemorySize::All {
        return Ok(Box::new(WholeDatabase::pull(header, bus)?));
    }
    let geometry = Geometry::new(local_memory, &header.layout)?;
    Ok(match local_memory.replacement {
        Replacement::Lru => Box::new(LocalMemory::<Lru, _>::new(geometry, &header.layout, *seed, bus)),
        Replacement::Fifo => Box::new(LocalMemory::<Fifo, _>::new(geometry, &header.layout, *seed, bus)),
        Replacement::Clock => Box::new(LocalMemory::<Clock, _>::new(geometry, &header.layout, *seed, bus)),
        Replacement::Random => Box::new(LocalMemory::<Random, _>::new(geometry, &header.layout, *seed, bus)),
    })
}

#[derive(Debug, thiserror::Error)]
pub enum MemoryStartError {
    #[error("{bytes} bytes of database do not fit into this host's memory")]
    OutOfMemory { bytes: u64 },
    #[error(transparent)]
    Bus(#[from] ConnectionError),
    #[error(transparent)]
    Corrupt(#[from] Corrupt),
    #[error(transparent)]
    Geometry(#[from] GeometryError),
}

impl<R: replacement::Replacement> TileMemory for LocalMemory<R, BusLines> {
    fn trace(&mut self, tracer: &mut TileTracer, rect: Rect, aov: AovSet) -> Result<(Pixels, TraceStats), TraceError> {
        tracer.trace(self, rect, aov)
    }

    fn bus(&mut self) -> &mut BusLines {
        self.source_mut()
    }

    fn take_stats(&mut self) -> Option<MemoryStats> {
        let mut stats = LocalMemory::take_stats(self);
        stats.stall_nanoseconds = u64::try_from(self.source_mut().take_stall().as_nanos()).unwrap_or(u64::MAX);
        Some(stats)
    }
}

/// A copy of the database in this process, pulled over the bus once.
#[derive(Debug)]
struct WholeDatabase {
    verified: Verified,
    bus: BusLines,
}

impl WholeDatabase {
    /// # Errors
    /// The bus is lost, the image does not fit into memory or is not a sound database.
    fn pull(header: &Header, mut bus: BusLines) -> Result<Self, MemoryStartError> {
        let bytes = header.layout.image_bytes();
        let out_of_memory = |_| MemoryStartError::OutOfMemory { bytes };
        let mut words: Vec<u32> = Vec::new();
        // Layouts are whole granules, hence whole words.
        words.try_reserve_exact(usize::try_from(bytes / 4).unwrap_or(usize::MAX)).map_err(out_of_memory)?;
        let mut address = 0;
        while address < bytes {
            let range = (bytes - address).min(u64::from(BULK_BYTES_MAX));
            let held = words.len();
            words.resize(held + range as usize / 4, 0);
            bus.read(Address(address), bytemuck::cast_slice_mut(&mut words[held..]))?;
            address += range;
        }
        let database = Database { header: header.clone(), words: Arc::new(words) };
        Ok(Self { verified: Verified::new(database)?, bus })
    }
}

impl TileMemory for WholeDatabase {
    fn trace(&mut self, tracer: &mut TileTracer, rect: Rect, aov: AovSet) -> Result<(Pixels, TraceStats), TraceError> {
        let Ok(traced) = tracer.trace(&mut Slices::new(&self.verified), rect, aov);
        Ok(traced)
    }

    fn bus(&mut self) -> &mut BusLines {
        &mut self.bus
    }

    fn take_stats(&mut self) -> Option<MemoryStats> {
        None
    }
}
