//! What makes a process hostile: between its state and the network, anything well-formed may be left out, said twice, altered or
//! made up, at any time, by dice.
//!
//! A hostile node never sends finite pixels that are wrong under a permit of its own: only [`Run::verify`] finds these, and as
//! many as its share says; `What::Corrupt` is about them. What a display writes and which bytes a bus holds is theirs to say,
//! and nobody else's: they are hostile in what they report and answer.
//!
//! [`Run::verify`]: crate::topology::Run

use std::sync::Arc;

use super::dice::Dice;
use super::simulated::Simulated;
use crate::processes::bus::control::Control;
use crate::processes::driver::{Action, ConnectionId};
use crate::processes::{display, master, node};
use crate::protocol::control::{BusReport, Comparison, DisplayReport, MasterReport, NodeReport, Packets, TileResult};
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

/// Of all that it says, so much in a hundred is spoiled.
const SPOILED: u64 = 10;
/// So many events in a hundred bring something made up.
const MADE_UP: u64 = 10;
/// Messages that are remembered, to be said again.
const REMEMBERED_MAX: usize = 64;

/// A machine that can be made hostile.
pub(super) trait Corruptible: Simulated<Outgoing: Clone, Report: Clone> {
    fn make_up_report(invention: &mut Invention) -> Self::Report;

    /// `None`: it sends nothing but what its worker does.
    fn make_up_message(invention: &mut Invention) -> Option<Self::Outgoing>;

    /// Another message like this one.
    fn alter(_message: &mut Self::Outgoing, _invention: &mut Invention) {}
}

/// What can be made up, of a run of so many nodes and tiles.
#[derive(Clone, Debug)]
pub(super) struct Invention {
    pub(super) dice: Dice,
    pub(super) nodes: u16,
    pub(super) tiles: u32,
}

pub(super) struct Mischief<M: Corruptible> {
    invention: Invention,
    sent: Vec<(ConnectionId, M::Outgoing)>,
}

impl<M: Corruptible> Mischief<M> {
    pub(super) fn new(invention: Invention) -> Self {
        Self { invention, sent: Vec::new() }
    }

    /// What is done in the place of these actions. Tasks and the end stay: they are no one's to see.
    pub(super) fn spoil(&mut self, actions: Vec<Action<M>>) -> Vec<Action<M>> {
        let mut spoiled = Vec::new();
        for action in actions {
            match action {
                Action::Send(to, message) => self.send(to, message, &mut spoiled),
                Action::Report(report) if self.invention.dice.chance(SPOILED) => {
                    if self.invention.dice.chance(50) {
                        spoiled.extend([Action::Report(report.clone()), Action::Report(report)]);
                    }
                }
                end @ Action::End(_) => {
                    spoiled.push(end);
                    return spoiled;
                }
                action => spoiled.push(action),
            }
        }
        if self.invention.dice.chance(MADE_UP) {
            self.make_up(&mut spoiled);
        }
        spoiled
    }

    fn send(&mut self, to: ConnectionId, mut message: M::Outgoing, spoiled: &mut Vec<Action<M>>) {
        if self.sent.len() < REMEMBERED_MAX {
            self.sent.push((to, message.clone()));
        }
        if self.invention.dice.chance(SPOILED) {
            match self.invention.dice.below(3) {
                0 => return,
                1 => spoiled.push(Action::Send(to, message.clone())),
                _ => M::alter(&mut message, &mut self.invention),
            }
        }
        spoiled.push(Action::Send(to, message));
    }

    fn make_up(&mut self, spoiled: &mut Vec<Action<M>>) {
        match self.invention.dice.below(4) {
            0 => spoiled.push(Action::Report(M::make_up_report(&mut self.invention))),
            1 => {
                if let (Some(message), Some((to, _))) = (M::make_up_message(&mut self.invention), self.sent.first()) {
                    spoiled.push(Action::Send(*to, message));
                }
            }
            2 if !self.sent.is_empty() => {
                let (to, message) = self.invention.dice.choose(&self.sent).clone();
                spoiled.push(Action::Send(to, message));
            }
            _ if self.invention.dice.chance(20) => {
                let ids: Vec<_> = self.sent.iter().map(|(id, _)| *id).collect();
                if !ids.is_empty() {
                    spoiled.push(Action::Close(*self.invention.dice.choose(&ids)));
                }
            }
            _ => {}
        }
    }
}

impl Invention {
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

    pub(super) fn producer(&mut self) -> Producer {
        Producer { run: RunId(self.dice.below(3)), node: self.node(), epoch: self.epoch() }
    }
}

impl Corruptible for node::state::State {
    fn make_up_report(invention: &mut Invention) -> NodeReport {
        match invention.dice.below(5) {
            0 => NodeReport::Incident("an incident".to_owned()),
            1 => NodeReport::Failed("a failure".to_owned()),
            2 => NodeReport::Packets(Packets { simd: Simd::Scalar, derived_bytes: invention.count() }),
            3 => NodeReport::Leaving,
            _ => NodeReport::Finished,
        }
    }

