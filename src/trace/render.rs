//! `marti render`: the whole database in one process, no sockets. The reference for the bits of every other
//! way to render, and the fastest on one machine.

use std::convert::Infallible;
use std::io;
use std::num::NonZero;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard};
use std::thread;
use std::time::{Duration, Instant};

use crate::database::verify::Verified;
use crate::image_file::{FrameBuffer, FrameBufferError};
use crate::picture::{AovSet, ImageSettings, Pixels, Rect, Sides, Tiling};
use crate::tracer::bvh8::{BatchTracer, Bvh8};
use crate::tracer::simd::Simd;
use crate::tracer::slices::Slices;
use crate::tracer::{TileTracer, TraceStats, View};
use ground::ids::TileId;
use ground::processor_time;
use ground::progress::Status;

/// Pixels a side: large enough that handing one out costs nothing, small enough to balance threads.
const TILE: u32 = 32;

/// Tiles that a thread keeps while another one writes into the frame.
const KEPT: usize = 16;

/// What traces. The image is the same.
#[derive(Clone, Copy, Debug)]
pub enum Kernel<'a> {
    /// One ray at a time over the shared image, as every simulation does.
    Single { mailbox: bool },
    /// Packets over the structure derived from it.
    Packets(&'a Bvh8, Simd),
}

/// How to render, besides what decides the image.
#[derive(Clone, Copy, Debug)]
pub struct Settings<'a> {
    /// At least 1.
    pub threads: usize,
    pub aov: AovSet,
    pub kernel: Kernel<'a>,
}

/// An image, and what it cost.
#[derive(Debug)]
pub struct Rendering {
    pub frame: FrameBuffer,
    pub stats: TraceStats,
    /// Wall clock, from the first tile to the last.
    pub wall: Duration,
    /// Processor time of the tracing threads, summed.
    pub cpu: Duration,
}

/// Why an image is not rendered.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    #[error(transparent)]
    Frame(#[from] FrameBufferError),
    #[error("cannot start {threads} threads: {error}")]
    Thread { threads: usize, error: io::Error },
}

/// Renders views of one database, as fast as this host can.
#[derive(Debug)]
pub struct Renderer<'a> {
    database: &'a Verified,
    bvh: Bvh8,
    threads: usize,
    aov: AovSet,
}

impl<'a> Renderer<'a> {
    /// Builds the fast kernel's hierarchy. One thread per processor, and colours alone.
    pub fn new(database: &'a Verified) -> Self {
        let threads = thread::available_parallelism().map_or(1, NonZero::get);
        Self { database, bvh: Bvh8::build(database), threads, aov: AovSet::default() }
    }

    /// On so many threads; 0 counts as 1. The image does not depend on it.
    #[must_use]
    pub fn threads(self, threads: usize) -> Self {
        Self { threads: threads.max(1), ..self }
    }

    /// What to keep of the first hits besides the colour.
    #[must_use]
    pub fn aov(self, aov: AovSet) -> Self {
        Self { aov, ..self }
    }

    /// # Errors
    /// As [`render`]'s.
    pub fn render(&self, view: &View) -> Result<Rendering, RenderError> {
        let kernel = Kernel::Packets(&self.bvh, Simd::best());
        render(self.database, view, Settings { threads: self.threads, aov: self.aov, kernel }, |_| ())
    }
}

