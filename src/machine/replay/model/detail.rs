//! Counts as a live node makes them: by ray kind, section and octree level.

use crate::hardware::references::RecordNumbers;
use crate::hardware::stats::{MemoryStats, octree_class, section_class};
use crate::replay::Trace;
use crate::replay::model::replayer::Tally;
use trace::database::records::MAX_DEPTH;
use trace::database::{Layout, Section};
use trace::tracer::RayKind;

/// What a record is counted as.
#[derive(Clone, Debug)]
pub struct Classes<'a> {
    numbers: RecordNumbers,
    levels: &'a [u8],
}

impl<'a> Classes<'a> {
    /// `levels`: by block of eight octree words, the level that its nodes are on.
    pub fn new(layout: &Layout, levels: &'a [u8]) -> Self {
        Self { numbers: RecordNumbers::new(layout), levels }
    }

    /// The section of a record and its class, as [`MemoryStats`] counts them.
    #[inline(always)]
    pub fn of(&self, record: u32) -> (Section, usize) {
        let (section, index) = self.numbers.place(record);
        let class = match section {
            Section::OctreeNodes => octree_class(self.level(index)),
            _ => section_class(section),
        };
        (section, class)
    }

    /// The section of a record, and its index there.
    #[inline(always)]
    pub fn place(&self, record: u32) -> (Section, u32) {
        self.numbers.place(record)
    }

    /// The level of an octree node.
    #[inline(always)]
    pub fn level(&self, index: u32) -> u32 {
        self.levels.get(index as usize / 8).map_or(MAX_DEPTH, |&level| u32::from(level).min(MAX_DEPTH))
    }
}

/// [`MemoryStats`] of accepted tiles.
pub struct Detail<'a, T: ?Sized> {
    trace: &'a T,
    classes: Classes<'a>,
    accepted: bool,
    kind: RayKind,
    pub stats: MemoryStats,
}

impl<'a, T: Trace + ?Sized> Detail<'a, T> {
    pub fn new(trace: &'a T, classes: Classes<'a>) -> Self {
        Self { trace, classes, accepted: false, kind: RayKind::Primary, stats: MemoryStats::default() }
    }
}

impl<T: Trace + ?Sized> Tally for Detail<'_, T> {
    fn tile(&mut self, tile: u32) {
        self.accepted = self.trace.tiles()[tile as usize].accepted;
        self.kind = RayKind::Primary;
    }

    #[inline(always)]
    fn ray(&mut self, kind: RayKind) {
        self.kind = kind;
    }

    #[inline(always)]
    fn read(&mut self, record: u32, lines: u32, missing: u32) {
        if self.accepted {
            let counters = &mut self.stats.counters[self.kind as usize][self.classes.of(record).1];
            counters.record_accesses += 1;
            counters.line_accesses += u64::from(lines);
            counters.record_misses += u64::from(missing > 0);
            counters.line_misses += u64::from(missing);
        }
    }
}
