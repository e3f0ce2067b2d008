//! Messages of the kinds that modes forge.

use marti::ids::{Attempt, TileId};
use marti::machine::stats::MemoryStats;
use marti::protocol::image::TilePixels;
use marti::protocol::work::TileDone;
use marti::tracer::{AovSet, Pixels, Tiling, TraceStats};

/// Of pixels that nobody has asked for.
pub(crate) fn pixels(tile: TileId, attempt: Attempt, planes: &[u8]) -> TilePixels {
    TilePixels { tile, attempt, crc32c: crc32c::crc32c(planes) }
}

/// Of a tile that was never traced.
pub(crate) fn done(tile: TileId, attempt: Attempt) -> Box<TileDone> {
    let memory = Some(MemoryStats::default());
    Box::new(TileDone { tile, attempt, trace: TraceStats::default(), memory, render_cpu_nanoseconds: 1 })
}

/// A tile's planes, every number of which is one half.
pub(crate) fn grey(tiling: Tiling, tile: TileId, aov: AovSet) -> Vec<u8> {
    let pixels = tiling.rect(tile).map_or(0, |rect| rect.pixel_count());
    0.5f32.to_le_bytes().repeat(Pixels::byte_len(pixels, aov) / 4)
}
