//! Nodes (who ask for tiles) with the master (which hands them out).

use serde::{Deserialize, Serialize};

use super::frame::messages;
use super::mac::Mac;
use ground::ids::{Attempt, TileId};
use machine::hardware::stats::{Counters, MemoryStats};
use trace::tracer::{RayKind, TraceStats};

/// How many tiles a node of so many threads may hold at once: per thread one to trace and one to begin with at once after it, and
/// two on their way to the display and back, which takes a while when every processor is busy tracing.
pub const fn jobs_per_node(threads: u16) -> usize {
    2 * threads as usize + 2
}

/// How many tiles a master asks the manager for, per node, waiting or handed out. It is given no more.
pub const fn tiles_per_node(threads: u16) -> u32 {
    2 * jobs_per_node(threads) as u32
}

#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub enum WorkRequest {
    /// The node can take one more tile.
    Ready,
    /// The display has acknowledged the tile, with this receipt.
    Done { done: Box<TileDone>, receipt: Mac },
}

#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub enum WorkReply {
    /// The permit is for the display.
    Job { tile: TileId, attempt: Attempt, permit: Mac },
}

/// A tile's completion carries its counters, so that a crash loses those of unfinished tiles only.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct TileDone {
    pub tile: TileId,
    pub attempt: Attempt,
    pub trace: TraceStats,
    /// `None` where all of the database is in local memory: nothing is counted.
    pub memory: Option<MemoryStats>,
    pub render_cpu_nanoseconds: u64,
}

/// Most of anything that one attempt can count. The counts of all tiles of the largest image fit 64 bits together.
const COUNT_MAX: u64 = 1 << 40;
/// A year.
const NANOSECONDS_MAX: u64 = 365 * 24 * 3600 * 1_000_000_000;

impl TileDone {
    /// What no tracer can have counted of a tile of so many pixels; `None`: the counts may be right.
    pub fn fault(&self, pixels: u64) -> Option<String> {
        let Self { trace, memory, render_cpu_nanoseconds, .. } = self;
        let primary = trace.rays[RayKind::Primary as usize];
        if primary != pixels {
            return Some(format!("{primary} primary rays, expected {pixels}, one per pixel"));
        }
        let of_trace = trace.rays.iter().chain(&trace.octree_accesses).copied();
        let others = [trace.primitive_tests, trace.polygon_triangles, trace.mailbox_skips, trace.non_finite_pixels];
        let counters = memory.iter().flat_map(|memory| memory.counters.as_flattened());
        let of_memory = counters.clone().flat_map(|c| [c.record_accesses, c.line_accesses]);
        if let Some(count) = of_trace.chain(others).chain(of_memory).find(|&count| count > COUNT_MAX) {
            return Some(format!("a count of {count}, expected at most {COUNT_MAX}"));
        }
        let is_whole = |c: &Counters| c.record_misses <= c.record_accesses && c.line_misses <= c.line_accesses;
        if !counters.clone().all(is_whole) {
            return Some("more misses than accesses".to_owned());
        }
        let nanoseconds = memory.iter().map(|memory| memory.stall_nanoseconds).chain([*render_cpu_nanoseconds]);
        let longest = nanoseconds.max().unwrap_or_default();
        (longest > NANOSECONDS_MAX).then(|| format!("a time of {longest} ns, expected at most {NANOSECONDS_MAX}"))
    }
}

messages! {
    // Two words per counter, four counters per class and ray kind.
    WorkRequest: 16 << 10, bulk 0;
    WorkReply: 64, bulk 0;
}

#[cfg(test)]
mod tests {
    use super::*;

    fn done() -> TileDone {
        TileDone {
            tile: TileId(0),
            attempt: Attempt(0),
            trace: TraceStats { rays: [9, 0, 0, 0], primitive_tests: COUNT_MAX, ..TraceStats::default() },
            memory: Some(MemoryStats::default()),
            render_cpu_nanoseconds: NANOSECONDS_MAX,
        }
    }

    #[test]
    fn counts_that_cannot_be_are_found() {
        assert_eq!(done().fault(9), None);
        type Change = fn(&mut TileDone);
        fn counters(done: &mut TileDone) -> &mut Counters {
            &mut done.memory.as_mut().expect("counted").counters[1][2]
        }
        let changes: [(&str, Change); 8] = [
            ("a count of 1099511627777", |done| done.trace.primitive_tests += 1),
            ("8 primary rays, expected 9", |done| done.trace.rays[0] = 8),
            ("a count of 18446744073709551615", |done| done.trace.rays[1] = u64::MAX),
            ("a count of", |done| done.trace.octree_accesses[20] = COUNT_MAX + 1),
            ("a count of", |done| counters(done).line_accesses = u64::MAX),
            ("more misses than accesses", |done| counters(done).record_misses = 1),
            ("more misses than accesses", |done| counters(done).line_misses = u64::MAX),
            ("a time of", |done| done.memory.as_mut().expect("counted").stall_nanoseconds = NANOSECONDS_MAX + 1),
        ];
        for (expected, change) in changes {
            let mut done = done();
            change(&mut done);
            let fault = done.fault(9).expect(expected);
            assert!(fault.starts_with(expected), "{fault}");
        }
    }
}
