//! How many nodes a bus carries: simulation and formula, side by side.

use serde::Serialize;

use crate::hardware::local_memory::{Geometry, MemoryShape};
use crate::replay::contention::timing::{Timing, simulate_clusters};
use crate::replay::contention::{ClosedNetwork, Cycle, Outcome, largest_nodes, saturation_nodes};
use crate::replay::model::counts::ratio;
use crate::replay::model::replayer::Counters;
use crate::replay::plan::setting::{Assignment, Setting};
use crate::replay::stream::subject::Subject;
use crate::replay::{TraceError, parallel};

/// One number of nodes.
#[derive(Clone, Copy, PartialEq, Debug, Serialize)]
pub struct ContentionRow {
    #[serde(flatten)]
    pub setting: Setting,
    #[serde(flatten)]
    pub memory: MemoryShape,
    pub cycles: Cycle,
    /// Cycles of one node over cycles.
    pub speed_up: f64,
    /// Share of compute in compute and stall, of all nodes, and of the node where it is least.
    pub efficiency: f64,
    pub efficiency_least: f64,
    pub bus_utilisation: f64,
    /// Cycles that a transaction waits for the bus.
    pub wait_mean: f64,
    pub wait_percentile_99: Cycle,
    pub misses_per_record_access: f64,
    /// What queueing theory expects of nodes with these means: when all services take the same time, and when they are
    /// exponential.
    pub fixed_wait: f64,
    pub fixed_utilisation: f64,
    pub fixed_efficiency: f64,
    pub exponential_wait: f64,
    pub exponential_utilisation: f64,
    pub exponential_efficiency: f64,
    /// N* = (Z + S) / S of these means.
    pub knee: f64,
    /// The paper's bound: 1 / misses per record access.
    pub saturation: f64,
    /// Whether the counts are those that a live run would make.
    pub exact: bool,
    /// Why they are not.
    pub reason: Option<&'static str>,
}

/// The table, and what it comes to.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub struct ContentionTable {
    pub rows: Vec<ContentionRow>,
    /// The largest number of nodes of the table up to which all are at least 90% efficient: simulated, and by the
    /// formula for services of the same time.
    pub largest_efficient: Option<u16>,
    pub largest_efficient_formula: Option<u16>,
}

/// Simulates settings that differ in their number of nodes, and in the assignment where that depends on it: the clusters of each,
/// one after the other. One node alone is simulated besides, for the speed-up.
///
/// # Errors
/// The memory cannot be made for this image, the trace not be read, or replacement has no times.
pub fn contention_table<S: Subject>(
    subject: &S,
    settings: &[Setting],
    tick: impl Fn(usize) + Sync,
) -> Result<ContentionTable, TraceError> {
    let Some(&first) = settings.first() else {
        return Ok(ContentionTable { rows: Vec::new(), largest_efficient: None, largest_efficient_formula: None });
    };
    let geometry = subject.geometry(&first.memory())?;
    let assignment = if first.assignment == Assignment::OnDemand { first.assignment } else { Assignment::Interleaved };
    let alone = Setting { nodes: 1, clusters: 1, assignment, ..first };
    let settings: Vec<Setting> = std::iter::once(alone).chain(settings.iter().copied()).collect();
    let outcomes = parallel::map(&settings, |setting| {
        let simulated = simulate_clusters(subject, setting, geometry);
        tick(settings.len());
        simulated
    });
    let outcomes = outcomes.into_iter().collect::<Result<Vec<_>, _>>()?;
    let alone = Timing::of(&outcomes[0].0).cycles as f64;
    let rows = settings.iter().zip(&outcomes).skip(1);
    let rows: Vec<ContentionRow> =
        rows.filter_map(|(setting, (outcomes, totals))| row(*setting, geometry, outcomes, totals, alone)).collect();
    let efficient = |reached: fn(&ContentionRow) -> f64| {
        largest_nodes(rows.iter().map(|row| (row.setting.nodes, reached(row))), 0.9)
    };
    Ok(ContentionTable {
        largest_efficient: efficient(|row| row.efficiency),
        largest_efficient_formula: efficient(|row| row.fixed_efficiency),
        rows,
    })
}

/// `None` where nothing crossed the bus.
fn row(
    setting: Setting,
    geometry: Geometry,
    outcomes: &[Outcome],
    totals: &Counters,
    alone: f64,
) -> Option<ContentionRow> {
    let timing = Timing::of(outcomes);
    let network = ClosedNetwork::of_each(outcomes)?;
    let fixed = *network.fixed_service(setting.nodes).last()?;
    let exponential = *network.exponential_service(setting.nodes).last()?;
    let efficiencies = outcomes.iter().flat_map(|outcome| outcome.nodes.iter().map(|node| node.efficiency));
    let misses = ratio(totals.record_misses, totals.record_accesses);
    Some(ContentionRow {
        setting,
        memory: geometry.into(),
        cycles: timing.cycles,
        speed_up: alone / timing.cycles.max(1) as f64,
        efficiency: timing.efficiency,
        efficiency_least: efficiencies.fold(1.0, f64::min),
        bus_utilisation: timing.bus_utilisation,
        wait_mean: timing.wait_mean,
        wait_percentile_99: timing.wait_percentile_99,
        misses_per_record_access: misses,
        fixed_wait: fixed.wait_cycles,
        fixed_utilisation: fixed.utilisation,
        fixed_efficiency: fixed.efficiency,
        exponential_wait: exponential.wait_cycles,
        exponential_utilisation: exponential.utilisation,
        exponential_efficiency: exponential.efficiency,
        knee: network.knee(),
        saturation: saturation_nodes(misses),
        exact: setting.assignment.is_approximate().is_none(),
        reason: setting.assignment.is_approximate(),
    })
}
