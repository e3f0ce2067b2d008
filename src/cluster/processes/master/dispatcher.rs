//! Which node holds which tile. No socket, no clock.

use std::collections::{HashSet, VecDeque};
use std::time::Duration;

use super::seat::{Held, NodeProcess, Seat};
use crate::protocol::control::{MasterCommand, MasterConfiguration, MasterReport, TileGrant};
use crate::protocol::mac::{Claim, Mac, MacKey};
use crate::protocol::memory::MemoryRequest;
use crate::protocol::work::{TileDone, WorkRequest, jobs_per_node, tiles_per_node};
use ground::ids::{Attempt, NodeId, TileId};
use machine::hardware::totals::{LostAttempt, MasterTotals};
use machine::hardware::transaction::{END_OF_JOB_BYTES, JOB_BYTES};

#[derive(Debug)]
pub(in crate::processes) enum Event {
    Command(MasterCommand),
    Connected(NodeProcess),
    /// The connection ended. The process is not known to be dead yet: the manager says when it is.
    Disconnected(NodeProcess),
    Request(NodeProcess, WorkRequest),
    /// Somebody was not let in.
    Refused(String),
    Tick,
}

#[derive(Clone, PartialEq, Debug)]
pub(in crate::processes) enum Action {
    Report(MasterReport),
    Hand {
        to: NodeProcess,
        tile: TileId,
        attempt: Attempt,
        permit: Mac,
    },
    /// A modelled message.
    Bus(MemoryRequest),
    /// End the connection.
    Dismiss(NodeProcess),
    /// All is reported.
    End(MasterTotals),
}

#[derive(Debug)]
pub(in crate::processes) struct Dispatcher {
    key: MacKey,
    /// From a tile's issue to its completion.
    tile_deadline: Duration,
    /// In order of node ids, from this one on.
    first_node: NodeId,
    /// Of each node.
    threads: u16,
    seats: Vec<Seat>,
    queue: VecDeque<TileGrant>,
    /// Nodes that can take a tile, one entry for each tile, longest waiting first.
    waiting: VecDeque<NodeId>,
    /// Tiles asked of the manager that have not come yet.
    asked: u32,
    totals: MasterTotals,
    /// Their completions are stale, should they arrive.
    lost: HashSet<LostAttempt>,
    actions: Vec<Action>,
}

impl Dispatcher {
    pub(in crate::processes) fn new(configuration: &MasterConfiguration) -> Self {
        Self {
            key: configuration.key,
            tile_deadline: Duration::from_millis(configuration.tile_deadline_milliseconds),
            first_node: configuration.first_node,
            threads: configuration.threads,
            seats: (0..configuration.nodes).map(|_| Seat::default()).collect(),
            queue: VecDeque::new(),
            waiting: VecDeque::new(),
            asked: 0,
            totals: MasterTotals::default(),
            lost: HashSet::new(),
            actions: Vec::new(),
        }
    }

    /// What is to be done about an event, in order. `now` is the time since any fixed moment.
    pub(in crate::processes) fn handle(&mut self, now: Duration, event: Event) -> Vec<Action> {
        match event {
            Event::Command(command) => self.obey(command),
            Event::Connected(process) => self.connected(process),
            Event::Disconnected(process) => self.disconnected(process),
            Event::Request(process, WorkRequest::Ready) => self.ready(process),
            Event::Request(process, WorkRequest::Done { done, receipt }) => self.done(process, done, receipt),
            Event::Refused(who) => self.incident(who),
            Event::Tick => self.report_late(now),
        }
        self.hand_out(now);
        self.give_back();
        self.ask();
        std::mem::take(&mut self.actions)
    }

    /// Tiles in the cluster's queue or with its nodes.
    pub(in crate::processes) fn tiles(&self) -> usize {
        self.queue.len() + self.seats.iter().map(|seat| seat.held.len()).sum::<usize>()
    }

    /// Requests that wait, and attempts whose completions would be stale.
    pub(in crate::processes) fn sizes(&self) -> [usize; 2] {
        [self.waiting.len(), self.lost.len()]
    }

    fn obey(&mut self, command: MasterCommand) {
        match command {
            MasterCommand::Heartbeat => {}
            MasterCommand::Configure(_) => self.incident("configured twice; the first one counts".to_owned()),
            MasterCommand::Tiles(grants) => {
                self.asked = self.asked.saturating_sub(grants.len() as u32);
                self.queue.extend(grants);
            }
            MasterCommand::NodeLost { node, epoch } => self.bury(NodeProcess { node, epoch }),
            MasterCommand::NodeSetAside { node } => {
                if let Some(place) = self.place(node) {
                    self.seats[place].set_aside = true;
                }
                self.queue.iter_mut().filter(|grant| grant.node == Some(node)).for_each(|grant| grant.node = None);
            }
            MasterCommand::Finish => self.finish(),
        }
    }

