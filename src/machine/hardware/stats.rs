//! What a local memory counts.

use serde::{Deserialize, Serialize};

use trace::database::records::LEVELS;
use trace::database::{Layout, Section};
use trace::tracer::memory_port::RayKind;

/// Octree nodes are counted by level, every other section as a whole.
pub const CLASSES: usize = LEVELS + Section::COUNT - 1;

/// The class of an octree node on `level`.
#[inline(always)]
pub const fn octree_class(level: u32) -> usize {
    level as usize
}

/// The class of a section other than the octree nodes.
#[inline(always)]
pub const fn section_class(section: Section) -> usize {
    LEVELS + section as usize - 1
}

/// The section that a class belongs to.
pub fn class_section(class: usize) -> Section {
    if class < LEVELS { Section::OctreeNodes } else { Section::ALL[class - LEVELS + 1] }
}

/// Records and lines, accesses and misses; hits are what remains.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counters {
    pub record_accesses: u64,
    /// Records with at least one line missing: each is one fetch.
    pub record_misses: u64,
    pub line_accesses: u64,
    pub line_misses: u64,
}

impl Counters {
    /// No sum wraps, whatever the counts.
    pub fn add(&mut self, other: &Self) {
        self.record_accesses = self.record_accesses.saturating_add(other.record_accesses);
        self.record_misses = self.record_misses.saturating_add(other.record_misses);
        self.line_accesses = self.line_accesses.saturating_add(other.line_accesses);
        self.line_misses = self.line_misses.saturating_add(other.line_misses);
    }

    pub fn record_hits(&self) -> u64 {
        self.record_accesses - self.record_misses
    }
}

/// Counts of one tile and attempt, or summed, by ray kind and class.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct MemoryStats {
    pub counters: Box<[[Counters; CLASSES]; RayKind::COUNT]>,
    /// Time the tracer waited for fetches. Wall clock: not reproducible.
    pub stall_nanoseconds: u64,
}

impl Default for MemoryStats {
    fn default() -> Self {
        Self { counters: Box::new([[Counters::default(); CLASSES]; RayKind::COUNT]), stall_nanoseconds: 0 }
    }
}

impl MemoryStats {
    pub fn add(&mut self, other: &Self) {
        for (mine, others) in self.counters.as_flattened_mut().iter_mut().zip(other.counters.as_flattened()) {
            mine.add(others);
        }
        self.stall_nanoseconds = self.stall_nanoseconds.saturating_add(other.stall_nanoseconds);
    }

    pub fn total(&self) -> Counters {
        let mut total = Counters::default();
        self.counters.as_flattened().iter().for_each(|c| total.add(c));
        total
    }

    /// Of one section, all ray kinds and levels.
    pub fn section(&self, section: Section) -> Counters {
        let mut total = Counters::default();
        let classes = self.counters.iter().flat_map(|kinds| kinds.iter().enumerate());
        classes.filter(|(class, _)| class_section(*class) == section).for_each(|(_, c)| total.add(c));
        total
    }

    /// 32-bit words that the tracer read of a database with this layout: every record access reads the whole record, with
    /// its padding.
    pub fn words_read(&self, layout: &Layout) -> u64 {
        let words = |class: usize| layout.record_bytes(class_section(class)) / 4;
        let classes = self.counters.iter().flat_map(|kinds| kinds.iter().enumerate());
        let read = classes.map(|(class, counters)| counters.record_accesses.saturating_mul(words(class)));
        read.fold(0, u64::saturating_add)
    }

    /// 32-bit words that came over the bus, for lines of so many bytes.
    pub fn words_moved(&self, line_bytes: u32) -> u64 {
        self.total().line_misses.saturating_mul(u64::from(line_bytes)) / 4
    }
}
