//! A local memory that is filled over the bus: one ray at a time, and every record is read through it.

use super::bus_lines::BusLines;
use super::tile_memory::{TileMemory, TraceError};
use super::tiles::Job;
use crate::protocol::connection::ConnectionError;
use crate::protocol::control::{NodeConfiguration, Packets};
use ground::ids::{Epoch, NodeId};
use machine::hardware::local_memory::{Geometry, GeometryError, LocalMemory};
use machine::hardware::references::{PART_WORDS, RecordNumbers, Recorder};
use machine::hardware::replacement::Replacement;
use machine::hardware::stats::MemoryStats;
use machine::recording::RecordingError;
use machine::recording::references::Writer;
use trace::picture::{AovSet, Pixels};
use trace::tracer::{TileTracer, TraceStats};

/// What is read through the local memory, written down.
pub(super) struct References {
    writer: Writer,
    numbers: RecordNumbers,
    /// Of the part begun.
    words: Vec<u32>,
}

impl References {
    /// `None` where none are to be recorded.
    ///
    /// # Errors
    /// The recording cannot be written.
    pub(super) fn new(
        configuration: &NodeConfiguration,
        (node, epoch): (NodeId, Epoch),
    ) -> Result<Option<Self>, RecordingError> {
        let Some(folder) = &configuration.references else { return Ok(None) };
        let layout = &configuration.header.layout;
        let writer = Writer::create(folder, node, epoch, layout)?;
        let numbers = RecordNumbers::new(layout);
        Ok(Some(Self { writer, numbers, words: Vec::with_capacity(PART_WORDS + PART_WORDS / 16) }))
    }
}

/// Less than the whole database: one ray at a time, every record through the local memory.
pub(super) struct SimulatedMemory<R> {
    memory: LocalMemory<R, BusLines>,
    tracer: TileTracer,
    references: Option<References>,
}

impl<R: Replacement> SimulatedMemory<R> {
    /// # Errors
    /// The size does not fit the database.
    pub(super) fn new(
        configuration: &NodeConfiguration,
        bus: BusLines,
        references: Option<References>,
    ) -> Result<Self, GeometryError> {
        let NodeConfiguration { header, view, octree, local_memory, seed, .. } = configuration;
        let geometry = Geometry::new(local_memory, &header.layout)?;
        let memory = LocalMemory::new(geometry, &header.layout, *seed, bus);
        Ok(Self { memory, tracer: TileTracer::new(header, view, octree.mailbox), references })
    }
}

impl<R: Replacement> TileMemory for SimulatedMemory<R> {
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

    fn begin(&mut self, job: &Job) {
        self.memory.source_mut().begin(job.tile, job.attempt);
    }

    fn tell_pixels(&mut self, job: &Job) -> Result<(), ConnectionError> {
        self.memory.source_mut().tell_pixels(job.rect.pixel_count())
    }

    fn take_stats(&mut self) -> Option<MemoryStats> {
        let mut stats = self.memory.take_stats();
        stats.stall_nanoseconds = u64::try_from(self.memory.source_mut().take_stall().as_nanos()).unwrap_or(u64::MAX);
        Some(stats)
    }

    fn packets(&self) -> Option<Packets> {
        None
    }
}
