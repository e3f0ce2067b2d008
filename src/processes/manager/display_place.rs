//! The display's place at the manager's table: one process after the other, each with the journal of all; and what
//! the display finds when it compares.

use std::net::SocketAddr;

use super::process::{Command, ProcessId, Stage};
use super::state::{FAILURES_MAX, Phase, State};
use super::verification::{Producer, Verdict};
use crate::ids::{Epoch, TileId};
use crate::protocol::control::{Comparison, DisplayCommand, NodeCommand, REVOCATIONS_MAX, Revocation};
use crate::protocol::hello::Role;

#[derive(Debug, Default)]
pub(super) struct DisplayPlace {
    pub(super) epoch: Epoch,
    pub(super) address: Option<SocketAddr>,
    /// Since the last tile done.
    pub(super) failures: u32,
    /// Whether it has told all comparisons of tiles that are done; `None`: it was not asked.
    told_all: Option<bool>,
}

impl State {
    pub(super) fn display_process(&self) -> ProcessId {
        ProcessId { role: Role::Display, epoch: self.display.epoch }
    }

    /// The display has read the journal: a bit a tile.
    pub(super) fn restored(&mut self, tiles: &[u8]) {
        let has = |tile| is_set(tiles, tile);
        if self.display.epoch == Epoch(0) {
            self.ledger.resumed = self.queue.resume(has);
            return;
        }
        let lost = self.queue.redo(has);
        if !lost.is_empty() {
            let count = lost.len();
            lost.into_iter().for_each(|tile_of| self.ledger.take_back(tile_of));
            self.ledger
                .incident(self.now, format!("the journal lacks {count} tiles that were done: they are done again"));
        }
    }

    pub(super) fn display_listens(&mut self, id: ProcessId, address: SocketAddr) {
        self.enter(id, Stage::Serving);
        self.display.address = Some(address);
        let nodes = self.table.nodes().filter(|node| (Stage::Serving..Stage::Finished).contains(&node.stage));
        let nodes: Vec<_> = nodes.map(|node| node.id).collect();
        nodes.into_iter().for_each(|node| self.tell(node, Command::Node(NodeCommand::Display(address))));
        // What its predecessor was asked, it may not have done.
        let unconfirmed = self.queue.unconfirmed();
        self.tell_to_forget(&unconfirmed);
        let condemned: Vec<_> = self.verification.condemned().collect();
        condemned.into_iter().for_each(|process| self.ask_for_tiles_of(process));
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
        (self.display.address, self.display.told_all) = (None, None);
        self.display.failures += 1;
        let is_needed = matches!(self.phase, Phase::Running) || self.is_ending_in_peace();
        if !is_needed || self.display.failures >= FAILURES_MAX {
            return self.fail(how);
        }
        self.ledger.incident(self.now, how);
        self.display.epoch.0 += 1;
        self.spawn(self.display_process());
    }

    /// Whether the display has nothing more to tell of what it compared. A tile may be done before the comparison
    /// arrives that came of it: what is told after it is asked to forget nothing is told after all of those.
    pub(super) fn has_told_all(&mut self) -> bool {
        if !self.verification.is_in_force() {
            return true;
        }
        if self.display.told_all.is_none() {
            self.display.told_all = Some(false);
            self.tell(self.display_process(), Command::Display(DisplayCommand::Revoke(Vec::new())));
        }
        self.display.told_all == Some(true)
    }

    /// Tiles are missing: whatever was told, more will be compared.
    pub(super) fn expect_comparisons(&mut self) {
        self.display.told_all = None;
    }

    /// The display has forgotten these.
    pub(super) fn revoked(&mut self, revocations: &[Revocation]) {
        revocations.iter().for_each(|revocation| self.queue.forgotten(revocation.tile));
        if let (true, Some(told_all)) = (revocations.is_empty(), &mut self.display.told_all) {
            *told_all = true;
        }
    }

