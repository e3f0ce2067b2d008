//! The display's place at the manager's table: one process after the other, each with the journal of all; and what
//! the display finds when it compares.

use std::net::SocketAddr;

use super::process::{Command, ProcessId, Stage};
use super::state::{FAILURES_MAX, Phase, State};
use super::verification::Verdict;
use crate::ids::{Epoch, NodeId, Producer, TileId};
use crate::protocol::control::{Comparison, DisplayCommand, Holdings, NodeCommand, Share, TileSet};
use crate::protocol::hello::Role;

#[derive(Debug, Default)]
pub(super) struct DisplayPlace {
    pub(super) epoch: Epoch,
    pub(super) address: Option<SocketAddr>,
    /// Since the last tile done.
    pub(super) failures: u32,
    /// Whether it has reported what it holds, and with that everything it found before; `None`: it was not asked since
    /// something changed.
    has_told_all: Option<bool>,
    /// The number of the latest question about what it has.
    pub(super) question: u32,
    /// What it held of each process when it reported last.
    pub(super) shares: Vec<Share>,
}

impl State {
    pub(super) fn display_process(&self) -> ProcessId {
        ProcessId { role: Role::Display, epoch: self.display.epoch }
    }

    pub(super) fn producer(&self, node: NodeId, epoch: Epoch) -> Producer {
        Producer { run: self.plan.id, node, epoch }
    }

    /// The display has read the journal.
    pub(super) fn restored(&mut self, holdings: &Holdings) {
        if self.display.epoch == Epoch(0) {
            self.ledger.resumed = self.queue.resume(|tile| holdings.tiles.contains(tile));
            for (tile, except) in self.verification.resume(holdings, self.queue.total()) {
                self.queue.check(tile, except);
            }
            return;
        }
        self.require(holdings, "the journal");
    }

    pub(super) fn display_listens(&mut self, id: ProcessId, address: SocketAddr) {
        self.enter(id, Stage::Serving);
        self.display.address = Some(address);
        let nodes = self.table.nodes().filter(|node| (Stage::Serving..Stage::Finished).contains(&node.stage));
        let nodes: Vec<_> = nodes.map(|node| node.id).collect();
        nodes.into_iter().for_each(|node| self.tell(node, Command::Node(NodeCommand::Display(address))));
        // Its predecessor may not have done what it was asked.
        let condemned: Vec<_> = self.verification.condemned().collect();
        condemned.into_iter().for_each(|process| self.ask_to_condemn(process));
        self.ask_for_comparisons();
        self.configure_nodes();
    }

    /// Tiles that are to be compared and that nobody renders are rendered once more.
    pub(super) fn ask_for_comparisons(&mut self) {
        let awaited: Vec<_> = self.verification.awaited().collect();
        for (tile, nodes) in awaited {
            if !self.queue.checks(tile) {
                self.queue.check(tile, nodes);
            }
        }
    }

    /// The display is dead: another one takes its place, unless too many have failed in a row.
    pub(super) fn display_exited(&mut self, how: String, was_expected: bool) {
        if was_expected {
            return;
        }
        (self.display.address, self.display.has_told_all) = (None, None);
        self.display.failures += 1;
        let is_needed = matches!(self.phase, Phase::Running) || self.is_ending_in_peace();
        if !is_needed || self.display.failures >= FAILURES_MAX {
            return self.fail(how);
        }
        self.ledger.incident(self.now, how);
        self.display.epoch.0 += 1;
        self.spawn(self.display_process());
    }

    /// Whether the display has reported what it holds since something changed, and with that everything that it compared.
    /// A tile may be done before the report of a comparison that came of it arrives.
    pub(super) fn has_told_all(&mut self) -> bool {
        if self.display.has_told_all.is_none() {
            self.display.has_told_all = Some(false);
            self.display.question += 1;
            let question = DisplayCommand::TellHoldings { question: self.display.question };
            self.tell(self.display_process(), Command::Display(question));
        }
        self.display.has_told_all == Some(true)
    }

    /// What the display reported last is not the end of it.
    pub(super) fn expect_more_of_display(&mut self) {
        self.display.has_told_all = None;
    }

