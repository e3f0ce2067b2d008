//! The manager without its shell, as the simulation holds it: a plan that needs no scene, the state, and what can be
//! asked of it.

use std::time::Duration;

use super::cause::Cause;
pub(in crate::processes) use super::cause::Interrupt;
use super::closing;
use super::event::{Action, Event};
use super::fixture;
use super::state::State;
use crate::protocol::mac::MacKey;
use crate::report::conservation::Conservation;
use crate::report::{Bus, Incident, Node};
use crate::topology::Run;
use ground::ids::{Attempt, Producer, RunId, TileId};
use machine::hardware::specification::{Cluster, MemorySize};
use machine::hardware::stats::MemoryStats;
use trace::database::Header;
use trace::picture::Tiling;
use trace::tracer::{TraceStats, View};

/// The run that is simulated; one that resumes it has another number.
pub(in crate::processes) const RUN: RunId = fixture::RUN;
/// How the failure begins of a run whose counts do not agree.
pub(in crate::processes) const BOOKS: &str = "the counts do not agree";

/// What is simulated.
#[derive(Clone, Debug)]
pub(in crate::processes) struct Scenario {
    pub(in crate::processes) clusters: u16,
    /// Of each cluster.
    pub(in crate::processes) nodes: u16,
    pub(in crate::processes) tiles: u32,
    pub(in crate::processes) memory: MemorySize,
    pub(in crate::processes) run: Run,
}

/// For permits and receipts of a run.
pub(in crate::processes) const fn key(run: RunId) -> MacKey {
    MacKey::new([run.0 as u8; 32])
}

#[derive(Debug)]
pub(in crate::processes) struct SimulatedManager {
    state: State,
}

/// How a simulated run ended.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum End {
    Complete,
    /// No node is left.
    TilesMissing,
    /// By a signal.
    Interrupted,
    Failed(String),
}

/// What waits somewhere for something.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::processes) struct Queues {
    /// Attempts that masters have.
    pub(in crate::processes) out: usize,
    /// Tiles that wait to be compared.
    pub(in crate::processes) checks: usize,
    /// What masters have asked for and did not get.
    pub(in crate::processes) wanted: u32,
    /// The most of one cluster: attempts that its master has, and what it asked for and did not get.
    pub(in crate::processes) of_cluster: u32,
    pub(in crate::processes) processes: usize,
    /// Tiles whose comparison is awaited, and most results of one of them.
    pub(in crate::processes) compared: (usize, usize),
    pub(in crate::processes) incidents: usize,
}

impl SimulatedManager {
    /// Of this image of a database with this header, in as many tiles as the scenario says.
    pub(in crate::processes) fn start(
        scenario: &Scenario,
        run: RunId,
        header: &Header,
        (view, tiling): (View, Tiling),
    ) -> (Self, Vec<Action>) {
        let mut plan = fixture::plan(scenario.nodes, scenario.tiles);
        plan.cluster = Cluster { count: scenario.clusters, nodes: scenario.nodes, ..plan.cluster };
        plan.cluster.local_memory.size = scenario.memory;
        plan.run = scenario.run;
        (plan.id, plan.key, plan.resume) = (run, key(run), run != RUN);
        (plan.header, plan.view, plan.tiling) = (header.clone(), view, tiling);
        let (state, actions) = State::start(plan);
        (Self { state }, actions)
    }

    pub(in crate::processes) fn handle(&mut self, now: Duration, event: Event) -> Vec<Action> {
        let mut actions = self.state.handle(now, event);
        if actions.contains(&Action::Begin) {
            actions.extend(self.state.handle(now, Event::Begun(Ok(()))));
        }
        actions
    }

    /// When [`Event::Tick`] is due; `None`: it is over.
    pub(in crate::processes) fn next_deadline(&self) -> Option<Duration> {
        self.state.next_deadline()
    }

    /// Tiles not done yet.
    pub(in crate::processes) fn missing(&self) -> u32 {
        self.state.tiles.queue.missing()
    }

    /// The attempt at a tile that is part of the image.
    pub(in crate::processes) fn accepted(&self, tile: TileId) -> Option<Attempt> {
        self.state.tiles.queue.accepted(tile)
    }

