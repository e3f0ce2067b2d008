//! A bus without memory: takes what is uploaded, answers fetches, and counts both as a bus does.

use std::collections::HashMap;

use super::child::{Child, WELL};
use super::network::{Message, Network, Parcel, Wire};
use crate::ids::{Attempt, TileId};
use crate::machine::totals::BusTotals;
use crate::processes::manager::process::{Command, Report};
use crate::protocol::control::{BusCommand, BusReport};
use crate::protocol::memory::MemoryRequest;

#[derive(Debug)]
pub(super) struct Bus {
    pub(super) child: Child,
    totals: BusTotals,
    /// Fetches and their bytes.
    fetched: HashMap<(TileId, Attempt), (u64, u64)>,
}

impl Bus {
    pub(super) fn new(child: Child) -> Self {
        Self { child, totals: BusTotals::default(), fetched: HashMap::new() }
    }

    pub(super) fn arrived(&mut self, network: &mut Network, wire: Wire, parcel: Parcel) {
        let me = self.child.me;
        match parcel {
            Parcel::Hello(_) => network.welcome(me, wire),
            Parcel::Message(Message::Command(Command::Bus(command))) => self.obey(network, command),
            Parcel::Message(Message::Store) => network.send(me, wire, Message::Stored),
            Parcel::Message(Message::Modelled(MemoryRequest::Job { bytes, .. })) => {
                self.log(1);
                self.totals.message_bytes += u64::from(bytes);
            }
            Parcel::Message(Message::Fetch { tile, attempt, fetches, bytes }) => {
                self.log(fetches);
                self.totals.fetches += fetches;
                self.totals.fetched_bytes += bytes;
                let fetched = self.fetched.entry((tile, attempt)).or_default();
                *fetched = (fetched.0 + fetches, fetched.1 + bytes);
                network.send(me, wire, Message::Data);
            }
            _ => {}
        }
    }

    fn obey(&mut self, network: &mut Network, command: BusCommand) {
        match command {
            BusCommand::Heartbeat => {}
            BusCommand::Configure(_) => {
                let address = Network::address(self.child.me);
                self.child.report(network, Report::Bus(BusReport::Listening(address)));
            }
            BusCommand::Finish { lost } => {
                for attempt in lost {
                    let key = (attempt.tile, attempt.attempt);
                    let (fetches, bytes) = self.fetched.get(&key).copied().unwrap_or_default();
                    self.totals.fetches_of_lost_attempts += fetches;
                    self.totals.fetched_bytes_of_lost_attempts += bytes;
                }
                self.child.report(network, Report::Bus(BusReport::Finished(self.totals)));
                self.child.close(network, WELL);
            }
        }
    }

    fn log(&mut self, transactions: u64) {
        self.totals.transactions += transactions;
        self.totals.log_rows += transactions;
    }
}