    fn make_up_message(invention: &mut Invention) -> Option<node::state::Outgoing> {
        Some(match invention.dice.below(3) {
            0 => node::state::Outgoing::Work(WorkRequest::Ready),
            1 => {
                let (done, receipt) = (invention.done(), invention.mac());
                node::state::Outgoing::Work(WorkRequest::Done { done, receipt })
            }
            _ => {
                let pixels = Arc::new(Pixels { colour: vec![[0.5; 3]], ..Pixels::default() });
                let (tile, attempt, permit) = (invention.tile(), invention.attempt(), invention.mac());
                node::state::Outgoing::Pixels { tile, attempt, permit, pixels }
            }
        })
    }

    fn alter(message: &mut node::state::Outgoing, invention: &mut Invention) {
        use node::state::Outgoing;
        match (message, invention.dice.below(3)) {
            (Outgoing::Pixels { tile, .. }, 0) => *tile = TileId(tile.0 ^ 1),
            (Outgoing::Pixels { attempt, .. }, 1) => *attempt = Attempt(attempt.0.wrapping_add(1)),
            (Outgoing::Pixels { pixels, .. }, _) => {
                let colour = [f32::NAN, f32::INFINITY, 0.0];
                *pixels = Arc::new(Pixels { colour: vec![colour], ..Pixels::default() });
            }
            (Outgoing::Work(WorkRequest::Done { done, .. }), 0) => done.trace.primitive_tests = invention.count(),
            (Outgoing::Work(WorkRequest::Done { done, .. }), 1) => done.tile = invention.tile(),
            (Outgoing::Work(WorkRequest::Done { receipt, .. }), _) => *receipt = invention.mac(),
            (Outgoing::Work(WorkRequest::Ready), _) => {}
        }
    }
}

impl Corruptible for master::state::State {
    fn make_up_report(invention: &mut Invention) -> MasterReport {
        let (node, epoch) = (invention.node(), invention.epoch());
        match invention.dice.below(10) {
            0 => MasterReport::Incident("an incident".to_owned()),
            1 => MasterReport::TilesWanted(invention.dice.below(1 << 32) as u32),
            2 => MasterReport::NodeReady { node, epoch },
            3 => MasterReport::Done { node, epoch, done: invention.done() },
            4 => MasterReport::Lost(invention.lost()),
            5 => {
                let returned = invention.lost().into_iter().map(|lost| (lost.tile, lost.attempt));
                MasterReport::Returned(returned.collect())
            }
            6 => MasterReport::Forged { node, epoch, why: "it did".to_owned() },
            7 => MasterReport::Idle { node, epoch },
            8 => MasterReport::Late { node, epoch, tile: invention.tile() },
            _ => MasterReport::Finished(MasterTotals { attempts_issued: invention.count(), ..MasterTotals::default() }),
        }
    }

    fn make_up_message(invention: &mut Invention) -> Option<master::state::Outgoing> {
        let (tile, attempt, permit) = (invention.tile(), invention.attempt(), invention.mac());
        Some(if invention.dice.chance(70) {
            master::state::Outgoing::Work(WorkReply::Job { tile, attempt, permit })
        } else {
            let node = invention.node();
            master::state::Outgoing::Memory(MemoryRequest::Job { node, tile, attempt, bytes: u32::MAX })
        })
    }

    fn alter(message: &mut master::state::Outgoing, invention: &mut Invention) {
        if let master::state::Outgoing::Work(WorkReply::Job { tile, attempt, permit }) = message {
            match invention.dice.below(3) {
                0 => *tile = invention.tile(),
                1 => *attempt = invention.attempt(),
                _ => *permit = invention.mac(),
            }
        }
    }
}

impl Corruptible for display::state::State {
    fn make_up_report(invention: &mut Invention) -> DisplayReport {
        let (node, epoch) = (invention.node(), invention.epoch());
        match invention.dice.below(5) {
            0 => DisplayReport::Incident("an incident".to_owned()),
            1 => DisplayReport::Failed("a failure".to_owned()),
            2 => DisplayReport::Forged { node, epoch, why: "it did".to_owned() },
            3 => DisplayReport::Condemned(invention.producer(), (0..invention.tiles).map(|_| true).collect()),
            _ => {
                let result = |invention: &mut Invention| TileResult {
                    producer: invention.producer(),
                    digest: [invention.dice.below(2) as u8; 32],
                };
                let tile = invention.tile();
                DisplayReport::Compared(Comparison { tile, kept: result(invention), other: result(invention) })
            }
        }
    }

    fn make_up_message(invention: &mut Invention) -> Option<display::state::Outgoing> {
        let (tile, attempt, receipt) = (invention.tile(), invention.attempt(), invention.mac());
        Some(display::state::Outgoing(if invention.dice.chance(80) {
            ImageReply::Acknowledged { tile, attempt, receipt }
        } else {
            ImageReply::Refused("no".to_owned())
        }))
    }

    fn alter(message: &mut display::state::Outgoing, invention: &mut Invention) {
        if let ImageReply::Acknowledged { tile, receipt, .. } = &mut message.0 {
            if invention.dice.chance(50) { *tile = invention.tile() } else { *receipt = invention.mac() }
        }
    }
}

impl Corruptible for Control {
    fn make_up_report(invention: &mut Invention) -> BusReport {
        match invention.dice.below(3) {
            0 => BusReport::Incident("an incident".to_owned()),
            1 => BusReport::Failed("a failure".to_owned()),
            _ => BusReport::Finished(BusTotals { fetches: invention.count(), ..BusTotals::default() }),
        }
    }

    fn make_up_message(_invention: &mut Invention) -> Option<Self::Outgoing> {
        None
    }
}