    /// The state of each tile that is not done.
    pub(in crate::processes) fn describe_missing(&self) -> Vec<String> {
        let queue = &self.state.tiles.queue;
        let missing = (0..queue.total()).map(TileId).filter(|tile| queue.accepted(*tile).is_none());
        let mut missing: Vec<_> = missing.map(|tile| queue.describe(tile)).collect();
        missing.extend(
            self.state.tiles.verification.awaited().map(|(tile, by)| format!("{tile} is to be compared, by {by:?}")),
        );
        missing.push(format!("{:?}", self.state.clusters));
        missing
    }

    /// Attempts at tiles that were done or under way already.
    pub(in crate::processes) fn reissued(&self) -> u64 {
        self.state.tiles.queue.reissued()
    }

    /// Tiles whose two results agreed, and those where they did not.
    pub(in crate::processes) fn compared(&self) -> (u64, u64) {
        (self.state.tiles.verification.verified(), self.state.tiles.verification.disagreements())
    }

    pub(in crate::processes) fn queues(&self) -> Queues {
        Queues {
            out: self.state.tiles.queue.out(),
            checks: self.state.tiles.queue.waiting_checks(),
            of_cluster: {
                let queue = &self.state.tiles.queue;
                let clusters = self.state.clusters.iter();
                clusters
                    .map(|cluster| cluster.wanted.saturating_add(queue.out_of_cluster(cluster.id)))
                    .max()
                    .unwrap_or_default()
            },
            compared: self.state.tiles.verification.sizes(),
            incidents: self.state.supervision.incidents.len(),
            wanted: self.state.clusters.iter().fold(0, |sum, cluster| sum.saturating_add(cluster.wanted)),
            processes: self.state.supervision.table.iter().count(),
        }
    }

    /// Once it is over.
    pub(in crate::processes) fn end(&self) -> Option<End> {
        Some(match self.state.over()? {
            Cause::Complete | Cause::NoNodes if self.imbalance().is_some() => {
                End::Failed(format!("{BOOKS}: {}", self.imbalance().unwrap_or_default()))
            }
            Cause::Complete => End::Complete,
            Cause::NoNodes => End::TilesMissing,
            Cause::Failed(why) => End::Failed(why.clone()),
            Cause::Interrupted(_) => End::Interrupted,
        })
    }

    pub(in crate::processes) fn incidents(&self) -> Vec<Incident> {
        self.state.supervision.incidents.all()
    }

    /// What each node did and counted.
    pub(in crate::processes) fn nodes(&self) -> Vec<Node> {
        closing::nodes(&self.state, self.state.supervision.plan.cluster.local_memory.line)
    }

    /// `None` when no bus reported at the end.
    pub(in crate::processes) fn bus(&self) -> Option<Bus> {
        closing::bus(&self.state)
    }

    fn imbalance(&self) -> Option<String> {
        self.conservation()?.imbalance()
    }

    /// Attempts that are listed as lost, and all that were issued.
    pub(in crate::processes) fn lost_and_issued(&self) -> (u64, u64) {
        let books = self.state.tiles.ledger.books.values();
        let lost = books.map(|book| (book.lost.len() + book.disowned.len()) as u64).sum();
        (lost, self.state.tiles.queue.issued())
    }

    /// Whether the end has not begun.
    pub(in crate::processes) fn is_running(&self) -> bool {
        self.state.ending.is_running()
    }

    pub(in crate::processes) fn condemned(&self) -> impl ExactSizeIterator<Item = Producer> {
        self.state.tiles.verification.condemned()
    }

    /// What each node counted in its accepted tiles.
    pub(in crate::processes) fn accounts(&self) -> Vec<(TraceStats, Option<MemoryStats>)> {
        let nodes = self.state.tiles.ledger.nodes(self.state.supervision.plan.cluster.all_nodes());
        nodes.into_iter().map(|account| (account.trace, account.memory)).collect()
    }

    /// `None` when no server reported its totals.
    pub(in crate::processes) fn conservation(&self) -> Option<Conservation> {
        closing::books(&self.state)
    }
}
