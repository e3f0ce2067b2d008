//! The simulation itself: nodes that compute and wait, a bus that one of them has at a time.
//!
//! A node has one thing under way at most, and so one event at most that is to come. When all events of a cycle have
//! happened and the bus is free, it is granted to whom the arbiter says among those that wait, be it for an address or
//! for data that the memory has found. Who began to wait in the same cycle counts in the order of nodes.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::outcome::efficiency;
use super::waits::Waits;
use super::{
    Burst, ContentionSettings, Cycle, Hold, NodeOutcome, Observer, Outcome, Phase, Request, Service, Transaction,
    Workload,
};
use crate::hardware::arbiter::{self, Arbiter, Waiting};
use crate::hardware::transaction::{Initiator, Kind};
use ground::ids::NodeId;

/// Plays a workload to its end.
///
/// # Errors
/// The workload's.
pub fn simulate<W: Workload>(
    settings: &ContentionSettings,
    workload: &mut W,
    observer: &mut impl Observer,
) -> Result<Outcome, W::Error> {
    let mut simulation = Simulation::new(settings, workload, observer);
    while let Some(Reverse((now, node))) = simulation.events.pop() {
        simulation.advance(node, now)?;
        if simulation.events.peek().is_none_or(|Reverse((next, _))| *next > now) {
            simulation.arbitrate(now);
        }
    }
    Ok(simulation.outcome())
}

/// What a node's next event ends.
#[derive(Clone, Copy)]
enum Stage {
    /// And what it asks for then.
    Computing(Option<Transaction>),
    /// On the bus.
    Holding(Request, Hold),
    /// In the memory, after the address was sent.
    Looking(Request),
    /// For the bus: no event is to come before it is granted.
    Waiting(Request, Phase),
    Finished,
}

struct Node {
    stage: Stage,
    outcome: NodeOutcome,
    finished: Cycle,
}

struct Simulation<'a, W, O> {
    service: Service,
    arbiter: Box<dyn Arbiter>,
    workload: &'a mut W,
    observer: &'a mut O,
    /// When which node's stage ends.
    events: BinaryHeap<Reverse<(Cycle, u16)>>,
    nodes: Vec<Node>,
    /// Who waits for the bus, in ascending order.
    waiting: Vec<Waiting>,
    /// From when on the bus is free.
    free: Cycle,
    busy: Cycle,
    fetched_bytes: u64,
    message_bytes: u64,
    waits: Waits,
}

impl<'a, W: Workload, O: Observer> Simulation<'a, W, O> {
    fn new(settings: &ContentionSettings, workload: &'a mut W, observer: &'a mut O) -> Self {
        let node = |node| {
            let outcome = NodeOutcome {
                node: NodeId(node),
                compute_cycles: 0,
                stall_cycles: 0,
                idle_cycles: 0,
                efficiency: 1.0,
                transactions: 0,
                bytes: 0,
            };
            Node { stage: Stage::Computing(None), outcome, finished: 0 }
        };
        Self {
            service: Service::new(&settings.bus),
            arbiter: arbiter::new(settings.bus.arbiter),
            workload,
            observer,
            events: (0..settings.nodes).map(|node| Reverse((0, node))).collect(),
            nodes: (0..settings.nodes).map(node).collect(),
            waiting: Vec::new(),
            free: 0,
            busy: 0,
            fetched_bytes: 0,
            message_bytes: 0,
            waits: Waits::default(),
        }
    }

    /// A node's stage ends.
    fn advance(&mut self, node: u16, now: Cycle) -> Result<(), W::Error> {
        match self.nodes[usize::from(node)].stage {
            Stage::Computing(None) => self.next_burst(node, now)?,
            Stage::Computing(Some(Transaction { kind, bytes })) => {
                let request = Request { node: NodeId(node), kind, bytes, requested: now };
                self.observer.requested(&request);
                let phase = if self.service.is_split() { Phase::Address } else { Phase::Whole };
                self.wait(request, phase, now);
            }
            Stage::Holding(request, hold) => {
                self.observer.released(&request, hold);
                if hold.phase == Phase::Address {
                    self.enter_until(node, Stage::Looking(request), now + self.service.latency_cycles());
                } else {
                    self.complete(&request, now);
                    self.next_burst(node, now)?;
                }
            }
            Stage::Looking(request) => self.wait(request, Phase::Data, now),
            Stage::Waiting(..) | Stage::Finished => {}
        }
        Ok(())
    }

