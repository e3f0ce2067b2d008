//! Settings → what would have been counted, each simulated, all of them in parallel.

use serde::Serialize;

use crate::hardware::local_memory::{Geometry, MemoryShape};
use crate::hardware::references::ReferenceWord;
use crate::replay::contention::timing::{Timing, simulate_setting};
use crate::replay::model::counts::{Counts, ratio};
use crate::replay::model::curve::{LruCurve, curve};
use crate::replay::model::miss_classes::{MissClasses, classify};
use crate::replay::model::node::replay_node;
use crate::replay::model::optimal::optimal;
use crate::replay::model::replayer::{Counters, Sum};
use crate::replay::model::writes::{WriteColumns, WriteCounts, Writing, count_writes};
use crate::replay::plan::schedule::{TileSchedule, TileSchedules};
use crate::replay::plan::setting::{Assignment, Policy, Setting};
use crate::replay::stream::subject::Subject;
use crate::replay::{TraceError, parallel};
use crate::tile_order::TileOrder;

/// A row of a replay's table.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub struct Row {
    #[serde(flatten)]
    pub setting: Setting,
    #[serde(flatten)]
    pub memory: MemoryShape,
    #[serde(flatten)]
    pub counts: Counts,
    /// `None` for a trace that has nothing but reads.
    #[serde(flatten)]
    pub writes: Option<WriteColumns>,
    pub misses_per_record_access: f64,
    pub words_moved_per_word_read: f64,
    /// The misses, divided; `None` where that was not asked for, or the assignment is not known beforehand.
    pub compulsory_misses: Option<u64>,
    pub capacity_misses: Option<u64>,
    pub conflict_misses: Option<i64>,
    /// In simulated cycles; `None` where the bus was not simulated.
    pub cycles: Option<u64>,
    pub efficiency: Option<f64>,
    pub bus_utilisation: Option<f64>,
    pub wait_mean: Option<f64>,
    pub wait_percentile_99: Option<u64>,
    /// Whether the counts are those that a live run would make.
    pub exact: bool,
    /// Why they are not.
    pub reason: Option<String>,
}

/// Why an interrupted run predicts no other one.
const TILES_MISSING: &str = "the recorded run ended before all tiles were traced: those that are missing count nowhere";

/// What is to be simulated.
#[derive(Clone, Debug, Default)]
pub struct Evaluation {
    /// Nodes sharing their buses, in cycles. On-demand assignment is simulated so whether or not.
    pub timings: bool,
    /// Whether misses are divided into compulsory, capacity and conflict misses.
    pub classes: bool,
    /// Why nothing is exact.
    pub damage: Option<String>,
    /// How memories write: of traces that came from elsewhere.
    pub writing: Writing,
}

/// A part of the work.
#[derive(Clone, Copy)]
enum Job {
    /// One node of a setting.
    Count(usize, usize),
    /// All nodes of a setting, and their buses.
    Time(usize),
}

struct Done {
    setting: usize,
    totals: Counters,
    writes: Option<WriteCounts>,
    timing: Option<Timing>,
}

/// Simulates settings; the rows are in their order. `tick` is called with every part of the work that is done, and how
/// many parts there are.
///
/// # Errors
/// A setting's memory cannot be made for this image, or the trace not be read.
pub fn evaluate<S: Subject>(
    subject: &S,
    settings: &[Setting],
    evaluation: &Evaluation,
    tick: impl Fn(usize) + Sync,
) -> Result<Vec<Row>, TraceError> {
    let mut geometries = Vec::new();
    for setting in settings {
        geometries.push(subject.geometry(&setting.memory())?);
    }
    let words_read = words_read(subject)?;
    let is_whole = subject.ordered(TileOrder::Scanline).iter().all(Option::is_some);
    let schedules = TileSchedules::new(subject, settings);
    let mut jobs = Vec::new();
    for (i, setting) in settings.iter().enumerate() {
        if is_timed(setting, evaluation) {
            jobs.push(Job::Time(i));
        } else {
            jobs.extend((0..schedules.of(i).nodes.len()).map(|node| Job::Count(i, node)));
        }
    }
    let done = parallel::map(&jobs, |&job| {
        let done = match job {
            Job::Count(i, node) => {
                let processes = &schedules.of(i).nodes[node];
                let counted = count(subject, processes, settings[i].replacement, geometries[i], evaluation.writing);
                counted.map(|(totals, writes)| Done { setting: i, totals, writes, timing: None })
            }
            Job::Time(i) => {
                let timed = simulate_setting(subject, &settings[i], geometries[i]);
                timed.map(|(timing, totals)| Done { setting: i, totals, writes: None, timing: Some(timing) })
            }
        };
        tick(jobs.len());
        done
    });
    let mut sums = vec![(Counters::default(), None, None); settings.len()];
    for done in done {
        let Done { setting, totals, writes, timing } = done?;
        sums[setting].0.add(&totals);
        (sums[setting].1, sums[setting].2) = (writes, timing);
    }
    let rows = settings.iter().zip(&geometries).zip(sums);
    let row = |((setting, geometry), sum): ((&Setting, &Geometry), _)| {
        Row::new(*setting, *geometry, sum, words_read, is_whole, evaluation)
    };
    let mut rows: Vec<Row> = rows.map(row).collect();
    if subject.with_writes().is_some() {
        rows.iter_mut().for_each(|row| _ = row.writes.get_or_insert_default());
    }
    if evaluation.classes {
        divide_misses(subject, &schedules, &geometries, &mut rows)?;
    }
    Ok(rows)
}

