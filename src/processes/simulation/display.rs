//! A display's shell in virtual time: the real state, what `display/mod.rs` does around it, and a journal that is a list.

use std::collections::BTreeMap;

use super::child::{BADLY, Child, WELL};
use super::network::{Message, Network, Parcel, Wire};
use crate::ids::{Attempt, Producer, TileId};
use crate::journal::Record;
use crate::processes::display::composition::{Action, Composition, Event, Finished, Source};
use crate::processes::driver::ConnectionId;
use crate::processes::manager::process::{Command, Report};
use crate::processes::manager::rehearsal;
use crate::protocol::control::{DisplayCommand, DisplayConfiguration, DisplayReport, DisplayTotals};

/// What outlives the displays.
#[derive(Debug, Default)]
pub(super) struct Journal {
    entries: Vec<Entry>,
}

#[derive(Debug)]
enum Entry {
    Pixels { tile: TileId, attempt: Attempt, producer: Producer, planes: Vec<u8> },
    Condemned(Producer),
}

#[derive(Debug)]
pub(super) struct Display {
    pub(super) child: Child,
    /// Once it is configured, and until it is to finish.
    state: Option<Composition>,
    peers: BTreeMap<ConnectionId, (Wire, Source)>,
    connections: u64,
    /// The image is written.
    pub(super) finished: Option<Finished>,
}

impl Journal {
    fn append(&mut self, record: &Record) {
        self.entries.push(match *record {
            Record::Pixels { tile, attempt, producer, planes } => {
                Entry::Pixels { tile, attempt, producer, planes: planes.to_vec() }
            }
            Record::Condemned(producer) => Entry::Condemned(producer),
        });
    }

    fn restore(&self, state: &mut Composition) {
        for entry in &self.entries {
            let record = match entry {
                Entry::Pixels { tile, attempt, producer, planes } => {
                    Record::Pixels { tile: *tile, attempt: *attempt, producer: *producer, planes }
                }
                Entry::Condemned(producer) => Record::Condemned(*producer),
            };
            state.restore(&record);
        }
    }

    /// Whose pixels of a tile were taken last.
    pub(super) fn source(&self, of: TileId) -> Option<Source> {
        self.entries.iter().rev().find_map(|entry| match entry {
            Entry::Pixels { tile, producer, .. } if *tile == of => Some((producer.node, producer.epoch)),
            _ => None,
        })
    }
}

impl Display {
    pub(super) fn new(child: Child) -> Self {
        Self { child, state: None, peers: BTreeMap::new(), connections: 0, finished: None }
    }

    pub(super) fn arrived(&mut self, network: &mut Network, journal: &mut Journal, wire: Wire, parcel: Parcel) {
        match parcel {
            Parcel::Hello(peer) => {
                let Some(node) = peer.node() else { return network.close(self.child.me, wire) };
                self.peers.insert(ConnectionId::Accepted(self.connections), (wire, (node, peer.epoch)));
                self.connections += 1;
                network.welcome(self.child.me, wire);
            }
            Parcel::End => self.peers.retain(|_, (other, _)| *other != wire),
            Parcel::Message(Message::Command(Command::Display(command))) => self.obey(network, journal, command),
            Parcel::Message(Message::Pixels(tile, bytes)) => {
                let Some((&from, &(_, source))) = self.peers.iter().find(|(_, (other, _))| *other == wire) else {
                    return;
                };
                self.handle(network, journal, Event::Tile { from, source, tile, bytes: &bytes });
            }
            _ => {}
        }
    }

    fn obey(&mut self, network: &mut Network, journal: &mut Journal, command: DisplayCommand) {
        match command {
            DisplayCommand::Heartbeat => {}
            DisplayCommand::Configure(configuration) => self.configure(network, journal, &configuration),
            DisplayCommand::Condemn(producer) => self.handle(network, journal, Event::Condemn(producer)),
            DisplayCommand::TellHoldings { question } => {
                self.handle(network, journal, Event::TellHoldings { question });
            }
            DisplayCommand::Finish => {
                let Some(state) = self.state.take() else { return network.exit(self.child.me, BADLY) };
                for (wire, _) in std::mem::take(&mut self.peers).into_values() {
                    network.close(self.child.me, wire);
                }
                let finished = state.finish();
                let totals = DisplayTotals {
                    sha256: finished.frame.sha256(),
                    tiles_done: finished.tiles_done,
                    tiles_stale: finished.tiles_stale,
                    wire_bytes: 0,
                    written: Vec::new(),
                };
                self.finished = Some(finished);
                self.report(network, DisplayReport::Finished(totals));
                self.child.close(network, WELL);
            }
        }
    }

    fn configure(&mut self, network: &mut Network, journal: &mut Journal, configuration: &DisplayConfiguration) {
        let Ok(mut state) = Composition::new(configuration, rehearsal::RUN) else {
            return network.exit(self.child.me, BADLY);
        };
        if !configuration.resume {
            *journal = Journal::default();
        }
        journal.restore(&mut state);
        self.report(network, DisplayReport::Restored(state.holdings()));
        self.report(network, DisplayReport::Listening(Network::address(self.child.me)));
        self.state = Some(state);
    }

    fn handle(&mut self, network: &mut Network, journal: &mut Journal, event: Event) {
        let Some(state) = &mut self.state else { return };
        for action in state.handle(event) {
            match action {
                Action::Append(record) => journal.append(&record),
                Action::Reply(to, reply) => {
                    if let Some(&(wire, _)) = self.peers.get(&to) {
                        network.send(self.child.me, wire, Message::Reply(reply));
                    }
                }
                Action::Dismiss(node) => {
                    if let Some((wire, _)) = self.peers.remove(&node) {
                        network.close(self.child.me, wire);
                    }
                }
                Action::Report(report) => self.child.report(network, Report::Display(report)),
            }
        }
    }

    fn report(&self, network: &mut Network, report: DisplayReport) {
        self.child.report(network, Report::Display(report));
    }
}
