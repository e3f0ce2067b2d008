//! One of the processes that the manager started, and what is said between the two.

use std::fmt;
use std::time::Duration;

use crate::protocol::control::{
    BusCommand, BusReport, DisplayCommand, DisplayReport, MasterCommand, MasterReport, NodeCommand, NodeReport,
};
use crate::protocol::hello::Role;
use ground::ids::{Epoch, NodeId};

/// The role, and which of the processes that held it one after the other.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(in crate::processes) struct ProcessId {
    pub(in crate::processes) role: Role,
    pub(in crate::processes) epoch: Epoch,
}

impl ProcessId {
    #[cfg(test)]
    pub(super) fn first(role: Role) -> Self {
        Self { role, epoch: Epoch(0) }
    }

    pub(in crate::processes) fn node(self) -> Option<NodeId> {
        match self.role {
            Role::Node(node) => Some(node),
            _ => None,
        }
    }

    /// The name of its program.
    pub(super) fn program(self) -> &'static str {
        match self.role {
            Role::Manager => "marti",
            Role::Bus(_) => "marti-bus",
            Role::Master(_) => "marti-master",
            Role::Node(_) => "marti-node",
            Role::Display => "marti-display",
        }
    }

    /// The stem of its log's name; successors go on in the same file.
    pub(super) fn log_stem(self) -> String {
        self.role.to_string().replace(' ', "-")
    }
}

impl fmt::Display for ProcessId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.role, self.epoch.0) {
            (Role::Node(node), 0) => write!(f, "{node}"),
            (Role::Node(node), _) => write!(f, "{node} ({})", self.epoch),
            (role, 0) => write!(f, "the {role}"),
            (role, _) => write!(f, "the {role} ({})", self.epoch),
        }
    }
}

/// What a process reports.
#[derive(Clone, PartialEq, Debug)]
pub(in crate::processes) enum Report {
    Bus(BusReport),
    Master(MasterReport),
    Node(NodeReport),
    Display(DisplayReport),
}

/// Commands to a process.
#[derive(Clone, PartialEq, Debug)]
pub(in crate::processes) enum Command {
    Bus(BusCommand),
    Master(MasterCommand),
    Node(NodeCommand),
    Display(DisplayCommand),
}

/// How far a process has come.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(super) enum Stage {
    Spawned,
    Connected,
    /// A server listens; a node is configured.
    Serving,
    /// A node was handed a tile; the display was asked for the image.
    Working,
    /// It has reported for the last time.
    Finished,
}

/// A process that is not known to be dead.
#[derive(Clone, Debug)]
pub(super) struct Process {
    pub(super) id: ProcessId,
    pub(super) stage: Stage,
    /// When it came to this stage.
    pub(super) since: Duration,
    pub(super) last_sign: Duration,
    /// When its control connection ended.
    pub(super) hung_up: Option<Duration>,
    /// From its start to its connection, where that is not the usual time.
    pub(super) connect_deadline: Option<Duration>,
    /// It has said that it leaves, and nothing failed.
    pub(super) leaving: bool,
    /// Why it was killed, as the rest of a sentence that begins with its name.
    pub(super) killed: Option<String>,
    /// Incidents that it reported.
    pub(super) incidents: u32,
}

impl Process {
    pub(super) fn spawned(id: ProcessId, now: Duration) -> Self {
        Self {
            id,
            stage: Stage::Spawned,
            since: now,
            last_sign: now,
            hung_up: None,
            connect_deadline: None,
            leaving: false,
            killed: None,
            incidents: 0,
        }
    }

    pub(super) fn enter(&mut self, stage: Stage, now: Duration) {
        (self.stage, self.since) = (stage, now);
    }

    pub(super) fn can_be_told(&self) -> bool {
        self.stage >= Stage::Connected && self.hung_up.is_none() && self.killed.is_none()
    }
}