/// Renders `view` of a database; `on_tile` gets its progress, from any thread.
///
/// # Errors
/// There is no memory for the image, or the system has no thread left.
pub fn render(
    database: &Verified,
    view: &View,
    settings: Settings<'_>,
    on_tile: impl Fn(&Status) + Sync,
) -> Result<Rendering, RenderError> {
    let image = &view.image;
    let tiling = tiling(image);
    let frame = Mutex::new(FrameBuffer::new(image.width(), image.height(), settings.aov)?);
    let (next, done, rays) = (AtomicU32::new(0), AtomicU32::new(0), AtomicU64::new(0));
    let start = Instant::now();
    let worker = || {
        let cpu_at_start = processor_time::of_this_thread();
        let mut tracer = Tracer::new(database, view, settings.kernel);
        let (mut stats, mut finished) = (TraceStats::default(), Vec::with_capacity(KEPT));
        while let Some(rect) = tiling.rect(TileId(next.fetch_add(1, Ordering::Relaxed))) {
            let (pixels, counts) = tracer.trace(rect, settings.aov);
            stats.add(&counts);
            rays.fetch_add(counts.all_rays(), Ordering::Relaxed);
            finished.push((rect, pixels));
            // Whoever finds the frame taken keeps its tiles until it is free, or until they are many.
            match frame.try_lock() {
                Ok(whole) => put(whole, &mut finished),
                Err(_) if finished.len() == KEPT => put(lock(&frame), &mut finished),
                Err(_) => {}
            }
            on_tile(&Status {
                tiles_done: done.fetch_add(1, Ordering::Relaxed) + 1,
                tiles: tiling.tile_count(),
                rays: rays.load(Ordering::Relaxed),
                elapsed: Some(start.elapsed()),
            });
        }
        put(lock(&frame), &mut finished);
        (stats, processor_time::of_this_thread().saturating_sub(cpu_at_start))
    };
    let (mut stats, mut cpu, mut missing) = (TraceStats::default(), Duration::ZERO, None);
    thread::scope(|scope| {
        let start = |_| thread::Builder::new().spawn_scoped(scope, worker);
        let started: Vec<_> = (0..settings.threads).map(start).collect();
        for worker in started {
            let worker = match worker {
                Ok(worker) => worker,
                Err(error) => {
                    // Those that were started find nothing more to do.
                    next.store(tiling.tile_count(), Ordering::Relaxed);
                    missing = Some(error);
                    continue;
                }
            };
            let (counts, time) = worker.join().expect("a tracing thread does not panic");
            stats.add(&counts);
            cpu += time;
        }
    });
    if let Some(error) = missing {
        return Err(RenderError::Thread { threads: settings.threads, error });
    }
    let wall = start.elapsed();
    Ok(Rendering { frame: frame.into_inner().expect("no thread panicked"), stats, wall, cpu })
}

fn lock(frame: &Mutex<FrameBuffer>) -> MutexGuard<'_, FrameBuffer> {
    frame.lock().expect("no thread panics while it holds the frame")
}

fn put(mut frame: MutexGuard<'_, FrameBuffer>, finished: &mut Vec<(Rect, Pixels)>) {
    for (rect, pixels) in finished.drain(..) {
        frame.blit(rect, &pixels).expect("a tile of this very image");
    }
}

/// One thread's tracer.
enum Tracer<'a> {
    Single(Box<TileTracer>, Slices<'a>),
    Packets(Box<BatchTracer<'a>>),
}

impl<'a> Tracer<'a> {
    fn new(database: &'a Verified, view: &View, kernel: Kernel<'a>) -> Self {
        match kernel {
            Kernel::Single { mailbox } => {
                let tracer = TileTracer::new(&database.database().header, view, mailbox);
                Self::Single(Box::new(tracer), Slices::new(database))
            }
            Kernel::Packets(octree, simd) => Self::Packets(Box::new(BatchTracer::new(octree, database, view, simd))),
        }
    }

    fn trace(&mut self, rect: Rect, aov: AovSet) -> (Pixels, TraceStats) {
        match self {
            Self::Single(tracer, port) => {
                let Ok::<_, Infallible>(traced) = tracer.trace(port, rect, aov);
                traced
            }
            Self::Packets(tracer) => tracer.trace(rect, aov),
        }
    }
}

/// How many tiles [`render`] cuts an image into.
pub fn tile_count(image: &ImageSettings) -> u32 {
    tiling(image).tile_count()
}

fn tiling(image: &ImageSettings) -> Tiling {
    let sides = Sides { width: image.width(), height: image.height(), tile_width: TILE, tile_height: TILE };
    Tiling::new(sides).expect("an image's sides, and 2048 times 2048 tiles at most")
}
