//! A display whose journal is a list: what `display/mod.rs` does, with the frame for a hash.

use std::collections::BTreeMap;

use sha2::{Digest, Sha256};

use super::child::{Child, WELL};
use super::network::{Message, Network, Parcel, Wire};
use crate::ids::{Attempt, Epoch, NodeId, TileId};
use crate::processes::manager::process::{Command, ProcessId, Report};
use crate::protocol::control::{Comparison, DisplayCommand, DisplayReport, DisplayTotals, Revocation, TileResult};
use crate::protocol::image::{ImageReply, TilePixels};

/// What outlives the displays.
#[derive(Clone, Debug, Default)]
pub(super) struct Journal {
    records: Vec<Record>,
}

#[derive(Clone, Debug)]
enum Record {
    Pixels(TileId, Kept),
    Revoked(Revocation),
}

/// What is in the frame of a tile.
#[derive(Clone, PartialEq, Debug)]
pub(super) struct Kept {
    attempt: Attempt,
    pub(super) source: (NodeId, Epoch),
    pub(super) bytes: Vec<u8>,
}

#[derive(Debug)]
pub(super) struct Display {
    pub(super) child: Child,
    tiles: u32,
    pub(super) frame: BTreeMap<TileId, Kept>,
    revoked: BTreeMap<TileId, Attempt>,
    stale: u64,
    peers: BTreeMap<Wire, ProcessId>,
    /// The image is written.
    pub(super) finished: bool,
}

impl Display {
    pub(super) fn new(child: Child, tiles: u32) -> Self {
        Self {
            child,
            tiles,
            frame: BTreeMap::new(),
            revoked: BTreeMap::new(),
            stale: 0,
            peers: BTreeMap::new(),
            finished: false,
        }
    }

    pub(super) fn arrived(&mut self, network: &mut Network, journal: &mut Journal, wire: Wire, parcel: Parcel) {
        match parcel {
            Parcel::Hello(peer) => {
                self.peers.insert(wire, peer);
                network.welcome(self.child.me, wire);
            }
            Parcel::End => drop(self.peers.remove(&wire)),
            Parcel::Message(Message::Command(Command::Display(command))) => self.obey(network, journal, command),
            Parcel::Message(Message::Pixels(pixels, bytes)) => self.take(network, journal, wire, &pixels, bytes),
            _ => {}
        }
    }

    fn obey(&mut self, network: &mut Network, journal: &mut Journal, command: DisplayCommand) {
        match command {
            DisplayCommand::Configure(configuration) => {
                if !configuration.resume {
                    *journal = Journal::default();
                }
                journal.records.iter().for_each(|record| match record {
                    Record::Pixels(tile, kept) => drop(self.frame.insert(*tile, kept.clone())),
                    Record::Revoked(revocation) => self.revoke(*revocation),
                });
                let mut bits = vec![0; self.tiles.div_ceil(8) as usize];
                self.frame.keys().for_each(|tile| bits[tile.0 as usize / 8] |= 1 << (tile.0 % 8));
                self.report(network, DisplayReport::Restored(bits));
                self.report(network, DisplayReport::Listening(Network::address(self.child.me)));
            }
            DisplayCommand::Revoke(revocations) => {
                for revocation in &revocations {
                    self.revoke(*revocation);
                    journal.records.push(Record::Revoked(*revocation));
                }
                self.report(network, DisplayReport::Revoked(revocations));
            }
            DisplayCommand::Finish => {
                self.finished = true;
                let mut hash = Sha256::new();
                self.frame.values().for_each(|kept| hash.update(&kept.bytes));
                let hash: [u8; 32] = hash.finalize().into();
                self.report(
                    network,
                    DisplayReport::Finished(DisplayTotals {
                        sha256: hash.iter().map(|byte| format!("{byte:02x}")).collect(),
                        tiles_done: self.frame.len() as u32,
                        tiles_stale: self.stale,
                        wire_bytes: 0,
                        written: Vec::new(),
                    }),
                );
                for wire in std::mem::take(&mut self.peers).into_keys() {
                    network.close(self.child.me, wire);
                }
                self.child.close(network, WELL);
            }
        }
    }

    fn revoke(&mut self, Revocation { tile, attempt }: Revocation) {
        if self.frame.get(&tile).is_some_and(|kept| kept.attempt <= attempt) {
            self.frame.remove(&tile);
        }
        let revoked = self.revoked.entry(tile).or_insert(attempt);
        *revoked = (*revoked).max(attempt);
    }

    fn take(&mut self, network: &mut Network, journal: &mut Journal, wire: Wire, pixels: &TilePixels, bytes: Vec<u8>) {
        let TilePixels { tile, attempt, .. } = *pixels;
        let Some(peer) = self.peers.get(&wire) else { return };
        let Some(node) = peer.node() else { return };
        let this = Kept { attempt, source: (node, peer.epoch), bytes };
        let is_revoked = self.revoked.get(&tile).is_some_and(|revoked| attempt <= *revoked);
        match self.frame.get(&tile) {
            _ if is_revoked => self.stale += 1,
            Some(kept) if *kept == this => {}
            Some(kept) => {
                self.stale += 1;
                let (kept, other) = (result(kept), result(&this));
                self.report(network, DisplayReport::Compared(Comparison { tile, kept, other }));
            }
            None => {
                journal.records.push(Record::Pixels(tile, this.clone()));
                self.frame.insert(tile, this);
            }
        }
        network.send(self.child.me, wire, Message::Reply(ImageReply::Acknowledged { tile, attempt }));
    }

    fn report(&self, network: &mut Network, report: DisplayReport) {
        self.child.report(network, Report::Display(report));
    }
}

fn result(kept: &Kept) -> TileResult {
    TileResult { attempt: kept.attempt, source: Some(kept.source), digest: Sha256::digest(&kept.bytes).into() }
}
