//! A scene that was traced, to be looked at from all sides.

use crate::database::Layout;
use crate::database::verify::Verified;
use crate::machine::local_memory::Geometry;
use crate::machine::references::{Event, Word};
use crate::machine::replacement::Replacement;
use crate::machine::stats::MemoryStats;
use crate::recording::references::octree_levels;
use crate::replay::count::{Replayer, Sum, Tally, Totals};
use crate::replay::curve::{self, LruCurve};
use crate::replay::detail::{Classes, Detail};
use crate::replay::schedule::Schedule;
use crate::replay::{RecordLines, Trace, TraceError};
use crate::topology::Octree;

/// References, and the database that they are of.
#[derive(Clone, Debug)]
pub struct Traced<T> {
    /// As a topology names it.
    pub scene: String,
    pub octree: Octree,
    pub layout: Layout,
    pub trace: T,
    /// All that was read, by ray kind, section and level. Nothing missed.
    pub reads: MemoryStats,
}

impl<T> Traced<T> {
    /// 32-bit words, by all rays.
    pub fn words_read(&self) -> u64 {
        self.reads.words_read()
    }
}

impl<T: Trace> Traced<T> {
    /// # Errors
    /// The trace cannot be read.
    pub fn new(scene: String, octree: Octree, database: &Verified, trace: T) -> Result<Self, TraceError> {
        let layout = database.database().header.layout.clone();
        let reads = reads(&layout, &octree_levels(database), &trace)?;
        Ok(Self { scene, octree, layout, trace, reads })
    }

    /// What memories of all sizes count, fully associative and LRU: the sum of all nodes.
    ///
    /// # Errors
    /// The trace cannot be read.
    pub fn curve(&self, schedule: &Schedule, line_bytes: u32) -> Result<LruCurve, TraceError> {
        let lines = RecordLines::new(&self.layout, line_bytes);
        let mut sum = LruCurve::default();
        curve::by_node(&self.trace, schedule, &lines)?.iter().for_each(|node| sum.add(node));
        Ok(sum)
    }

    /// Counts of all nodes, each with a local memory of its own that replaces by `R`.
    ///
    /// # Errors
    /// The trace cannot be read.
    pub fn totals<R: Replacement>(
        &self,
        schedule: &Schedule,
        geometry: Geometry,
        seed: u64,
    ) -> Result<Totals, TraceError> {
        let lines = RecordLines::new(&self.layout, geometry.line_bytes);
        let mut sum = Sum::new(&self.trace);
        for tiles in schedule.nodes.iter().flatten() {
            let mut replayer = Replayer::<R, _>::new(&lines, geometry, seed);
            for &tile in tiles {
                replayer.tile(&self.trace, tile, &mut sum)?;
            }
        }
        Ok(sum.finish())
    }

    /// The accepted tiles, row by row from the top.
    pub fn scanline(&self) -> Vec<u32> {
        let tiles = self.trace.tiles();
        let mut order: Vec<u32> = (0..tiles.len() as u32).filter(|&i| tiles[i as usize].accepted).collect();
        order.sort_by_key(|&i| tiles[i as usize].tile);
        order
    }
}

/// Every read as a memory would count it in which nothing is missing.
fn reads(layout: &Layout, levels: &[u8], trace: &impl Trace) -> Result<MemoryStats, TraceError> {
    let mut detail = Detail::new(trace, Classes::new(layout, levels));
    let mut words = Vec::new();
    for (i, tile) in (0..).zip(trace.tiles()) {
        detail.tile(i);
        for part in tile.parts.clone() {
            trace.read(part, &mut words)?;
            for event in words.iter().filter_map(|&word| Word(word).decode()) {
                match event {
                    Event::Ray(kind) => detail.ray(kind),
                    Event::Read(record) => detail.read(record, 0, 0),
                }
            }
        }
    }
    Ok(detail.stats)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::database::Section;
    use crate::machine::replacement::Lru;
    use crate::machine::stats::{CLASSES, Counters, octree_class};
    use crate::study::{levels, sample};
    use crate::topology::{LocalMemory, MemorySize, Replacement as Policy};

    #[test]
    fn what_was_read_is_what_the_tracer_counted() {
        let (prepared, traced) = sample::gears();
        let stats = levels::trace(&prepared.database, &prepared.view, sample::TILING, traced.octree.mailbox);
        for (level, &accesses) in (0..).zip(&stats.octree_accesses) {
            let read = |kind: &[Counters; CLASSES]| kind[octree_class(level)].record_accesses;
            assert_eq!(traced.reads.counters.iter().map(read).sum::<u64>(), accesses, "level {level}");
        }
        let tests = [Section::Triangles, Section::Spheres, Section::Cones];
        let tests: u64 = tests.map(|section| traced.reads.section(section).record_accesses).iter().sum();
        assert_eq!(tests, stats.primitive_tests);
    }

    #[test]
    fn a_memory_of_the_whole_database_misses_each_line_once_a_node() {
        let (_, traced) = sample::gears();
        let memory = LocalMemory {
            size: MemorySize::Share { numerator: 1, denominator: 1 },
            line: 64,
            ways: None,
            replacement: Policy::Lru,
        };
        let geometry = Geometry::new(&memory, &traced.layout).expect("fits");
        let order = traced.scanline();
        let misses = |nodes| {
            let schedule = Schedule::interleaved(&order, nodes);
            let totals = traced.totals::<Lru>(&schedule, geometry, 0).expect("in memory");
            assert_eq!(traced.curve(&schedule, 64).expect("in memory").at(geometry.lines()), totals);
            totals.line_misses
        };
        let (one, three) = (misses(1), misses(3));
        assert!(one <= u64::from(geometry.image_lines), "{one}");
        assert!(one < three && three <= 3 * one, "{one} {three}");
    }
}
