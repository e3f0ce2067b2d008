//! Settings → what would have been counted, each simulated, all of them in parallel.

use serde::Serialize;

use super::count::{Replayer, Sum, Totals};
use super::schedule::Schedule;
use super::setting::{Assignment, Policy, Setting};
use super::subject::Subject;
use super::{TraceError, parallel};
use crate::machine::local_memory::Geometry;
use crate::machine::replacement::{Clock, Fifo, Lru, Random, Replacement};

/// A row of a replay's table.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub struct Row {
    #[serde(flatten)]
    pub setting: Setting,
    /// Of one node's local memory.
    pub local_bytes: u64,
    pub record_accesses: u64,
    /// Records with at least one line missing: fetches.
    pub misses: u64,
    pub line_accesses: u64,
    pub line_misses: u64,
    /// 32-bit words.
    pub words_read: u64,
    pub words_moved: u64,
    pub misses_per_record_access: f64,
    pub words_moved_per_word_read: f64,
    pub exact: bool,
    /// Why it is not exact.
    pub reason: Option<String>,
}

/// Simulates settings; the rows are in their order. `tick` is called with every part of the work that is done, and how
/// many parts there are.
///
/// # Errors
/// A setting's memory cannot be made for this image, or the trace not be read.
pub fn evaluate<S: Subject>(
    subject: &S,
    settings: &[Setting],
    damage: Option<&str>,
    tick: impl Fn(usize) + Sync,
) -> Result<Vec<Row>, TraceError> {
    let mut geometries = Vec::new();
    for setting in settings {
        let geometry = Geometry::of_image(&setting.memory(), subject.image_bytes());
        geometries.push(geometry.map_err(|error| TraceError(format!("local memory: {error}")))?);
    }
    let words_read = words_read(subject)?;
    let schedules: Vec<_> = settings.iter().map(|setting| schedule(subject, setting)).collect();
    let jobs = schedules.iter().enumerate().flat_map(|(i, schedule)| (0..schedule.nodes.len()).map(move |n| (i, n)));
    let jobs: Vec<_> = jobs.collect();
    let counted = parallel::map(&jobs, |&(i, node)| {
        let setting = &settings[i];
        let totals = count(subject, &schedules[i].nodes[node], setting.replacement, geometries[i]);
        tick(jobs.len());
        totals
    });
    let mut totals = vec![Totals::default(); settings.len()];
    for (&(i, _), counted) in jobs.iter().zip(counted) {
        totals[i].add(&counted?);
    }
    let row = |((setting, geometry), totals): ((&Setting, &Geometry), &Totals)| {
        Row::new(*setting, *geometry, *totals, words_read, damage)
    };
    Ok(settings.iter().zip(&geometries).zip(&totals).map(row).collect())
}

impl Row {
    fn new(setting: Setting, geometry: Geometry, totals: Totals, words_read: u64, damage: Option<&str>) -> Self {
        let words_moved = totals.line_misses * u64::from(geometry.line_bytes) / 4;
        let ratio = |part: u64, whole: u64| if whole > 0 { part as f64 / whole as f64 } else { 0.0 };
        let reason = damage.map(str::to_owned);
        Self {
            setting,
            local_bytes: geometry.local_bytes(),
            record_accesses: totals.record_accesses,
            misses: totals.record_misses,
            line_accesses: totals.line_accesses,
            line_misses: totals.line_misses,
            words_read,
            words_moved,
            misses_per_record_access: ratio(totals.record_misses, totals.record_accesses),
            words_moved_per_word_read: ratio(words_moved, words_read),
            exact: reason.is_none(),
            reason,
        }
    }
}

/// Who traces what.
pub fn schedule<S: Subject>(subject: &S, setting: &Setting) -> Schedule {
    match setting.assignment {
        Assignment::Recorded => Schedule::recorded(subject, setting.nodes),
        Assignment::Interleaved | Assignment::OnDemand => {
            Schedule::interleaved(&subject.ordered(setting.tile_order), setting.all_nodes())
        }
    }
}

fn count<S: Subject>(
    subject: &S,
    processes: &[Vec<u32>],
    policy: Policy,
    geometry: Geometry,
) -> Result<Totals, TraceError> {
    match policy {
        Policy::Lru => through::<Lru, _>(subject, processes, geometry),
        Policy::Fifo => through::<Fifo, _>(subject, processes, geometry),
        Policy::Clock => through::<Clock, _>(subject, processes, geometry),
        Policy::Random => through::<Random, _>(subject, processes, geometry),
        Policy::Optimal => Err(TraceError("optimal".to_owned())),
    }
}

fn through<R: Replacement, S: Subject>(
    subject: &S,
    processes: &[Vec<u32>],
    geometry: Geometry,
) -> Result<Totals, TraceError> {
    let lines = subject.lines(geometry.line_bytes);
    let mut replayer = Replayer::<R, _>::new(&lines, geometry, subject.seed());
    let mut sum = Sum::new(subject);
    for (epoch, tiles) in processes.iter().enumerate() {
        if epoch > 0 {
            replayer.clear();
        }
        for &tile in tiles {
            replayer.tile(subject, tile, &mut sum)?;
        }
    }
    Ok(sum.finish())
}

/// 32-bit words of all records read in accepted tiles.
fn words_read<S: Subject>(subject: &S) -> Result<u64, TraceError> {
    let sections = subject.record_words();
    let ends: Vec<u32> = sections.iter().map(|(_, records)| records.end).collect();
    let accepted: Vec<_> = subject.tiles().iter().filter(|tile| tile.accepted).collect();
    let counted = parallel::map(&accepted, |tile| {
        let mut words = Vec::new();
        let mut reads = vec![0u64; sections.len()];
        for part in tile.parts.clone() {
            subject.read(part, &mut words)?;
            for &word in words.iter().filter(|&&word| crate::machine::references::Word(word).is_read()) {
                let section = ends.iter().filter(|&&end| word >= end).count();
                reads[section.min(sections.len() - 1)] += 1;
            }
        }
        Ok(reads.iter().zip(&sections).map(|(reads, (words, _))| reads * u64::from(*words)).sum::<u64>())
    });
    counted.into_iter().sum()
}