    fn connected(&mut self, process: NodeProcess) {
        let Some(place) = self.place(process.node) else { return };
        let Seat { epoch, dead, set_aside, .. } = self.seats[place];
        if epoch.is_some_and(|current| process.epoch <= current) || self.seats[place].is_dead(process.epoch) {
            return self.dismiss(process, "is dead, has a successor, or came twice");
        }
        // A process is replaced when it is dead only.
        if let Some(epoch) = epoch {
            self.lose(NodeProcess { epoch, ..process });
        }
        self.seats[place] = Seat { dead, set_aside, ..Seat::taken_by(process.epoch) };
    }

    fn disconnected(&mut self, process: NodeProcess) {
        if self.seat(process).is_some() {
            self.stop_waiting(process.node);
        }
    }

    fn ready(&mut self, process: NodeProcess) {
        let waiting = self.waiting.iter().filter(|&&node| node == process.node).count();
        let jobs_max = jobs_per_node(self.threads);
        let Some(seat) = self.seat(process).filter(|seat| !seat.is_dead(process.epoch)) else { return };
        if seat.held.len() + waiting >= jobs_max {
            return self.expose(process, format!("it asked for more than {jobs_max} tiles"));
        }
        self.waiting.push_back(process.node);
    }

    fn done(&mut self, process: NodeProcess, done: Box<TileDone>, receipt: Mac) {
        let NodeProcess { node, epoch } = process;
        let (tile, attempt) = (done.tile, done.attempt);
        if !self.key.is_receipt(Claim { tile, attempt, node, epoch }, receipt) {
            self.expose(process, format!("it reported {tile}, {attempt} without a receipt of the display"));
        } else if self.seat(process).is_some_and(|seat| seat.give_back(tile, attempt)) {
            self.totals.attempts_accepted += 1;
            self.actions.push(Action::Bus(MemoryRequest::Job { node, tile, attempt, bytes: END_OF_JOB_BYTES }));
            self.actions.push(Action::Report(MasterReport::Done { node, epoch, done }));
        } else if self.lost.remove(&LostAttempt { tile, attempt }) {
            // It was on its way when its node died.
            self.totals.attempts_lost -= 1;
            self.totals.attempts_stale += 1;
        } else {
            self.expose(process, format!("it reported {tile}, {attempt}, which it does not hold"));
        }
    }

    /// The manager says that the process is dead. What it said before may arrive only now.
    fn bury(&mut self, process: NodeProcess) {
        self.lose(process);
        if let Some(place) = self.place(process.node) {
            let dead = &mut self.seats[place].dead;
            *dead = (*dead).max(Some(process.epoch));
        }
    }

    /// The process is dead: what it held is lost.
    fn lose(&mut self, process: NodeProcess) {
        let Some(seat) = self.seat(process) else { return };
        let held = std::mem::take(&mut seat.held);
        self.stop_waiting(process.node);
        let lost = |Held { tile, attempt, .. }| LostAttempt { tile, attempt };
        let lost: Vec<_> = held.into_iter().map(lost).collect();
        if !lost.is_empty() {
            self.totals.attempts_lost += lost.len() as u64;
            self.lost.extend(&lost);
            self.actions.push(Action::Report(MasterReport::Lost(lost)));
        }
    }

    fn report_late(&mut self, now: Duration) {
        for (node, seat) in nodes_from(self.first_node).zip(&mut self.seats) {
            let Some(epoch) = seat.epoch else { continue };
            if let Some(tile) = seat.late_tile(now, self.tile_deadline) {
                self.actions.push(Action::Report(MasterReport::Late { node, epoch, tile }));
            }
            let is_idle = seat.announced
                && seat.held.is_empty()
                && !seat.is_dead(epoch)
                && !self.waiting.contains(&node)
                && self.queue.iter().any(|grant| may_trace(node, grant));
            if seat.is_overdue(is_idle, now, self.tile_deadline) {
                self.actions.push(Action::Report(MasterReport::Idle { node, epoch }));
            }
        }
    }

    fn finish(&mut self) {
        self.queue.clear();
        self.waiting.clear();
        for (node, place) in nodes_from(self.first_node).zip(0..self.seats.len()) {
            if let Some(epoch) = self.seats[place].epoch {
                self.lose(NodeProcess { node, epoch });
            }
        }
        self.actions.push(Action::End(self.totals));
    }

