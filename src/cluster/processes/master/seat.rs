//! The place of one processing node at the master's table.

use std::fmt;
use std::time::Duration;

use ground::ids::{Attempt, Epoch, NodeId, TileId};

/// One process of those that hold a node's place one after the other.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(in crate::processes) struct NodeProcess {
    pub(in crate::processes) node: NodeId,
    pub(in crate::processes) epoch: Epoch,
}

impl fmt::Display for NodeProcess {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({})", self.node, self.epoch)
    }
}

#[derive(Debug, Default)]
pub(super) struct Seat {
    /// Of the process that sits or sat here last.
    pub(super) epoch: Option<Epoch>,
    /// This process and its predecessors are dead, whatever of theirs is still under way.
    pub(super) dead: Option<Epoch>,
    /// At most [`jobs_per_node`](crate::protocol::work::jobs_per_node).
    pub(super) held: Vec<Held>,
    /// Whether the manager knows that it is at work.
    pub(super) announced: bool,
    pub(super) told_late: bool,
    /// Since when it holds nothing and asks for nothing, though a tile waits for it.
    pub(super) idle_since: Option<Duration>,
    /// Nobody will sit here any more.
    pub(super) set_aside: bool,
}

/// An attempt that is out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Held {
    pub(super) tile: TileId,
    pub(super) attempt: Attempt,
    pub(super) since: Duration,
}

impl Seat {
    pub(super) fn taken_by(epoch: Epoch) -> Self {
        Self { epoch: Some(epoch), ..Self::default() }
    }

    pub(super) fn is_dead(&self, epoch: Epoch) -> bool {
        self.dead.is_some_and(|dead| epoch <= dead)
    }

    pub(super) fn holds(&self, tile: TileId) -> bool {
        self.held.iter().any(|held| held.tile == tile)
    }

    /// Whether the attempt was held here.
    pub(super) fn give_back(&mut self, tile: TileId, attempt: Attempt) -> bool {
        let place = self.held.iter().position(|held| held.tile == tile && held.attempt == attempt);
        place.map(|place| self.held.remove(place)).is_some()
    }

    /// Whether it has been idle for longer than the deadline, the first time only.
    pub(super) fn is_overdue(&mut self, is_idle: bool, now: Duration, deadline: Duration) -> bool {
        if !is_idle || self.told_late {
            self.idle_since = None;
            return false;
        }
        let since = *self.idle_since.get_or_insert(now);
        self.told_late = now.saturating_sub(since) > deadline;
        self.told_late
    }

    /// A tile held for longer than the deadline, the first time only.
    pub(super) fn late_tile(&mut self, now: Duration, deadline: Duration) -> Option<TileId> {
        if self.told_late {
            return None;
        }
        let late = self.held.iter().find(|held| now.saturating_sub(held.since) > deadline)?;
        self.told_late = true;
        Some(late.tile)
    }
}
