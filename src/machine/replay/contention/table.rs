//! How many nodes a bus carries: simulation and formula, side by side.

use serde::Serialize;

use crate::replay::contention::timing::simulate_cluster;
use crate::replay::contention::{ClosedNetwork, Cycle, Load, largest_nodes, saturation_nodes};
use crate::replay::plan::setting::{Assignment, Setting};
use crate::replay::stream::subject::Subject;
use crate::replay::{TraceError, parallel};

/// One number of nodes.
#[derive(Clone, Copy, PartialEq, Debug, Serialize)]
pub struct ContentionRow {
    pub nodes: u16,
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

/// Simulates numbers of nodes, each a cluster by itself with tiles handed out as `setting` says (interleaved where that
/// says as recorded). One node is simulated besides, for the speed-up.
///
/// # Errors
/// The memory cannot be made for this image, the trace not be read, or replacement has no times.
pub fn contention_table<S: Subject>(
    subject: &S,
    setting: Setting,
    nodes: &[u16],
    tick: impl Fn(usize) + Sync,
) -> Result<ContentionTable, TraceError> {
    let geometry = subject.geometry(&setting.memory())?;
    let assignment = match setting.assignment {
        Assignment::Recorded => Assignment::Interleaved,
        assignment => assignment,
    };
    let numbers: Vec<u16> = std::iter::once(1).chain(nodes.iter().copied()).collect();
    let outcomes = parallel::map(&numbers, |&nodes| {
        let setting = Setting { nodes, clusters: 1, assignment, ..setting };
        let outcome = simulate_cluster(subject, &setting, geometry, 0, &mut (), |_| {});
        tick(numbers.len());
        outcome
    });
    let outcomes = outcomes.into_iter().collect::<Result<Vec<_>, _>>()?;
    let alone = outcomes[0].0.cycles as f64;
    let mut rows = Vec::new();
    for (nodes, (outcome, totals)) in numbers.into_iter().zip(&outcomes).skip(1) {
        let Some(network) = ClosedNetwork::of(outcome) else { continue };
        let last = |loads: Vec<Load>| loads.last().copied();
        let (Some(fixed), Some(exponential)) =
            (last(network.fixed_service(nodes)), last(network.exponential_service(nodes)))
        else {
            continue;
        };
        let misses = totals.record_misses as f64 / totals.record_accesses.max(1) as f64;
        rows.push(ContentionRow {
            nodes,
            cycles: outcome.cycles,
            speed_up: alone / outcome.cycles.max(1) as f64,
            efficiency: outcome.efficiency,
            efficiency_least: outcome.nodes.iter().map(|node| node.efficiency).fold(1.0, f64::min),
            bus_utilisation: outcome.utilisation,
            wait_mean: outcome.wait_mean_cycles,
            wait_percentile_99: outcome.wait_percentile_99_cycles,
            misses_per_record_access: misses,
            fixed_wait: fixed.wait_cycles,
            fixed_utilisation: fixed.utilisation,
            fixed_efficiency: fixed.efficiency,
            exponential_wait: exponential.wait_cycles,
            exponential_utilisation: exponential.utilisation,
            exponential_efficiency: exponential.efficiency,
            knee: network.knee(),
            saturation: saturation_nodes(misses),
        });
    }
    let efficient =
        |reached: fn(&ContentionRow) -> f64| largest_nodes(rows.iter().map(|row| (row.nodes, reached(row))), 0.9);
    Ok(ContentionTable {
        largest_efficient: efficient(|row| row.efficiency),
        largest_efficient_formula: efficient(|row| row.fixed_efficiency),
        rows,
    })
}
