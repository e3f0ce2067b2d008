//! Hostile processes: between a state and the network, anything well-formed is left out, sent twice, altered or made up, at
//! random.
//!
//! What a display writes and which bytes a bus has is theirs alone: they are hostile in what they report and answer. A hostile
//! node also sends finite pixels that are wrong under a permit of its own. Only `run.verify` finds these, so they are listed:
//! the image may have them as long as nothing else gives their process away.

use std::collections::BTreeSet;
use std::sync::Arc;

use super::dice::Dice;
use super::simulated::Simulated;
use crate::processes::bus::control::Control;
use crate::processes::driver::{Action, ConnectionId};
use crate::processes::{display, master, node};
use crate::protocol::control::{
    BusReport, Comparison, DisplayReport, DisplayTotals, Holdings, MasterReport, NodeReport, Packets, Share, TileResult,
};
use crate::protocol::image::ImageReply;
use crate::protocol::mac::Mac;
use crate::protocol::memory::MemoryRequest;
use crate::protocol::work::{TileDone, WorkReply, WorkRequest};
use ground::ids::{Attempt, Epoch, NodeId, Producer, RunId, TileId};
use machine::hardware::stats::MemoryStats;
use machine::hardware::totals::{BusTotals, LostAttempt, MasterTotals};
use trace::picture::Pixels;
use trace::tracer::TraceStats;
use trace::tracer::simd::Simd;

/// Of all messages.
const TAMPERED_PERCENT: u64 = 10;
/// Of all events.
const FORGED_PERCENT: u64 = 10;
/// Messages that are kept, to be sent again.
const REMEMBERED_MAX: usize = 64;
/// More than any queue should take.
const FLOOD: usize = 150;
const FLOODS_MAX: u32 = 12;

/// A machine that can be made hostile.
pub(super) trait Subvertible: Simulated<Outgoing: Clone, Report: Clone> {
    fn forge_report(forge: &mut Forge) -> Self::Report;

    /// `None`: it sends nothing but what its worker does.
    fn forge_message(forge: &mut Forge) -> Option<Self::Outgoing>;

    /// Whether it is sent many times over.
    fn is_for_flood(_message: &Self::Outgoing) -> bool {
        true
    }

    /// Another message like this one.
    fn alter(_message: &mut Self::Outgoing, _invention: &mut Forge) {}
}

/// What can be made up, of a run of so many nodes and tiles.
#[derive(Clone, Debug)]
pub(super) struct Forge {
    pub(super) dice: Dice,
    pub(super) nodes: u16,
    pub(super) tiles: u32,
    pub(super) manner: Manner,
    /// If set, only this alteration is made and no message is invented.
    pub(super) only: Option<u64>,
    /// Attempts whose pixels it made up, finite and under its own permit.
    pub(super) plausible: BTreeSet<(TileId, Attempt)>,
}

/// What a hostile process does besides what all do.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Manner {
    Plain,
    /// Says the same many times over.
    Flood,
    /// The same, and reads no answer.
    Unreading,
}

pub(super) struct Adversary<M: Subvertible> {
    pub(super) forge: Forge,
    floods: u32,
    sent: Vec<(ConnectionId, M::Outgoing)>,
}

impl<M: Subvertible> Adversary<M> {
    pub(super) fn new(forge: Forge) -> Self {
        Self { forge, floods: 0, sent: Vec::new() }
    }

    /// What is done in the place of these actions. Tasks and the end stay as they are.
    pub(super) fn tamper(&mut self, actions: Vec<Action<M>>) -> Vec<Action<M>> {
        let mut sent_on = Vec::new();
        for action in actions {
            match action {
                Action::Send(to, message) => self.send(to, message, &mut sent_on),
                Action::Report(report) if self.forge.dice.chance(TAMPERED_PERCENT) => {
                    if self.forge.dice.chance(50) {
                        sent_on.extend([Action::Report(report.clone()), Action::Report(report)]);
                    }
                }
                end @ Action::End(_) => {
                    sent_on.push(end);
                    return sent_on;
                }
                action => sent_on.push(action),
            }
        }
        if self.forge.dice.chance(FORGED_PERCENT) {
            self.forge(&mut sent_on);
        }
        if self.forge.manner != Manner::Plain && self.floods < FLOODS_MAX && self.forge.dice.chance(FORGED_PERCENT) {
            self.flood(&mut sent_on);
        }
        sent_on
    }

