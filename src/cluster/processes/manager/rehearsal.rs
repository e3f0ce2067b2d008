//! The manager without its shell, as the simulation holds it: a plan that needs no scene, the state, and what can be
//! asked of it.

use std::time::Duration;

use super::cause::Cause;
use super::closing;
use super::event::{Action, Event};
use super::fixture;
use super::state::State;
use crate::report::conservation::Conservation;
use crate::report::{Bus, Incident, Node};
use crate::topology::Run;
use ground::ids::{Attempt, RunId, TileId};
use machine::hardware::specification::{Cluster, MemorySize};
use trace::database::Header;
use trace::picture::Tiling;
use trace::tracer::View;

/// The run that is rehearsed.
pub(in crate::processes) const RUN: RunId = fixture::RUN;

/// What is rehearsed.
#[derive(Clone, Debug)]
pub(in crate::processes) struct Play {
    pub(in crate::processes) clusters: u16,
    /// Of each cluster.
    pub(in crate::processes) nodes: u16,
    pub(in crate::processes) tiles: u32,
    pub(in crate::processes) memory: MemorySize,
    pub(in crate::processes) run: Run,
}

#[derive(Debug)]
pub(in crate::processes) struct Rehearsal {
    state: State,
}

/// How a rehearsal ended.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum End {
    Complete,
    /// No node is left.
    TilesMissing,
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
    pub(in crate::processes) processes: usize,
}

impl Rehearsal {
    /// Of this image of a database with this header, in as many tiles as the play says.
    pub(in crate::processes) fn start(play: &Play, header: &Header, view: View, tiling: Tiling) -> (Self, Vec<Action>) {
        let mut plan = fixture::plan(play.nodes, play.tiles);
        plan.cluster = Cluster { count: play.clusters, nodes: play.nodes, ..plan.cluster };
        plan.cluster.local_memory.size = play.memory;
        plan.run = play.run;
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

    /// How each tile stands that is not done.
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
            wanted: self.state.clusters.iter().fold(0, |sum, cluster| sum.saturating_add(cluster.wanted)),
            processes: self.state.supervision.table.iter().count(),
        }
    }

    /// Once it is over.
    pub(in crate::processes) fn end(&self) -> Option<End> {
        Some(match self.state.over()? {
            Cause::Complete => End::Complete,
            Cause::NoNodes => End::TilesMissing,
            Cause::Failed(why) => End::Failed(why.clone()),
            Cause::Interrupted(signal) => End::Failed(signal.to_string()),
        })
    }

    pub(in crate::processes) fn incidents(&self) -> Vec<Incident> {
        self.state.supervision.incidents.all()
    }

    /// What each node did and counted.
    pub(in crate::processes) fn nodes(&self) -> Vec<Node> {
        closing::nodes(&self.state, self.state.supervision.plan.cluster.local_memory.line)
    }

    /// `None` when no bus lived to tell.
    pub(in crate::processes) fn bus(&self) -> Option<Bus> {
        closing::bus(&self.state)
    }

    /// `None` when no server lived to close its books.
    pub(in crate::processes) fn conservation(&self) -> Option<Conservation> {
        closing::books(&self.state)
    }
}
