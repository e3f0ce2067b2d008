//! What the local memories counted, summed and apart.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::ratio;
use machine::hardware::local_memory::MemoryShape;
use machine::hardware::stats::{Counters, MemoryStats, octree_class};
use trace::database::records::LEVELS;
use trace::database::{Layout, Section};
use trace::tracer::RayKind;

/// All nodes together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Memory {
    pub record_accesses: u64,
    /// Record accesses with at least one line missing: each is one fetch.
    pub misses: u64,
    pub misses_per_record_access: f64,
    pub line_accesses: u64,
    pub line_misses: u64,
    /// 32-bit words.
    pub words_read: u64,
    pub words_moved: u64,
    pub words_moved_per_word_read: f64,
    #[serde(flatten)]
    pub shape: MemoryShape,
    pub line_bytes: u32,
    pub by_section: Vec<SectionCounts>,
    /// Octree nodes, from the root's level to the deepest one accessed.
    pub by_octree_level: Vec<LevelCounts>,
    pub by_ray_kind: Vec<RayKindCounts>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct AccessCounts {
    pub record_accesses: u64,
    pub misses: u64,
    pub line_accesses: u64,
    pub line_misses: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct SectionCounts {
    pub section: Section,
    #[serde(flatten)]
    pub counts: AccessCounts,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct LevelCounts {
    pub level: u32,
    #[serde(flatten)]
    pub counts: AccessCounts,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct RayKindCounts {
    pub ray_kind: RayKind,
    #[serde(flatten)]
    pub counts: AccessCounts,
}

/// One node.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct NodeMemory {
    pub record_accesses: u64,
    pub hits: u64,
    pub misses: u64,
    pub line_accesses: u64,
    pub line_misses: u64,
    /// 32-bit words.
    pub words_read: u64,
    pub words_moved: u64,
    /// Wall clock.
    pub stall_seconds: f64,
}

impl Memory {
    /// Of reads of a database with this layout.
    pub fn new(stats: &MemoryStats, layout: &Layout, line_bytes: u32, shape: MemoryShape) -> Self {
        let total = stats.total();
        let (words_read, words_moved) = (stats.words_read(layout), stats.words_moved(line_bytes));
        Self {
            record_accesses: total.record_accesses,
            misses: total.record_misses,
            misses_per_record_access: ratio(total.record_misses as f64, total.record_accesses as f64),
            line_accesses: total.line_accesses,
            line_misses: total.line_misses,
            words_read,
            words_moved,
            words_moved_per_word_read: ratio(words_moved as f64, words_read as f64),
            shape,
            line_bytes,
            by_section: by_section(stats),
            by_octree_level: by_octree_level(stats),
            by_ray_kind: by_ray_kind(stats),
        }
    }

    /// Share of the record accesses that found all their lines, 0 to 1.
    pub fn hit_rate(&self) -> f64 {
        ratio((self.record_accesses - self.misses) as f64, self.record_accesses as f64)
    }
}

impl NodeMemory {
    /// Of reads of a database with this layout.
    pub fn new(stats: &MemoryStats, layout: &Layout, line_bytes: u32) -> Self {
        let total = stats.total();
        Self {
            record_accesses: total.record_accesses,
            hits: total.record_hits(),
            misses: total.record_misses,
            line_accesses: total.line_accesses,
            line_misses: total.line_misses,
            words_read: stats.words_read(layout),
            words_moved: stats.words_moved(line_bytes),
            stall_seconds: stats.stall_nanoseconds as f64 * 1e-9,
        }
    }
}

impl From<Counters> for AccessCounts {
    fn from(counters: Counters) -> Self {
        Self {
            record_accesses: counters.record_accesses,
            misses: counters.record_misses,
            line_accesses: counters.line_accesses,
            line_misses: counters.line_misses,
        }
    }
}

/// Sum of the counters whose ray kind and class are chosen.
fn sum(stats: &MemoryStats, chosen: impl Fn(RayKind, usize) -> bool) -> AccessCounts {
    let mut sum = Counters::default();
    for (kind, classes) in RayKind::ALL.into_iter().zip(stats.counters.iter()) {
        for (class, counters) in classes.iter().enumerate() {
            if chosen(kind, class) {
                sum.add(counters);
            }
        }
    }
    sum.into()
}

fn by_section(stats: &MemoryStats) -> Vec<SectionCounts> {
    Section::ALL.into_iter().map(|section| SectionCounts { section, counts: stats.section(section).into() }).collect()
}

fn by_octree_level(stats: &MemoryStats) -> Vec<LevelCounts> {
    let counts = |level| sum(stats, |_, class| class == octree_class(level));
    let mut levels: Vec<_> = (0..LEVELS as u32).map(|level| LevelCounts { level, counts: counts(level) }).collect();
    let used = levels.iter().rposition(|level| level.counts.record_accesses > 0).map_or(0, |deepest| deepest + 1);
    levels.truncate(used);
    levels
}

fn by_ray_kind(stats: &MemoryStats) -> Vec<RayKindCounts> {
    let counts = |kind| sum(stats, |k, _| k == kind);
    RayKind::ALL.into_iter().map(|ray_kind| RayKindCounts { ray_kind, counts: counts(ray_kind) }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::fixture;

    #[test]
    fn sums_and_ratios_are_those_worked_by_hand() {
        let memory = Memory::new(&fixture::memory_stats(), &fixture::layout(), 32, fixture::SHAPE);
        assert_eq!((memory.record_accesses, memory.misses), (100 + 300 + 50 + 40, 1 + 30 + 9 + 10));
        assert_eq!((memory.line_accesses, memory.line_misses), (530, 55));
        assert_eq!((memory.words_read, memory.words_moved), (450 + 40 * 10, 55 * 8));
        assert_eq!(memory.misses_per_record_access, 50.0 / 490.0);
        assert_eq!(memory.words_moved_per_word_read, 440.0 / 850.0);
        assert_eq!(memory.hit_rate(), 440.0 / 490.0);
    }

    #[test]
    fn every_way_to_cut_the_counts_has_the_same_sum() {
        let memory = Memory::new(&fixture::memory_stats(), &fixture::layout(), 32, fixture::SHAPE);
        let levels: Vec<_> = memory.by_octree_level.iter().map(|l| (l.level, l.counts.record_accesses)).collect();
        assert_eq!(levels, [(0, 100), (1, 0), (2, 350)]);
        let sections: u64 = memory.by_section.iter().map(|s| s.counts.misses).sum();
        let kinds: u64 = memory.by_ray_kind.iter().map(|k| k.counts.misses).sum();
        assert_eq!((sections, kinds), (memory.misses, memory.misses));
        assert_eq!(memory.by_section[0].counts.misses, 40);
        assert_eq!(memory.by_ray_kind[RayKind::Shadow as usize].counts.line_misses, 24);
    }

    #[test]
    fn nothing_counted_gives_no_nan() {
        let memory = Memory::new(&MemoryStats::default(), &fixture::layout(), 64, fixture::SHAPE);
        assert_eq!((memory.misses_per_record_access, memory.words_moved_per_word_read), (0.0, 0.0));
        assert!(memory.by_octree_level.is_empty());
    }
}
