//! A scene that was traced, to be put through any cluster.

use std::io;

use crate::study::runs::kept::Kept;
use machine::hardware::references::{Event, RecordNumbers, ReferenceWord};
use machine::hardware::specification::{Bus, Processor};
use machine::hardware::stats::MemoryStats;
use machine::recording::references::octree_levels;
use machine::replay::model::curve::{self, LruCurve};
use machine::replay::model::detail::{Classes, Detail};
use machine::replay::plan::schedule::TileSchedule;
use machine::replay::stream::subject::{DatabaseTrace, TraceSource};
use machine::replay::{RecordLines, Tally, Trace, TraceError, TracedTile, parallel};
use trace::database::Layout;
use trace::picture::Tiling;
use trace::preparation::Prepared;
use trace::tracer::RayKind;
use trace::tracer::octree::Octree;

/// References, and the database that they are of.
#[derive(Clone, Debug)]
pub struct Traced<T> {
    pub run: Run,
    pub layout: Layout,
    numbers: RecordNumbers,
    pub trace: T,
    /// All that was read, by ray kind, section and level. Nothing missed.
    pub reads: MemoryStats,
    /// By [`RayKind`].
    pub rays: [u64; RayKind::COUNT],
}

/// What a topology says of a run, besides its cluster's size.
#[derive(Clone, Debug)]
pub struct Run {
    /// As a topology names it.
    pub scene: String,
    pub octree: Octree,
    pub tiling: Tiling,
    pub seed: u64,
    pub processor: Processor,
    pub bus: Bus,
}

#[derive(Debug, thiserror::Error)]
pub enum TracedError {
    #[error("references cannot be kept: {0}")]
    Kept(#[from] io::Error),
    #[error(transparent)]
    Trace(#[from] TraceError),
}

impl Traced<Kept> {
    /// Traces the scene on all processors.
    ///
    /// # Errors
    /// There is no room for temporary files.
    pub fn new(run: Run, prepared: &Prepared) -> Result<Self, TracedError> {
        let kept = Kept::capture(&prepared.database, &prepared.view, run.tiling, run.octree.mailbox)?;
        Ok(Self::of(run, prepared, kept)?)
    }
}

impl<T: Trace> Traced<T> {
    /// # Errors
    /// The trace cannot be read.
    pub fn of(run: Run, prepared: &Prepared, trace: T) -> Result<Self, TraceError> {
        let layout = prepared.database.database().header.layout.clone();
        let numbers = RecordNumbers::new(&layout);
        let (reads, rays) = reads(&layout, &octree_levels(&prepared.database), &trace)?;
        Ok(Self { run, layout, numbers, trace, reads, rays })
    }

    /// What memories of all sizes count, fully associative and LRU: the sum of all nodes.
    ///
    /// # Errors
    /// The trace cannot be read.
    pub fn curve(&self, schedule: &TileSchedule, line_bytes: u32) -> Result<LruCurve, TraceError> {
        let lines = RecordLines::new(&self.layout, line_bytes);
        let mut sum = LruCurve::default();
        curve::by_node(&self.trace, schedule, &lines)?.iter().for_each(|node| sum.add(node));
        Ok(sum)
    }
}

impl<T: Trace> Trace for Traced<T> {
    fn tiles(&self) -> &[TracedTile] {
        self.trace.tiles()
    }

    fn read(&self, part: u32, words: &mut Vec<u32>) -> Result<(), TraceError> {
        self.trace.read(part, words)
    }
}

impl<T: Trace> DatabaseTrace for Traced<T> {
    #[inline(always)]
    fn source(&self) -> TraceSource<'_> {
        let Self { layout, numbers, run: Run { tiling, seed, .. }, .. } = self;
        TraceSource { layout, numbers, tiling: *tiling, seed: *seed }
    }
}

/// Every read as a memory would count it in which nothing is missing, and every ray.
fn reads(
    layout: &Layout,
    levels: &[u8],
    trace: &impl Trace,
) -> Result<(MemoryStats, [u64; RayKind::COUNT]), TraceError> {
    let tiles: Vec<u32> = (0..trace.tiles().len() as u32).collect();
    let chunks: Vec<&[u32]> = tiles.chunks(64).collect();
    let counted = parallel::map(&chunks, |tiles| {
        let mut detail = Detail::new(trace, Classes::new(layout, levels));
        let (mut rays, mut words) = ([0; RayKind::COUNT], Vec::new());
        for &tile in *tiles {
            detail.tile(tile);
            for part in trace.tiles()[tile as usize].parts.clone() {
                trace.read(part, &mut words)?;
                for event in words.iter().filter_map(|&word| ReferenceWord(word).decode()) {
                    match event {
                        Event::Ray(kind) => {
                            rays[kind as usize] += 1;
                            detail.ray(kind);
                        }
                        Event::Read(record) => detail.read(record, 0, 0),
                        // What tracers never do.
                        _ => {}
                    }
                }
            }
        }
        Ok::<_, TraceError>((detail.stats, rays))
    });
    let mut sum = (MemoryStats::default(), [0; RayKind::COUNT]);
    for counted in counted {
        let (stats, rays) = counted?;
        sum.0.add(&stats);
        sum.1.iter_mut().zip(rays).for_each(|(sum, rays)| *sum += rays);
    }
    Ok(sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::figures::levels;
    use crate::study::runs::fixture;
    use machine::hardware::specification::MemorySize;
    use machine::hardware::stats::{CLASSES, Counters, octree_class};
    use machine::replay::model::evaluation::{Evaluation, evaluate};
    use machine::replay::stream::subject::Subject;
    use machine::tile_order::TileOrder;
    use trace::database::Section;

    #[test]
    fn what_was_read_is_what_the_tracer_counted() {
        let (prepared, traced) = fixture::gears();
        let stats = levels::trace(&prepared.database, &prepared.view, fixture::TILING, traced.run.octree.mailbox);
        for (level, &accesses) in (0..).zip(&stats.octree_accesses) {
            let read = |kind: &[Counters; CLASSES]| kind[octree_class(level)].record_accesses;
            assert_eq!(traced.reads.counters.iter().map(read).sum::<u64>(), accesses, "level {level}");
        }
        let tests = [Section::Triangles, Section::Spheres, Section::Cones];
        let tests: u64 = tests.map(|section| traced.reads.section(section).record_accesses).iter().sum();
        assert_eq!((tests, traced.rays), (stats.primitive_tests, stats.rays));
    }

    #[test]
    fn a_memory_of_the_whole_database_misses_each_line_once_a_node_and_the_curve_says_so() {
        let (_, traced) = fixture::gears();
        let misses = |nodes| {
            let local_memory = MemorySize::Share { numerator: 1, denominator: 1 };
            let setting = machine::replay::plan::setting::Setting { local_memory, ..fixture::setting(nodes) };
            let rows = evaluate(&traced, &[setting], &Evaluation::default(), |_| {}).expect("in memory");
            assert_eq!(rows[0].counts.words_read, traced.reads.words_read(&traced.layout));
            let schedule = TileSchedule::interleaved(&traced.ordered(TileOrder::Scanline), u32::from(nodes));
            let curve = traced.curve(&schedule, setting.line).expect("in memory");
            assert_eq!(
                curve.at((rows[0].memory.local_bytes / u64::from(setting.line)) as u32).record_misses,
                rows[0].counts.misses
            );
            rows[0].counts.line_misses
        };
        let (one, three) = (misses(1), misses(3));
        assert!(one <= traced.layout.database_bytes() / u64::from(fixture::setting(1).line), "{one}");
        assert!(one < three && three <= 3 * one, "{one} {three}");
    }
}
