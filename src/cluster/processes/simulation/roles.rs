//! The processes that the manager starts, each a state in a [`Host`].

use super::child::Child;
use super::files::Files;
use super::host::{Host, Worker};
use super::memory::Memory;
use super::network::{Network, Parcel, Timer, Wire};
use super::simulated::Simulated;
use super::stopwatch::Stopwatch;
use super::tracer::Tracer;
use crate::processes::bus::control::Control;
use crate::processes::driver::{Event, Machine};
use crate::processes::manager::process::{Command, Report};
use crate::processes::{display, master, node};
use crate::protocol::control::NodeCommand;
use ground::ids::{Attempt, TileId};

pub(super) enum Process {
    Bus(Box<Host<Control, Memory>>),
    Master(Box<Host<master::state::State, NoTasks>>),
    Node(Box<Host<node::state::State, Tracer>>),
    Display(Box<Host<display::state::State, Files>>),
}

/// The same of whichever host.
macro_rules! of_host {
    ($process:expr, $host:ident => $what:expr) => {
        match $process {
            Process::Bus($host) => $what,
            Process::Master($host) => $what,
            Process::Node($host) => $what,
            Process::Display($host) => $what,
        }
    };
}

impl Process {
    pub(super) fn child(&self) -> &Child {
        of_host!(self, host => &host.child)
    }

    pub(super) fn child_mut(&mut self) -> &mut Child {
        of_host!(self, host => &mut host.child)
    }

    pub(super) fn arrived(&mut self, network: &mut Network, watch: &mut Stopwatch, wire: Wire, parcel: Parcel) {
        of_host!(self, host => host.arrived(network, watch, wire, parcel));
    }

    pub(super) fn timer(&mut self, network: &mut Network, watch: &mut Stopwatch, timer: Timer) {
        of_host!(self, host => host.timer(network, watch, timer));
    }

    pub(super) fn is_hostile(&self) -> bool {
        of_host!(self, host => host.hostile.is_some())
    }

    /// Most messages of it on their way to one client, and to one server.
    pub(super) fn unread_most(&self) -> [usize; 2] {
        of_host!(self, host => host.unread_most)
    }

    /// Whether what comes on a connection is read.
    pub(super) fn reads(&self, wire: Wire) -> bool {
        of_host!(self, host => host.reads(wire))
    }

    /// Attempts whose pixels it made up, finite and under its own permit.
    pub(super) fn plausible(&self) -> impl Iterator<Item = (TileId, Attempt)> {
        let plausible = of_host!(self, host => host.hostile.as_ref().map(|hostile| &hostile.forge.plausible));
        plausible.into_iter().flatten().copied()
    }

    /// SIGTERM, of a node.
    pub(super) fn terminate(&mut self, network: &mut Network, watch: &mut Stopwatch) {
        if let Self::Node(node) = self {
            node.handle(network, watch, Event::Terminate);
        }
    }

    /// What a node renders from now on is wrong.
    pub(super) fn corrupt(&mut self, network: &mut Network, watch: &mut Stopwatch) {
        if let Self::Node(node) = self {
            node.handle(network, watch, Event::Command(NodeCommand::Corrupt));
        }
    }
}

/// For a state that has no tasks.
pub(super) struct NoTasks;

impl<M: Machine<Task = std::convert::Infallible>> Worker<M> for NoTasks {
    fn begin(&mut self, _desk: &mut super::host::Context, task: M::Task) -> Result<Option<M::Answer>, String> {
        match task {}
    }
}

macro_rules! simulated {
    ($($machine:ty: $kind:ident;)*) => { $(
        impl Simulated for $machine {
            fn command(command: Command) -> Option<Self::Command> {
                if let Command::$kind(command) = command { Some(command) } else { None }
            }

            fn report(report: Self::Report) -> Report {
                Report::$kind(report)
            }
        }
    )* };
}

simulated! {
    Control: Bus;
    master::state::State: Master;
    node::state::State: Node;
    display::state::State: Display;
}