    fn flood(&mut self, sent_on: &mut Vec<Action<M>>) {
        self.floods += 1;
        if self.forge.manner == Manner::Flood && self.forge.dice.chance(50) {
            let report = M::forge_report(&mut self.forge);
            return sent_on.extend((0..FLOOD).map(|_| Action::Report(report.clone())));
        }
        let last = self.sent.iter().rev().find(|(_, message)| M::is_for_flood(message));
        if let Some((to, message)) = last {
            sent_on.extend((0..FLOOD).map(|_| Action::Send(*to, message.clone())));
        }
    }

    fn send(&mut self, to: ConnectionId, mut message: M::Outgoing, sent_on: &mut Vec<Action<M>>) {
        if self.sent.len() < REMEMBERED_MAX {
            self.sent.push((to, message.clone()));
        }
        if self.forge.dice.chance(TAMPERED_PERCENT) {
            match self.forge.dice.below(3) {
                0 => return,
                1 => sent_on.push(Action::Send(to, message.clone())),
                _ => M::alter(&mut message, &mut self.forge),
            }
        }
        sent_on.push(Action::Send(to, message));
    }

    fn forge(&mut self, sent_on: &mut Vec<Action<M>>) {
        match self.forge.dice.below(4) {
            0 => sent_on.push(Action::Report(M::forge_report(&mut self.forge))),
            1 => {
                if self.forge.only.is_some() {
                    return;
                }
                if let (Some(message), Some((to, _))) = (M::forge_message(&mut self.forge), self.sent.first()) {
                    sent_on.push(Action::Send(*to, message));
                }
            }
            2 if !self.sent.is_empty() => {
                let (to, message) = self.forge.dice.choose(&self.sent).clone();
                sent_on.push(Action::Send(to, message));
            }
            _ if self.forge.dice.chance(20) => {
                let ids: Vec<_> = self.sent.iter().map(|(id, _)| *id).collect();
                if !ids.is_empty() {
                    sent_on.push(Action::Close(*self.forge.dice.choose(&ids)));
                }
            }
            _ => {}
        }
    }
}

impl Forge {
    /// Of a process that is no worse than the others.
    pub(super) fn new(dice: Dice, nodes: u16, tiles: u32) -> Self {
        Self { dice, nodes, tiles, manner: Manner::Plain, only: None, plausible: BTreeSet::new() }
    }

    /// Which of so many alterations is made.
    fn alteration(&mut self, count: u64) -> u64 {
        self.only.map_or_else(|| self.dice.below(count), |only| only % count)
    }

    pub(super) fn tile(&mut self) -> TileId {
        // Some that do not exist.
        TileId(self.dice.below(u64::from(self.tiles) + 3) as u32)
    }

    pub(super) fn attempt(&mut self) -> Attempt {
        Attempt(if self.dice.chance(5) { u32::MAX } else { self.dice.below(2 * u64::from(self.tiles)) as u32 })
    }

    pub(super) fn node(&mut self) -> NodeId {
        NodeId(self.dice.below(u64::from(self.nodes) + 2) as u16)
    }

    pub(super) fn epoch(&mut self) -> Epoch {
        Epoch(self.dice.below(4) as u32)
    }

    pub(super) fn count(&mut self) -> u64 {
        if self.dice.chance(30) { u64::MAX } else { self.dice.below(1000) }
    }

    pub(super) fn mac(&mut self) -> Mac {
        Mac::default()
    }

    pub(super) fn done(&mut self) -> Box<TileDone> {
        let trace =
            TraceStats { rays: [1, 0, 0, self.count()], primitive_tests: self.count(), ..TraceStats::default() };
        let memory = self.dice.chance(50).then(MemoryStats::default);
        let render_cpu_nanoseconds = self.count();
        Box::new(TileDone { tile: self.tile(), attempt: self.attempt(), trace, memory, render_cpu_nanoseconds })
    }