    /// What is in the frame, compared with what is done: nothing is missing there because a process said so.
    pub(super) fn holds(&mut self, question: u32, holdings: Holdings) {
        if self.display.has_told_all.is_none() || question != self.display.question {
            // Asked before something changed.
            return;
        }
        self.display.has_told_all = Some(true);
        self.require(&holdings, "the display");
        self.display.shares = holdings.shares;
    }

    /// What is done and is not there is done again or, after the last tile, a failure.
    fn require(&mut self, holdings: &Holdings, place: &str) {
        let tiles = self.redo(|tile, _| !holdings.tiles.contains(tile));
        if tiles == 0 {
            return;
        }
        let lacking = format!("{place} lacks {tiles} tiles that were done");
        if self.is_completing() {
            return self.fail(lacking);
        }
        self.ledger.incident(self.now, format!("{lacking}: they are done again"));
    }

    /// Two results of a tile were compared.
    pub(super) fn compared(&mut self, comparison: &Comparison) {
        let tile = comparison.tile;
        if tile.0 >= self.queue.total() {
            return self.doom(self.display_process(), format!("compared {tile} of an image of {}", self.queue.total()));
        }
        match self.verification.judge(comparison) {
            Verdict::Agreed => {}
            Verdict::Again { except } => self.queue.settle(tile, except),
            Verdict::Dispute { except } => {
                let names: Vec<_> = except.iter().map(ToString::to_string).collect();
                self.ledger.incident(self.now, format!("{} disagree about {tile}", names.join(" and ")));
                self.queue.settle(tile, except);
                if self.is_completing() {
                    self.fail(format!("two results of {tile} differ, which was found after the last tile"));
                }
            }
            Verdict::Wrong(processes) => {
                for process in processes {
                    self.condemn(process, &format!("other nodes agree on other pixels of {tile}"));
                }
            }
        }
    }

    /// A process is wrong, or forges what it reports: it is ended, its node is quarantined, and all that it did is done
    /// again, whichever run it was part of.
    pub(super) fn condemn(&mut self, process: Producer, why: &str) {
        let Some(unvouched) = self.verification.condemn(process) else { return };
        unvouched.into_iter().for_each(|(tile, node)| self.queue.check(tile, vec![node]));
        self.ledger.forget(process);
        let tiles = self.redo(|_, by| by == Some(process));
        let Producer { run, node, epoch } = process;
        if run == self.plan.id {
            self.ledger.incident(
                self.now,
                format!("{node} ({epoch}) is condemned: {why}; its {tiles} tiles so far are done again"),
            );
            self.doom(ProcessId { role: Role::Node(node), epoch }, "was condemned".to_owned());
            self.set_aside(node, "it is condemned");
        } else {
            self.ledger.incident(
                self.now,
                format!("{node} ({epoch}) of an earlier run is condemned: {why}; its tiles are done again"),
            );
        }
        self.ask_to_condemn(process);
        if self.is_completing() {
            self.fail(format!("{node} ({epoch}) was condemned after the last tile: {why}"));
        }
    }

    /// Only the display knows all that it has of a process: a display that died may have kept pixels of which this manager
    /// knows nothing.
    fn ask_to_condemn(&mut self, process: Producer) {
        self.expect_more_of_display();
        self.tell(self.display_process(), Command::Display(DisplayCommand::Condemn(process)));
    }

    /// The display has taken these tiles of a condemned process out of the frame.
    pub(super) fn taken_out(&mut self, process: Producer, tiles: &TileSet) {
        if self.verification.is_condemned(process) {
            self.redo(|tile, _| tiles.contains(tile));
        }
    }

    /// Tiles that are done, and that `is_gone` chooses, are to be done again. How many there are.
    fn redo(&mut self, is_gone: impl Fn(TileId, Option<Producer>) -> bool) -> usize {
        let redone = self.queue.redo(is_gone);
        for &(tile, by) in &redone {
            self.verification.forget(tile);
            self.ledger.take_back(by);
        }
        redone.len()
    }
}
