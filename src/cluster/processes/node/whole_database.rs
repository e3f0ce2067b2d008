//! All of the database in this process, pulled over the bus once, and traced as `marti render` traces: packets
//! over a structure derived from it.

use std::sync::{Arc, Mutex, PoisonError};

use super::bus_lines::BusLines;
use super::tile_memory::{TileMemory, TraceError};
use super::tiles::Job;
use crate::protocol::connection::ConnectionError;
use crate::protocol::control::Packets;
use crate::protocol::memory::BULK_BYTES_MAX;
use ground::ids::Address;
use machine::hardware::stats::MemoryStats;
use trace::database::verify::{Corrupt, Verified};
use trace::database::{Database, Header};
use trace::picture::{AovSet, Pixels, Rect};
use trace::tracer::bvh8::{BatchTracer, Bvh8};
use trace::tracer::simd::Simd;
use trace::tracer::{TraceStats, View};

/// Traced in one call.
const STRIP_PIXELS: u32 = 32 * 32;
/// Packets are made of squares of so many pixels a side.
const STRIP_HEIGHT_MIN: u32 = 4;

#[derive(Debug, thiserror::Error)]
pub enum PullError {
    #[error("{bytes} bytes of database do not fit into this host's memory")]
    OutOfMemory { bytes: u64 },
    #[error(transparent)]
    Bus(#[from] ConnectionError),
    #[error(transparent)]
    Corrupt(#[from] Corrupt),
}

/// # Errors
/// The bus is lost, the image does not fit into memory or is not a sound database.
pub fn pull(header: &Header, bus: &mut BusLines) -> Result<Verified, PullError> {
    let bytes = header.layout.database_bytes();
    let out_of_memory = |_| PullError::OutOfMemory { bytes };
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
    Ok(Verified::new(Database { header: header.clone(), words: Arc::new(words) })?)
}

/// Of one thread, over what all threads share. Nothing is fetched, nothing counted but rays.
pub struct WholeDatabase<'a> {
    tracer: BatchTracer<'a>,
    packets: Packets,
    bus: &'a Mutex<BusLines>,
}

impl<'a> WholeDatabase<'a> {
    pub fn new(bvh: &'a Bvh8, database: &'a Verified, view: &View, simd: Simd, bus: &'a Mutex<BusLines>) -> Self {
        let packets = Packets { simd, derived_bytes: bvh.bytes() };
        Self { tracer: BatchTracer::new(bvh, database, view, simd), packets, bus }
    }
}

impl TileMemory for WholeDatabase<'_> {
    /// Strip by strip: the tracer is fastest when the rays of one call fit into a processor's cache, a run when
    /// tiles are larger than that.
    fn trace(&mut self, job: &Job, aov: AovSet) -> Result<(Pixels, TraceStats), TraceError> {
        let rect = job.rect;
        let mut stats = TraceStats::default();
        let mut pixels = Pixels::with_room(rect.pixel_count(), aov);
        let height = (STRIP_PIXELS / rect.width).max(STRIP_HEIGHT_MIN);
        let end = rect.y + rect.height;
        for y in (rect.y..end).step_by(height as usize) {
            let strip = Rect { y, height: height.min(end - y), ..rect };
            let (traced, counts) = self.tracer.trace(strip, aov);
            pixels.append(&traced);
            stats.add(&counts);
        }
        Ok((pixels, stats))
    }

    fn begin(&mut self, _: &Job) {}

    fn tell_pixels(&mut self, job: &Job) -> Result<(), ConnectionError> {
        let mut bus = self.bus.lock().unwrap_or_else(PoisonError::into_inner);
        bus.begin(job.tile, job.attempt);
        bus.tell_pixels(job.rect.pixel_count())
    }

    fn take_stats(&mut self) -> Option<MemoryStats> {
        None
    }

    fn packets(&self) -> Option<Packets> {
        Some(self.packets)
    }
}
