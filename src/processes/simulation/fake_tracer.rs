//! Pixels and counts that depend on the tile alone, so that everybody knows what is right.

use std::time::Duration;

use super::dice::hash;
use crate::database::Section;
use crate::ids::{Attempt, NodeId, TileId};
use crate::machine::specification::MemorySize;
use crate::machine::stats::{Counters, MemoryStats, section_class};
use crate::picture::Pixels;
use crate::protocol::work::TileDone;
use crate::tracer::TraceStats;

/// Of the one pixel that a tile has.
pub(super) fn pixels(tile: TileId) -> Pixels {
    let channel = |channel| (hash(u64::from(tile.0), channel) >> 40) as f32 / (1 << 24) as f32;
    Pixels { colour: vec![[channel(0), channel(1), channel(2)]], ..Pixels::default() }
}

/// What a corrupt node makes of them: another bit is wrong with every node.
pub(super) fn corrupt(mut pixels: Pixels, node: NodeId) -> Pixels {
    for colour in pixels.colour.iter_mut().flatten() {
        *colour = f32::from_bits(colour.to_bits() ^ (1 << (node.0 % 23)));
    }
    pixels
}

/// Some tiles take ten times as long as most.
pub(super) fn takes(tile: TileId) -> Duration {
    let chance = hash(u64::from(tile.0), 7);
    let usual = Duration::from_micros(5_000 + chance % 45_000);
    if chance >> 32 & 15 == 0 { 10 * usual } else { usual }
}

/// Record and line misses of an attempt: a memory that is warm misses less.
pub(super) fn misses(tile: TileId, attempt: Attempt) -> (u64, u64) {
    let records = 1 + hash(u64::from(tile.0), 100 + u64::from(attempt.0)) % 30;
    (records, records + records / 3)
}

pub(super) fn done(tile: TileId, attempt: Attempt, size: MemorySize) -> TileDone {
    let (record_misses, line_misses) = misses(tile, attempt);
    let accesses = 40 + hash(u64::from(tile.0), 8) % 1000;
    let trace = TraceStats { rays: [1, 0, 0, 0], primitive_tests: accesses, ..TraceStats::default() };
    let memory = (size != MemorySize::All).then(|| {
        let mut stats = MemoryStats::default();
        let line_accesses = 2 * accesses;
        stats.counters[0][section_class(Section::Triangles)] =
            Counters { record_accesses: accesses, record_misses, line_accesses, line_misses };
        stats
    });
    TileDone { tile, attempt, trace, memory, render_cpu_nanoseconds: takes(tile).as_nanos() as u64 }
}