    /// Two results of a tile were held against each other.
    pub(super) fn compared(&mut self, comparison: &Comparison) {
        let tile = comparison.tile;
        if tile.0 >= self.queue.total() {
            return self.doom(self.display_process(), format!("compared {tile} of an image of {}", self.queue.total()));
        }
        if !matches!(self.phase, Phase::Running) {
            // Nobody is left to do anything again.
            if comparison.kept.digest != comparison.other.digest {
                self.ledger.incident(self.now, format!("two results of {tile} differ, as was found when all was over"));
            }
            return;
        }
        let Some(kept_by) = comparison.kept.source.or_else(|| self.queue.producer(tile)) else {
            if comparison.kept.digest != comparison.other.digest {
                self.ledger.incident(self.now, format!("{tile} of the journal differs from what is rendered now"));
            }
            return;
        };
        match self.verification.judge(comparison, kept_by) {
            Verdict::Agreed => {}
            Verdict::Dispute { except } => {
                let names: Vec<_> = except.iter().map(ToString::to_string).collect();
                self.ledger.incident(self.now, format!("{} disagree about {tile}", names.join(" and ")));
                self.queue.check(tile, except);
            }
            Verdict::Wrong(processes) => {
                for process in processes {
                    self.condemn(process, tile, process == kept_by);
                }
            }
        }
    }

    /// A process rendered a tile wrongly: it is ended, its node set aside, and all it did is done again.
    fn condemn(&mut self, process: Producer, tile: TileId, was_kept: bool) {
        let (node, epoch) = process;
        let mut tiles = self.queue.tiles_by(process);
        if was_kept && !tiles.contains(&tile) {
            tiles.push(tile);
        }
        if self.verification.condemn(process, &tiles) {
            let count = tiles.len();
            self.ledger.forget(process);
            self.ledger.incident(
                self.now,
                format!("{node} ({epoch}) is corrupt: others agree on other pixels of {tile}; its {count} tiles are done again"),
            );
            self.doom(ProcessId { role: Role::Node(node), epoch }, "was corrupt".to_owned());
            self.set_aside(node, "it is corrupt");
        }
        self.revoke(&tiles);
        self.ask_for_tiles_of(process);
    }

    /// The display may hold a condemned process' pixels of a tile that counts as another one's: a display that died has
    /// compared the two, and did not tell.
    fn ask_for_tiles_of(&mut self, (node, epoch): Producer) {
        self.expect_comparisons();
        self.tell(self.display_process(), Command::Display(DisplayCommand::TilesOf(node, epoch)));
    }

    /// The display holds these tiles of a process.
    pub(super) fn holds_of(&mut self, process: Producer, tiles: &[u8]) {
        if !matches!(self.phase, Phase::Running) || !self.verification.is_condemned(process) {
            return;
        }
        let tiles: Vec<_> = (0..self.queue.total()).map(TileId).filter(|&tile| is_set(tiles, tile)).collect();
        self.revoke(&tiles);
    }

    /// These tiles are to be done again.
    pub(super) fn revoke(&mut self, tiles: &[TileId]) {
        for &tile in tiles {
            // The frame's pixels of a tile and those that were counted may be two processes'.
            if self.queue.accepted(tile).is_some() {
                self.ledger.take_back(self.queue.producer(tile));
            }
        }
        let revocations: Vec<_> = tiles.iter().filter_map(|&tile| self.queue.revoke(tile)).collect();
        self.tell_to_forget(&revocations);
    }

    fn tell_to_forget(&mut self, revocations: &[Revocation]) {
        let display = self.display_process();
        for some in revocations.chunks(REVOCATIONS_MAX) {
            self.tell(display, Command::Display(DisplayCommand::Revoke(some.to_vec())));
        }
    }
}

/// Of a bit a tile.
fn is_set(tiles: &[u8], tile: TileId) -> bool {
    tiles.get(tile.0 as usize / 8).is_some_and(|byte| byte >> (tile.0 % 8) & 1 == 1)
}