    fn next_burst(&mut self, node: u16, now: Cycle) -> Result<(), W::Error> {
        match self.workload.next(NodeId(node), now)? {
            Some(Burst { compute_cycles, transaction }) => {
                self.nodes[usize::from(node)].outcome.compute_cycles += compute_cycles;
                self.enter_until(node, Stage::Computing(transaction), now + compute_cycles);
            }
            None => {
                self.enter(node, Stage::Finished);
                self.nodes[usize::from(node)].finished = now;
                self.observer.finished(NodeId(node), now);
            }
        }
        Ok(())
    }

    fn wait(&mut self, request: Request, phase: Phase, now: Cycle) {
        self.enter(request.node.0, Stage::Waiting(request, phase));
        let waiting = Waiting { initiator: Initiator::Node(request.node), arrival: now };
        let place = self.waiting.partition_point(|other| other.initiator < waiting.initiator);
        self.waiting.insert(place, waiting);
    }

    fn complete(&mut self, request: &Request, now: Cycle) {
        self.observer.completed(request, now);
        let stall = now - request.requested;
        self.waits.add(stall - self.service.unloaded_cycles(request.bytes));
        let bytes = u64::from(request.bytes);
        if request.kind == Kind::Fetch {
            self.fetched_bytes += bytes;
        } else {
            self.message_bytes += bytes;
        }
        let outcome = &mut self.nodes[usize::from(request.node.0)].outcome;
        outcome.stall_cycles += stall;
        outcome.transactions += 1;
        outcome.bytes += bytes;
    }

    /// Grants the bus if it is free and somebody waits for it.
    fn arbitrate(&mut self, now: Cycle) {
        if self.free > now {
            return;
        }
        let Some(node) = self.granted() else { return };
        let Stage::Waiting(request, phase) = self.nodes[usize::from(node)].stage else { return };
        let cycles = match phase {
            Phase::Whole => self.service.unloaded_cycles(request.bytes),
            Phase::Address => self.service.address_cycles(),
            Phase::Data => self.service.data_cycles(request.bytes),
        };
        let hold = Hold { phase, from: now, until: now + cycles };
        self.observer.granted(&request, hold);
        self.free = hold.until;
        self.busy += cycles;
        self.enter_until(node, Stage::Holding(request, hold), hold.until);
    }

    /// Whom the arbiter says; it waits no more.
    fn granted(&mut self) -> Option<u16> {
        let granted = self.arbiter.grant(&self.waiting)?;
        let place = self.waiting.binary_search_by_key(&granted, |waiting| waiting.initiator).ok()?;
        self.waiting.remove(place);
        match granted {
            Initiator::Node(NodeId(node)) => Some(node),
            Initiator::Loader | Initiator::Master => None,
        }
    }

    fn enter(&mut self, node: u16, stage: Stage) {
        self.nodes[usize::from(node)].stage = stage;
    }

    fn enter_until(&mut self, node: u16, stage: Stage, until: Cycle) {
        self.enter(node, stage);
        self.events.push(Reverse((until, node)));
    }

    fn outcome(self) -> Outcome {
        let cycles = self.nodes.iter().map(|node| node.finished).max().unwrap_or(0);
        let finish = |Node { outcome, finished, .. }| NodeOutcome {
            idle_cycles: cycles - finished,
            efficiency: efficiency(outcome.compute_cycles, outcome.stall_cycles),
            ..outcome
        };
        let nodes: Vec<NodeOutcome> = self.nodes.into_iter().map(finish).collect();
        let sum = |of: fn(&NodeOutcome) -> u64| nodes.iter().map(of).sum::<u64>();
        let compute_cycles = sum(|node| node.compute_cycles);
        let stall_cycles = sum(|node| node.stall_cycles);
        Outcome {
            cycles,
            compute_cycles,
            stall_cycles,
            idle_cycles: sum(|node| node.idle_cycles),
            efficiency: efficiency(compute_cycles, stall_cycles),
            transactions: sum(|node| node.transactions),
            fetched_bytes: self.fetched_bytes,
            message_bytes: self.message_bytes,
            bus_busy_cycles: self.busy,
            utilisation: if cycles == 0 { 0.0 } else { self.busy as f64 / cycles as f64 },
            wait_mean_cycles: self.waits.mean(),
            wait_percentile_99_cycles: self.waits.percentile(99),
            wait_max_cycles: self.waits.max(),
            nodes,
        }
    }
}