    pub(super) fn lost(&mut self) -> Vec<LostAttempt> {
        (0..self.dice.below(4)).map(|_| LostAttempt { tile: self.tile(), attempt: self.attempt() }).collect()
    }

    pub(super) fn holdings(&mut self) -> Holdings {
        let tiles = (0..self.tiles).map(|_| self.dice.chance(50)).collect();
        let share = |forge: &mut Self| {
            let latest = TileId(forge.dice.below(2 * u64::from(forge.tiles)) as u32);
            Share { producer: forge.producer(), tiles: 1, latest }
        };
        Holdings { tiles, shares: (0..self.dice.below(3)).map(|_| share(self)).collect() }
    }

    pub(super) fn producer(&mut self) -> Producer {
        Producer { run: RunId(self.dice.below(3)), node: self.node(), epoch: self.epoch() }
    }
}

impl Subvertible for node::state::State {
    fn forge_report(forge: &mut Forge) -> NodeReport {
        match forge.dice.below(5) {
            0 => NodeReport::Incident("an incident".to_owned()),
            1 => NodeReport::Failed("a failure".to_owned()),
            2 => NodeReport::Packets(Packets { simd: Simd::Scalar, derived_bytes: forge.count() }),
            3 => NodeReport::Leaving,
            _ => NodeReport::Finished,
        }
    }

    fn forge_message(forge: &mut Forge) -> Option<node::state::Outgoing> {
        Some(match forge.dice.below(3) {
            0 => node::state::Outgoing::Work(WorkRequest::Ready),
            1 => {
                let (done, receipt) = (forge.done(), forge.mac());
                node::state::Outgoing::Work(WorkRequest::Done { done, receipt })
            }
            _ => {
                let pixels = Arc::new(Pixels { colour: vec![[0.5; 3]], ..Pixels::default() });
                let (tile, attempt, permit) = (forge.tile(), forge.attempt(), forge.mac());
                node::state::Outgoing::Pixels { tile, attempt, permit, pixels }
            }
        })
    }

    fn is_for_flood(message: &node::state::Outgoing) -> bool {
        matches!(message, node::state::Outgoing::Pixels { .. })
    }

    fn alter(message: &mut node::state::Outgoing, forge: &mut Forge) {
        use node::state::Outgoing;
        match (message, forge.alteration(4)) {
            (Outgoing::Pixels { tile, .. }, 0) => *tile = TileId(tile.0 ^ 1),
            (Outgoing::Pixels { attempt, .. }, 1) => *attempt = Attempt(attempt.0.wrapping_add(1)),
            (Outgoing::Pixels { pixels, tile, attempt, .. }, 2) => {
                let colour = [0; 3].map(|_| forge.dice.below(1 << 20) as f32);
                *pixels = Arc::new(Pixels { colour: vec![colour], ..Pixels::default() });
                forge.plausible.insert((*tile, *attempt));
            }
            (Outgoing::Pixels { pixels, .. }, _) => {
                let colour = [f32::NAN, f32::INFINITY, 0.0];
                *pixels = Arc::new(Pixels { colour: vec![colour], ..Pixels::default() });
            }
            (Outgoing::Work(WorkRequest::Done { done, .. }), 0) => done.trace.primitive_tests = forge.count(),
            (Outgoing::Work(WorkRequest::Done { done, .. }), 1) => done.tile = forge.tile(),
            (Outgoing::Work(WorkRequest::Done { receipt, .. }), _) => *receipt = forge.mac(),
            (Outgoing::Work(WorkRequest::Ready), _) => {}
        }
    }
}

