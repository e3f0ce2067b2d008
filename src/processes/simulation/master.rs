//! A master's shell in virtual time: the real state, and what `master/mod.rs` does around it.

use std::collections::BTreeMap;
use std::time::Duration;

use super::child::{BADLY, CONNECT_DEADLINE, Child, WELL};
use super::network::{Message, Network, Parcel, Timer, Wire};
use super::stopwatch::Stopwatch;

use crate::machine::totals::MasterTotals;
use crate::processes::manager::process::{Command, ProcessId, Report};
use crate::processes::master::dispatcher::{Action, Dispatcher, Event};
use crate::processes::master::seat::NodeProcess;
use crate::protocol::control::{MasterCommand, MasterConfiguration, MasterReport};

/// As the shell's.
const TICK: Duration = Duration::from_millis(100);

#[derive(Debug)]
pub(super) struct Master {
    pub(super) child: Child,
    configuration: Option<MasterConfiguration>,
    /// Once the bus is connected.
    state: Option<Dispatcher>,
    bus: Option<Wire>,
    peers: BTreeMap<Wire, NodeProcess>,
    /// Most tiles that it had, queued or handed out, a node.
    pub(super) tiles_a_node: usize,
}

impl Master {
    pub(super) fn new(child: Child) -> Self {
        Self { child, configuration: None, state: None, bus: None, peers: BTreeMap::new(), tiles_a_node: 0 }
    }

    pub(super) fn arrived(&mut self, network: &mut Network, watch: &mut Stopwatch, wire: Wire, parcel: Parcel) {
        match parcel {
            Parcel::Message(Message::Command(Command::Master(command))) => self.command(network, watch, command),
            Parcel::Welcome if self.bus == Some(wire) => self.serve(network),
            // Noticed by the next modelled message, if at all.
            Parcel::End if self.bus == Some(wire) => match self.state {
                Some(_) => self.bus = None,
                None => network.exit(self.child.me, BADLY),
            },
            Parcel::Hello(peer) => self.admit(network, watch, wire, peer),
            Parcel::Message(Message::Work(request)) => {
                if let Some(&process) = self.peers.get(&wire) {
                    self.handle(network, watch, Event::Request(process, request));
                }
            }
            Parcel::End => {
                if let Some(process) = self.peers.remove(&wire) {
                    network.close(self.child.me, wire);
                    self.handle(network, watch, Event::Disconnected(process));
                }
            }
            _ => {}
        }
    }

    pub(super) fn timer(&mut self, network: &mut Network, watch: &mut Stopwatch, timer: Timer) {
        match timer {
            Timer::Tick => {
                network.wake(self.child.me, TICK, Timer::Tick);
                self.handle(network, watch, Event::Tick);
            }
            Timer::Dialled(_) if self.state.is_none() => network.exit(self.child.me, BADLY),
            _ => {}
        }
    }

    fn command(&mut self, network: &mut Network, watch: &mut Stopwatch, command: MasterCommand) {
        match command {
            MasterCommand::Configure(configuration) if self.configuration.is_none() => {
                self.bus = Some(network.dial(self.child.me, self.child.id, configuration.bus, CONNECT_DEADLINE));
                self.configuration = Some(configuration);
            }
            command => self.handle(network, watch, Event::Command(command)),
        }
    }

    /// The bus has answered.
    fn serve(&mut self, network: &mut Network) {
        self.state = self.configuration.as_ref().map(Dispatcher::new);
        let address = Network::address(self.child.me);
        self.child.report(network, Report::Master(MasterReport::Listening(address)));
        network.wake(self.child.me, Duration::ZERO, Timer::Tick);
    }

    fn admit(&mut self, network: &mut Network, watch: &mut Stopwatch, wire: Wire, peer: ProcessId) {
        let Some(configuration) = &self.configuration else { return network.close(self.child.me, wire) };
        let nodes = configuration.first_node.0..configuration.first_node.0 + configuration.nodes;
        let Some(node) = peer.node().filter(|node| nodes.contains(&node.0)) else {
            return network.close(self.child.me, wire);
        };
        network.welcome(self.child.me, wire);
        let process = NodeProcess { node, epoch: peer.epoch };
        self.peers.insert(wire, process);
        self.handle(network, watch, Event::Connected(process));
    }

    fn handle(&mut self, network: &mut Network, watch: &mut Stopwatch, event: Event) {
        let (Some(state), Some(configuration), false) = (&mut self.state, &self.configuration, self.child.is_closing())
        else {
            return;
        };
        let now = network.now;
        let actions = watch.time(|| state.handle(now, event));
        let tiles = state.tiles().div_ceil(usize::from(configuration.nodes));
        self.tiles_a_node = self.tiles_a_node.max(tiles);
        for action in actions {
            match action {
                Action::Report(report) => self.child.report(network, Report::Master(report)),
                Action::Hand { to, tile, attempt, permit } => {
                    if let Some(wire) = wire_of(&self.peers, to) {
                        network.send(self.child.me, wire, Message::Job { tile, attempt, permit });
                    }
                }
                Action::Bus(message) => {
                    if let Some(bus) = self.bus {
                        network.send(self.child.me, bus, Message::Modelled(message));
                    }
                }
                Action::Dismiss(process) => {
                    if let Some(wire) = wire_of(&self.peers, process) {
                        self.peers.remove(&wire);
                        network.close(self.child.me, wire);
                    }
                }
                Action::End(totals) => self.end(network, totals),
            }
        }
    }

    fn end(&mut self, network: &mut Network, totals: MasterTotals) {
        // The connection to the bus ends first: all modelled messages have left before they are asked for.
        for wire in self.bus.take().into_iter().chain(std::mem::take(&mut self.peers).into_keys()) {
            network.close(self.child.me, wire);
        }
        self.child.report(network, Report::Master(MasterReport::Finished(totals)));
        self.child.close(network, WELL);
    }
}

/// The latest connection of a process.
fn wire_of(peers: &BTreeMap<Wire, NodeProcess>, process: NodeProcess) -> Option<Wire> {
    peers.iter().rev().find(|(_, peer)| **peer == process).map(|(&wire, _)| wire)
}
