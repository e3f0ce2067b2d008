//! What a node traces from: all of the database, or a local memory that is filled over the bus.

use super::bus_lines::BusLines;
use super::state::Job;
use super::whole_database::{self, PullError, WholeDatabase};
use crate::ids::{Epoch, NodeId};
use crate::machine::local_memory::{Geometry, GeometryError, LocalMemory, MemoryError};
use crate::machine::references::{PART_WORDS, RecordNumbers, Recorder};
use crate::machine::replacement::{Clock, Fifo, Lru, Random, Replacement};
use crate::machine::specification::{self, MemorySize};
use crate::machine::stats::MemoryStats;
use crate::picture::{AovSet, Pixels};
use crate::protocol::connection::ConnectionError;
use crate::protocol::control::{NodeConfiguration, Packets};
use crate::recording::RecordingError;
use crate::recording::references::Writer;
use crate::tracer::simd::Simd;
use crate::tracer::wide::WideOctree;
use crate::tracer::{TileTracer, TraceStats};

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
    process: (NodeId, Epoch),
    mut bus: BusLines,
    serve: impl FnOnce(&mut dyn TileMemory) -> Result<(), E>,
) -> Result<(), E> {
    let NodeConfiguration { header, view, local_memory, .. } = configuration;
    if local_memory.size == MemorySize::All {
        let database = whole_database::pull(header, &mut bus).map_err(MemoryStartError::from)?;
        let octree = WideOctree::derive(&database);
        return serve(&mut WholeDatabase::new(&octree, &database, view, Simd::best(), bus));
    }
    let references = References::new(configuration, process).map_err(MemoryStartError::from)?;
    match local_memory.replacement {
        specification::Replacement::Lru => serve(&mut Simulated::<Lru>::new(configuration, bus, references)?),
        specification::Replacement::Fifo => serve(&mut Simulated::<Fifo>::new(configuration, bus, references)?),
        specification::Replacement::Clock => serve(&mut Simulated::<Clock>::new(configuration, bus, references)?),
        specification::Replacement::Random => serve(&mut Simulated::<Random>::new(configuration, bus, references)?),
    }
}

#[derive(Debug, thiserror::Error)]
pub enum MemoryStartError {
    #[error(transparent)]
    Pull(#[from] PullError),
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    #[error(transparent)]
    Recording(#[from] RecordingError),
}

/// What is read through the local memory, written down.
struct References {
    writer: Writer,
    numbers: RecordNumbers,
    /// Of the part begun.
    words: Vec<u32>,
}

impl References {
    /// `None` where none are to be recorded.
    fn new(configuration: &NodeConfiguration, (node, epoch): (NodeId, Epoch)) -> Result<Option<Self>, RecordingError> {
        let Some(folder) = &configuration.references else { return Ok(None) };
        let layout = &configuration.header.layout;
        let writer = Writer::create(folder, node, epoch, layout)?;
        let numbers = RecordNumbers::new(layout);
        Ok(Some(Self { writer, numbers, words: Vec::with_capacity(PART_WORDS + PART_WORDS / 16) }))
    }
}

/// Less than the whole database: one ray at a time, every record through the local memory.
struct Simulated<R> {
    memory: LocalMemory<R, BusLines>,
    tracer: TileTracer,
    references: Option<References>,
}

impl<R: Replacement> Simulated<R> {
    fn new(
        configuration: &NodeConfiguration,
        bus: BusLines,
        references: Option<References>,
    ) -> Result<Self, MemoryStartError> {
        let NodeConfiguration { header, view, octree, local_memory, seed, .. } = configuration;
        let geometry = Geometry::new(local_memory, &header.layout)?;
        let memory = LocalMemory::new(geometry, &header.layout, *seed, bus);
        Ok(Self { memory, tracer: TileTracer::new(header, view, octree.mailbox), references })
    }
}

impl<R: Replacement> TileMemory for Simulated<R> {
    fn trace(&mut self, job: &Job, aov: AovSet) -> Result<(Pixels, TraceStats), TraceError> {
        let Some(References { writer, numbers, words }) = &mut self.references else {
            return Ok(self.tracer.trace(&mut self.memory, job.rect, aov)?);
        };
        writer.begin(job.tile, job.attempt);
        words.clear();
        let mut port = Recorder::new(&mut self.memory, *numbers, words, |part| writer.part(part));
        let (pixels, stats) = self.tracer.trace(&mut port, job.rect, aov)?;
        writer.end(words, stats.primitive_tests)?;
        Ok((pixels, stats))
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
