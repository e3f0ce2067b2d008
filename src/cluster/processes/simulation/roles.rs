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

pub(super) enum Body {
    Bus(Box<Host<Control, Memory>>),
    Master(Box<Host<master::state::State, NoTasks>>),
    Node(Box<Host<node::state::State, Tracer>>),
    Display(Box<Host<display::state::State, Files>>),
}

/// The same of whichever host.
macro_rules! of_host {
    ($body:expr, $host:ident => $what:expr) => {
        match $body {
            Body::Bus($host) => $what,
            Body::Master($host) => $what,
            Body::Node($host) => $what,
            Body::Display($host) => $what,
        }
    };
}

impl Body {
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

    /// SIGTERM, of a node.
    pub(super) fn terminate(&mut self, network: &mut Network, watch: &mut Stopwatch) {
        if let Self::Node(node) = self {
            node.happen(network, watch, Event::Terminate);
        }
    }

    /// What a node renders from now on is wrong.
    pub(super) fn corrupt(&mut self, network: &mut Network, watch: &mut Stopwatch) {
        if let Self::Node(node) = self {
            node.happen(network, watch, Event::Command(NodeCommand::Corrupt));
        }
    }
}

/// For a state that has no tasks.
pub(super) struct NoTasks;

impl<M: Machine<Task = std::convert::Infallible>> Worker<M> for NoTasks {
    fn begin(&mut self, _desk: &mut super::host::Desk, task: M::Task) -> Result<Option<M::Answer>, String> {
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