impl Subvertible for master::state::State {
    fn forge_report(forge: &mut Forge) -> MasterReport {
        let (node, epoch) = (forge.node(), forge.epoch());
        match forge.dice.below(10) {
            0 => MasterReport::Incident("an incident".to_owned()),
            1 => MasterReport::TilesWanted(forge.dice.below(1 << 32) as u32),
            2 => MasterReport::NodeReady { node, epoch },
            3 => MasterReport::Done { node, epoch, done: forge.done() },
            4 => MasterReport::Lost(forge.lost()),
            5 => {
                let returned = forge.lost().into_iter().map(|lost| (lost.tile, lost.attempt));
                MasterReport::Returned(returned.collect())
            }
            6 => MasterReport::Forged { node, epoch, why: "it did".to_owned() },
            7 => MasterReport::Idle { node, epoch },
            8 => MasterReport::Late { node, epoch, tile: forge.tile() },
            _ => MasterReport::Finished(MasterTotals { attempts_issued: forge.count(), ..MasterTotals::default() }),
        }
    }

    fn forge_message(forge: &mut Forge) -> Option<master::state::Outgoing> {
        let (tile, attempt, permit) = (forge.tile(), forge.attempt(), forge.mac());
        Some(if forge.dice.chance(70) {
            master::state::Outgoing::Work(WorkReply::Job { tile, attempt, permit })
        } else {
            let node = forge.node();
            master::state::Outgoing::Memory(MemoryRequest::Job { node, tile, attempt, bytes: u32::MAX })
        })
    }

    fn alter(message: &mut master::state::Outgoing, forge: &mut Forge) {
        if let master::state::Outgoing::Work(WorkReply::Job { tile, attempt, permit }) = message {
            match forge.dice.below(3) {
                0 => *tile = forge.tile(),
                1 => *attempt = forge.attempt(),
                _ => *permit = forge.mac(),
            }
        }
    }
}

impl Subvertible for display::state::State {
    fn forge_report(forge: &mut Forge) -> DisplayReport {
        let (node, epoch) = (forge.node(), forge.epoch());
        match forge.dice.below(8) {
            4 => DisplayReport::Restored(forge.holdings()),
            5 => DisplayReport::Holdings { question: 1 + forge.dice.below(3) as u32, holdings: forge.holdings() },
            6 => DisplayReport::Finished(DisplayTotals {
                sha256: String::new(),
                tiles_done: forge.tile().0,
                tiles_stale: forge.count(),
                wire_bytes: forge.count(),
                written: Vec::new(),
            }),
            0 => DisplayReport::Incident("an incident".to_owned()),
            1 => DisplayReport::Failed("a failure".to_owned()),
            2 => DisplayReport::Forged { node, epoch, why: "it did".to_owned() },
            3 => DisplayReport::Condemned(forge.producer(), (0..forge.tiles).map(|_| true).collect()),
            _ => {
                let result = |forge: &mut Forge| TileResult {
                    producer: forge.producer(),
                    digest: [forge.dice.below(2) as u8; 32],
                };
                let tile = forge.tile();
                DisplayReport::Compared(Comparison { tile, kept: result(forge), other: result(forge) })
            }
        }
    }

    fn forge_message(forge: &mut Forge) -> Option<display::state::Outgoing> {
        let (tile, attempt, receipt) = (forge.tile(), forge.attempt(), forge.mac());
        Some(display::state::Outgoing(if forge.dice.chance(80) {
            ImageReply::Acknowledged { tile, attempt, receipt }
        } else {
            ImageReply::Refused("no".to_owned())
        }))
    }

    fn alter(message: &mut display::state::Outgoing, forge: &mut Forge) {
        if let ImageReply::Acknowledged { tile, receipt, .. } = &mut message.0 {
            if forge.dice.chance(50) { *tile = forge.tile() } else { *receipt = forge.mac() }
        }
    }
}

impl Subvertible for Control {
    fn forge_report(forge: &mut Forge) -> BusReport {
        match forge.dice.below(3) {
            0 => BusReport::Incident("an incident".to_owned()),
            1 => BusReport::Failed("a failure".to_owned()),
            _ => BusReport::Finished(BusTotals { fetches: forge.count(), ..BusTotals::default() }),
        }
    }

    fn forge_message(_invention: &mut Forge) -> Option<Self::Outgoing> {
        None
    }
}
