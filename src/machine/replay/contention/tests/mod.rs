//! The simulation against closed forms, by hand, and against queueing theory.

mod by_hand;
mod closed_forms;
mod fairness;
mod invariants;
mod theory;

use std::convert::Infallible;

use super::*;
use crate::hardware::specification::{Arbiter, Bus, Processor, Transactions};
use crate::hardware::transaction::Kind;
use ground::ids::NodeId;

fn settings(nodes: u16, bus: Bus) -> ContentionSettings {
    ContentionSettings { nodes, bus }
}

fn fetch(compute_cycles: Cycle, bytes: u32) -> Burst {
    Burst { compute_cycles, transaction: Some(Transaction { kind: Kind::Fetch, bytes }) }
}

/// Each node has `count` bursts, which `burst` makes.
fn repeated(
    nodes: u16,
    count: u64,
    mut burst: impl FnMut(NodeId) -> Burst,
) -> impl FnMut(NodeId, Cycle) -> Result<Option<Burst>, Infallible> {
    let mut left = vec![count; usize::from(nodes)];
    move |node, _| {
        let left = &mut left[usize::from(node.0)];
        let next = (*left > 0).then(|| burst(node));
        *left = left.saturating_sub(1);
        Ok(next)
    }
}

fn play(settings: &ContentionSettings, mut workload: impl Workload<Error = Infallible>) -> Outcome {
    let Ok(outcome) = simulate(settings, &mut workload, &mut ());
    outcome
}

fn play_logged(settings: &ContentionSettings, mut workload: impl Workload<Error = Infallible>) -> (Outcome, Log) {
    let mut log = Log::default();
    let Ok(outcome) = simulate(settings, &mut workload, &mut log);
    (outcome, log)
}

/// All that an observer is told, with its times.
#[derive(Clone, PartialEq, Debug, Default)]
struct Log {
    times: Vec<Cycle>,
    requests: Vec<Request>,
    holds: Vec<(NodeId, Phase, Cycle, Cycle)>,
    released: Vec<(NodeId, Phase, Cycle, Cycle)>,
    /// With their requests.
    completions: Vec<(Request, Cycle)>,
    finished: Vec<(NodeId, Cycle)>,
}

impl Observer for Log {
    fn requested(&mut self, request: &Request) {
        self.times.push(request.requested);
        self.requests.push(*request);
    }

    fn granted(&mut self, request: &Request, hold: Hold) {
        self.times.push(hold.from);
        self.holds.push((request.node, hold.phase, hold.from, hold.until));
    }

    fn released(&mut self, request: &Request, hold: Hold) {
        self.times.push(hold.until);
        self.released.push((request.node, hold.phase, hold.from, hold.until));
    }

    fn completed(&mut self, request: &Request, now: Cycle) {
        self.times.push(now);
        self.completions.push((*request, now));
    }

    fn finished(&mut self, node: NodeId, now: Cycle) {
        self.times.push(now);
        self.finished.push((node, now));
    }
}