/// Divides the misses of rows whose assignment is known beforehand, with one curve for all of the same references.
fn divide_misses<S: Subject>(
    subject: &S,
    schedules: &TileSchedules,
    geometries: &[Geometry],
    rows: &mut [Row],
) -> Result<(), TraceError> {
    let references = |i: usize, row: &Row| (schedules.index(i), row.setting.line);
    let known = |(_, row): &(usize, &mut Row)| row.setting.assignment != Assignment::OnDemand;
    let mut jobs: Vec<(usize, u32)> = Vec::new();
    for (i, row) in rows.iter_mut().enumerate().filter(known) {
        if !jobs.contains(&references(i, row)) {
            jobs.push(references(i, row));
        }
    }
    let curves = parallel::map(&jobs, |&(schedule, line)| cluster_curve(subject, &schedules.distinct[schedule], line));
    let curves = curves.into_iter().collect::<Result<Vec<_>, _>>()?;
    for (i, row) in rows.iter_mut().enumerate().filter(known) {
        let Some(job) = jobs.iter().position(|job| *job == references(i, row)) else { continue };
        let MissClasses { compulsory, capacity, conflict } =
            classify(&row.counts.counters(), &curves[job], geometries[i].lines()).records;
        (row.compulsory_misses, row.capacity_misses) = (Some(compulsory), Some(capacity));
        row.conflict_misses = Some(conflict);
    }
    Ok(())
}

/// The curve of all nodes together, each with a memory of the same size.
fn cluster_curve<S: Subject>(subject: &S, schedule: &TileSchedule, line_bytes: u32) -> Result<LruCurve, TraceError> {
    let lines = subject.lines(line_bytes);
    let mut sum = LruCurve::default();
    for tiles in schedule.nodes.iter().flatten() {
        sum.add(&curve(subject, tiles, &lines)?);
    }
    Ok(sum)
}

/// Optimal replacement has no times.
fn is_timed(setting: &Setting, evaluation: &Evaluation) -> bool {
    let is_on_demand = setting.assignment == Assignment::OnDemand;
    is_on_demand || (evaluation.timings && setting.replacement != Policy::Optimal)
}

impl Row {
    fn new(
        setting: Setting,
        geometry: Geometry,
        (totals, writes, timing): (Counters, Option<WriteCounts>, Option<Timing>),
        words_read: u64,
        is_whole: bool,
        evaluation: &Evaluation,
    ) -> Self {
        let mut counts = Counts::new(&totals, words_read, geometry.line_bytes);
        if let Some(writes) = writes {
            counts.words_moved = writes.lines_fetched * u64::from(geometry.line_bytes / 4);
        }
        let is_missing = !is_whole && setting.assignment == Assignment::Interleaved;
        let approximate = setting.assignment.is_approximate().or(is_missing.then_some(TILES_MISSING));
        let reason = evaluation.damage.clone().or_else(|| approximate.map(str::to_owned));
        Self {
            setting,
            memory: geometry.into(),
            counts,
            writes: writes.map(|writes| WriteColumns::new(writes, evaluation.writing)),
            misses_per_record_access: ratio(counts.misses, counts.record_accesses),
            words_moved_per_word_read: ratio(counts.words_moved, words_read),
            compulsory_misses: None,
            capacity_misses: None,
            conflict_misses: None,
            cycles: timing.map(|timing| timing.cycles),
            efficiency: timing.map(|timing| timing.efficiency),
            bus_utilisation: timing.map(|timing| timing.bus_utilisation),
            wait_mean: timing.map(|timing| timing.wait_mean),
            wait_percentile_99: timing.map(|timing| timing.wait_percentile_99),
            exact: reason.is_none(),
            reason,
        }
    }
}

fn count<S: Subject>(
    subject: &S,
    processes: &[Vec<u32>],
    policy: Policy,
    geometry: Geometry,
    writing: Writing,
) -> Result<(Counters, Option<WriteCounts>), TraceError> {
    if let (Some(trace), Some(replacement)) = (subject.with_writes(), policy.replacement()) {
        let (totals, writes) = count_writes(trace, geometry, replacement, writing)?;
        return Ok((totals, Some(writes)));
    }
    if policy == Policy::Optimal {
        let lines = subject.lines(geometry.line_bytes);
        let mut totals = Counters::default();
        for tiles in processes {
            optimal(subject, tiles, &lines, &[geometry])?.iter().for_each(|counted| totals.add(counted));
        }
        return Ok((totals, None));
    }
    let mut sum = Sum::new(subject);
    replay_node(subject, processes, policy, geometry, &mut sum)?;
    Ok((sum.finish(), None))
}

/// 32-bit words of all records read or written in accepted tiles.
fn words_read<S: Subject>(subject: &S) -> Result<u64, TraceError> {
    let record_words = subject.record_words();
    let accepted: Vec<_> = subject.tiles().iter().filter(|tile| tile.accepted).collect();
    let counted = parallel::map(&accepted, |tile| {
        let mut words = Vec::new();
        let mut reads = vec![0u64; record_words.len()];
        for part in tile.parts.clone() {
            subject.read(part, &mut words)?;
            let records = words.iter().filter_map(|&word| ReferenceWord(word).record());
            records.for_each(|record| reads[subject.kind(record)] += 1);
        }
        Ok(reads.iter().zip(&record_words).map(|(reads, &words)| reads * u64::from(words)).sum::<u64>())
    });
    counted.into_iter().sum()
}
