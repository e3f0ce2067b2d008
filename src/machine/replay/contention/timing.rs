//! What a setting costs in cycles: its nodes, sharing their buses.

use std::collections::VecDeque;

use serde::Serialize;

use crate::hardware::local_memory::Geometry;
use crate::hardware::replacement::{Replacement, with_policy};
use crate::replay::TraceError;
use crate::replay::contention::work::{RecordedWork, Step, Tiles};
use crate::replay::contention::{ContentionSettings, Cycle, Observer, Outcome, simulate};
use crate::replay::model::replayer::Counters;
use crate::replay::plan::schedule::schedule;
use crate::replay::plan::setting::{Assignment, Setting};
use crate::replay::stream::subject::Subject;

/// Of all clusters together, in simulated cycles.
#[derive(Clone, Copy, PartialEq, Debug, Serialize)]
pub struct Timing {
    /// Until the last node of any cluster was done.
    pub cycles: Cycle,
    /// Share of compute in compute and stall.
    pub efficiency: f64,
    /// Share of cycles in which a bus was held, the clusters' mean.
    pub bus_utilisation: f64,
    /// Cycles that a transaction waited for the bus.
    pub wait_mean: f64,
    /// 99 of 100 transactions of the worst cluster waited no longer.
    pub wait_percentile_99: Cycle,
}

/// Simulates the buses of a setting, cluster by cluster: its times, and what was counted.
///
/// Under on-demand assignment clusters are dealt tiles one after the other, and within a cluster the node that asks
/// gets the next one.
///
/// # Errors
/// The trace's; optimal replacement, which must know beforehand which node traces what.
pub fn simulate_setting<S: Subject>(
    subject: &S,
    setting: &Setting,
    geometry: Geometry,
) -> Result<(Timing, Counters), TraceError> {
    let (outcomes, totals) = simulate_clusters(subject, setting, geometry)?;
    Ok((Timing::of(&outcomes), totals))
}

/// The buses of a setting, each by itself: their outcomes, and what was counted on all of them.
///
/// # Errors
/// As for [`simulate_setting`].
pub(super) fn simulate_clusters<S: Subject>(
    subject: &S,
    setting: &Setting,
    geometry: Geometry,
) -> Result<(Vec<Outcome>, Counters), TraceError> {
    let mut outcomes = Vec::new();
    let mut totals = Counters::default();
    for cluster in 0..setting.clusters {
        let (outcome, counted) = simulate_cluster(subject, setting, geometry, cluster, &mut (), |_| {})?;
        outcomes.push(outcome);
        totals.add(&counted);
    }
    Ok((outcomes, totals))
}

/// Simulates one cluster's bus; `observer` and `on_step` get every step.
///
/// # Errors
/// As for [`simulate_setting`].
pub fn simulate_cluster<S: Subject>(
    subject: &S,
    setting: &Setting,
    geometry: Geometry,
    cluster: u16,
    observer: &mut impl Observer,
    on_step: impl FnMut(Step),
) -> Result<(Outcome, Counters), TraceError> {
    let Some(replacement) = setting.replacement.replacement() else {
        let what = "optimal replacement has no times: it must know beforehand what a node will read";
        return Err(TraceError(what.to_owned()));
    };
    with_policy!(replacement, R => through::<R, _>(subject, setting, geometry, cluster, observer, on_step))
}

fn through<R: Replacement, S: Subject>(
    subject: &S,
    setting: &Setting,
    geometry: Geometry,
    cluster: u16,
    observer: &mut impl Observer,
    on_step: impl FnMut(Step),
) -> Result<(Outcome, Counters), TraceError> {
    let lines = subject.lines(geometry.line_bytes);
    let (cluster, nodes) = (usize::from(cluster), usize::from(setting.nodes));
    let tiles = match setting.assignment {
        Assignment::OnDemand => {
            let dealt = subject.ordered(setting.tile_order).into_iter();
            let dealt = dealt.skip(cluster).step_by(usize::from(setting.clusters));
            Tiles::Shared(dealt.flatten().collect::<VecDeque<_>>())
        }
        Assignment::Recorded | Assignment::Interleaved => {
            let all = schedule(subject, setting).nodes;
            Tiles::Assigned(all.into_iter().skip(cluster * nodes).take(nodes).collect())
        }
    };
    let mut work = RecordedWork::<S, R, _>::new(subject, &lines, geometry, tiles, setting, on_step)?;
    let settings = ContentionSettings { nodes: setting.nodes, bus: setting.bus };
    let outcome = simulate(&settings, &mut work, observer)?;
    Ok((outcome, work.totals()))
}

impl Timing {
    pub(super) fn of(outcomes: &[Outcome]) -> Self {
        let sum = |part: fn(&Outcome) -> f64| outcomes.iter().map(part).sum::<f64>();
        let share = |part: f64, whole: f64| if whole > 0.0 { part / whole } else { 0.0 };
        let compute = sum(|outcome| outcome.compute_cycles as f64);
        let transactions = sum(|outcome| outcome.transactions as f64);
        Self {
            cycles: outcomes.iter().map(|outcome| outcome.cycles).max().unwrap_or(0),
            efficiency: share(compute, compute + sum(|outcome| outcome.stall_cycles as f64)),
            bus_utilisation: share(sum(|outcome| outcome.utilisation), outcomes.len() as f64),
            wait_mean: share(sum(|outcome| outcome.wait_mean_cycles * outcome.transactions as f64), transactions),
            wait_percentile_99: outcomes.iter().map(|outcome| outcome.wait_percentile_99_cycles).max().unwrap_or(0),
        }
    }
}
