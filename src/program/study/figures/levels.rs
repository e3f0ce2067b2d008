//! Figure 1: the octree's nodes and their accesses by level, and what it costs not to build all levels.

use serde::Serialize;

use ground::ids::TileId;
use trace::database::records::LEVELS;
use trace::database::verify::Verified;
use trace::picture::{AovSet, Tiling};
use trace::tracer::octree::census::Census;
use trace::tracer::slices::Slices;
use trace::tracer::{TileTracer, TraceStats, View};

/// Floating point operations of a step to an octree node: the mid planes of three axes, two each.
pub const FLOPS_PER_VISIT: u64 = 6;
/// Of a test of a triangle: three vertices moved and sheared (seven each), three edge functions (three each).
pub const FLOPS_PER_TEST: u64 = 30;

/// One level of an octree.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Level {
    pub level: u32,
    pub nodes: u64,
    pub accesses: u64,
}

/// Shares of the octree's deepest levels, 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Deepest {
    pub nodes_share: f64,
    pub accesses_share: f64,
}

/// What tracing the image takes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Effort {
    /// Levels of the octree, the root's among them.
    pub levels: u32,
    pub octree_accesses: u64,
    pub primitive_tests: u64,
    /// Tests that the mailbox saved.
    pub mailbox_skips: u64,
}

/// Levels from the root's on, down to the deepest node.
pub fn levels(census: &Census, accesses: &[u64; LEVELS]) -> Vec<Level> {
    let nodes = census.levels.iter().map(|level| level.nodes());
    (0..).zip(nodes).zip(accesses).map(|((level, nodes), &accesses)| Level { level, nodes, accesses }).collect()
}

/// Of the `count` deepest levels.
pub fn deepest(levels: &[Level], count: u32) -> Deepest {
    let share = |of: fn(&Level) -> u64| {
        let first = levels.len().saturating_sub(count as usize);
        let sum = |levels: &[Level]| levels.iter().map(of).sum::<u64>() as f64;
        sum(&levels[first..]) / sum(levels).max(1.0)
    };
    Deepest { nodes_share: share(|level| level.nodes), accesses_share: share(|level| level.accesses) }
}

/// Traces the image from the whole database: single rays, nothing recorded.
pub fn trace(database: &Verified, view: &View, tiling: Tiling, mailbox: bool) -> TraceStats {
    let mut tracer = TileTracer::new(&database.database().header, view, mailbox);
    let mut port = Slices::new(database);
    let mut stats = TraceStats::default();
    for rect in (0..).map(TileId).map_while(|tile| tiling.rect(tile)) {
        let Ok((_, tile)) = tracer.trace(&mut port, rect, AovSet::default());
        stats.add(&tile);
    }
    stats
}

impl Effort {
    pub fn new(census: &Census, stats: &TraceStats) -> Self {
        Self {
            levels: census.levels.len() as u32,
            octree_accesses: stats.octree_accesses.iter().sum(),
            primitive_tests: stats.primitive_tests,
            mailbox_skips: stats.mailbox_skips,
        }
    }

    /// Tests against primitives, with the mailbox or as if there were none.
    pub fn tests(&self, mailbox: bool) -> u64 {
        self.primitive_tests + if mailbox { 0 } else { self.mailbox_skips }
    }

    /// In octree and tests, by [`FLOPS_PER_VISIT`] and [`FLOPS_PER_TEST`].
    pub fn flops(&self, mailbox: bool) -> u64 {
        FLOPS_PER_VISIT * self.octree_accesses + FLOPS_PER_TEST * self.tests(mailbox)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_and_flops_are_those_worked_by_hand() {
        let level = |level, nodes, accesses| Level { level, nodes, accesses };
        let levels = [level(0, 1, 50), level(1, 8, 30), level(2, 16, 15), level(3, 75, 5)];
        assert_eq!(deepest(&levels, 2), Deepest { nodes_share: 0.91, accesses_share: 0.2 });
        assert_eq!(deepest(&levels, 4), Deepest { nodes_share: 1.0, accesses_share: 1.0 });
        assert_eq!(deepest(&levels, 9), Deepest { nodes_share: 1.0, accesses_share: 1.0 });
        let effort = Effort { levels: 4, octree_accesses: 100, primitive_tests: 10, mailbox_skips: 5 };
        assert_eq!((effort.tests(true), effort.tests(false)), (10, 15));
        assert_eq!((effort.flops(true), effort.flops(false)), (600 + 300, 600 + 450));
    }
}