    /// Gives waiting nodes the first tile of the queue that each may trace.
    fn hand_out(&mut self, now: Duration) {
        let mut next = 0;
        while let Some(&node) = self.waiting.get(next) {
            let holds = |tile| self.place(node).is_some_and(|place| self.seats[place].holds(tile));
            let suits = |grant: &TileGrant| may_trace(node, grant) && !holds(grant.tile);
            let Some(grant) = self.queue.iter().position(suits).and_then(|place| self.queue.remove(place)) else {
                next += 1;
                continue;
            };
            self.waiting.remove(next);
            self.hand(now, node, grant);
        }
    }

    /// Grants that are for none of the nodes that are left.
    fn give_back(&mut self) {
        let (first, seats) = (self.first_node, &self.seats);
        let can_be_taken = |grant: &TileGrant| {
            let mut nodes = nodes_from(first).zip(seats);
            nodes.any(|(node, seat)| !seat.set_aside && may_trace(node, grant))
        };
        let returned: Vec<_> = self.queue.iter().filter(|grant| !can_be_taken(grant)).cloned().collect();
        if !returned.is_empty() {
            self.queue.retain(|grant| !returned.contains(grant));
            let returned = returned.into_iter().map(|grant| (grant.tile, grant.attempt)).collect();
            self.actions.push(Action::Report(MasterReport::Returned(returned)));
        }
    }

    fn hand(&mut self, now: Duration, node: NodeId, TileGrant { tile, attempt, .. }: TileGrant) {
        let Some(seat) = self.place(node).map(|place| &mut self.seats[place]) else { return };
        let Some(epoch) = seat.epoch else { return };
        seat.held.push(Held { tile, attempt, since: now });
        let announce = !std::mem::replace(&mut seat.announced, true);
        self.totals.attempts_issued += 1;
        self.actions.push(Action::Bus(MemoryRequest::Job { node, tile, attempt, bytes: JOB_BYTES }));
        let permit = self.key.permit(Claim { tile, attempt, node, epoch });
        self.actions.push(Action::Hand { to: NodeProcess { node, epoch }, tile, attempt, permit });
        if announce {
            self.actions.push(Action::Report(MasterReport::NodeReady { node, epoch }));
        }
    }

    /// Keeps ahead, so that no node waits for the manager.
    fn ask(&mut self) {
        let held: usize = self.seats.iter().map(|seat| seat.held.len()).sum();
        let have = (self.queue.len() + held) as u32 + self.asked;
        let room = (tiles_per_node(self.threads) * self.seats.len() as u32).saturating_sub(have);
        // Less than a node's, so that none waits for another's.
        if room >= tiles_per_node(self.threads) / 2 {
            self.asked += room;
            self.actions.push(Action::Report(MasterReport::TilesWanted(room)));
        }
    }

    /// The seat of a process as long as no successor sits there.
    fn seat(&mut self, process: NodeProcess) -> Option<&mut Seat> {
        let seat = self.place(process.node).map(|place| &mut self.seats[place]);
        seat.filter(|seat| seat.epoch == Some(process.epoch))
    }

    fn place(&self, node: NodeId) -> Option<usize> {
        let place = usize::from(node.0.checked_sub(self.first_node.0)?);
        (place < self.seats.len()).then_some(place)
    }

    fn stop_waiting(&mut self, node: NodeId) {
        self.waiting.retain(|&waiting| waiting != node);
    }

    /// The process did what no honest one does. What it holds is lost when it is dead.
    fn expose(&mut self, process: NodeProcess, why: String) {
        let NodeProcess { node, epoch } = process;
        self.actions.push(Action::Report(MasterReport::Forged { node, epoch, why }));
        self.hang_up(process);
    }

    fn dismiss(&mut self, process: NodeProcess, why: &str) {
        self.incident(format!("{process} {why}"));
        self.hang_up(process);
    }

    fn hang_up(&mut self, process: NodeProcess) {
        if self.seat(process).is_some() {
            self.stop_waiting(process.node);
        }
        self.actions.push(Action::Dismiss(process));
    }

    fn incident(&mut self, text: String) {
        self.actions.push(Action::Report(MasterReport::Incident(text)));
    }
}

/// Up to the last one that can be.
fn nodes_from(first: NodeId) -> impl Iterator<Item = NodeId> {
    (first.0..=u16::MAX).map(NodeId)
}

fn may_trace(node: NodeId, grant: &TileGrant) -> bool {
    grant.node.is_none_or(|only| only == node) && !grant.except.contains(&node)
}

#[cfg(test)]
#[path = "dispatcher_tests.rs"]
mod tests;
