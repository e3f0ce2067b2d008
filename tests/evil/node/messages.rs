//! Messages of the kinds that modes forge.

use cluster::protocol::image::TilePixels;
use cluster::protocol::mac::Mac;
use cluster::protocol::work::{TileDone, WorkRequest};
use ground::ids::{Attempt, TileId};
use machine::hardware::stats::MemoryStats;
use trace::picture::{AovSet, Pixels, Tiling};
use trace::tracer::TraceStats;

/// Whatever the planes are.
pub(crate) fn pixels(tile: TileId, attempt: Attempt, permit: Mac, planes: &[u8]) -> TilePixels {
    TilePixels { tile, attempt, permit, crc32c: crc32c::crc32c(planes) }
}

/// Without a receipt of the display.
pub(crate) fn told(tile: TileId, attempt: Attempt) -> WorkRequest {
    WorkRequest::Done { done: done(tile, attempt), receipt: Mac::default() }
}

/// Of a tile that was never traced.
fn done(tile: TileId, attempt: Attempt) -> Box<TileDone> {
    let memory = Some(MemoryStats::default());
    Box::new(TileDone { tile, attempt, trace: TraceStats::default(), memory, render_cpu_nanoseconds: 1 })
}

/// A tile's planes, every number of which is one half.
pub(crate) fn grey(tiling: Tiling, tile: TileId, aov: AovSet) -> Vec<u8> {
    let pixels = tiling.rect(tile).map_or(0, |rect| rect.pixel_count());
    0.5f32.to_le_bytes().repeat(Pixels::byte_len(pixels, aov) / 4)
}
