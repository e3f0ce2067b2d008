//! The display: one process after the other, each with the journal of all.

use std::net::SocketAddr;
use std::time::Duration;

use super::super::process::{Command, ProcessId, Stage};
use super::process_table::seconds;
use super::supervision::{Exit, FAILURES_MAX, Supervision};
use crate::protocol::control::{DisplayCommand, NodeCommand, Share};
use crate::protocol::hello::Role;
use ground::ids::{Epoch, Producer};

#[derive(Debug, Default)]
pub(crate) struct Display {
    pub(super) epoch: Epoch,
    pub(crate) address: Option<SocketAddr>,
    /// Since the last tile done.
    pub(super) failures: u32,
    /// Whether this process has reported what it restored.
    has_restored: bool,
    /// Whether it has reported what it holds, and with that everything it found before; `None`: it was not asked since
    /// something changed.
    has_told_all: Option<bool>,
    /// The number of the latest question about what it has, and when it was asked.
    pub(crate) question: u32,
    asked: Duration,
    /// What it held of each process when it reported last.
    pub(crate) shares: Vec<Share>,
}

impl Display {
    pub(super) fn process(&self) -> ProcessId {
        ProcessId { role: Role::Display, epoch: self.epoch }
    }

    fn tell(&self, command: DisplayCommand, supervision: &mut Supervision) {
        supervision.tell(self.process(), Command::Display(command));
    }

    /// Nodes that know its predecessor's address get its own.
    pub(super) fn listens(&mut self, id: ProcessId, address: SocketAddr, supervision: &mut Supervision) {
        supervision.enter(id, Stage::Serving);
        self.address = Some(address);
        let is_configured = |stage| (Stage::Serving..Stage::Finished).contains(&stage);
        for node in supervision.those(|process| process.id.node().is_some() && is_configured(process.stage)) {
            supervision.tell(node, Command::Node(NodeCommand::Display(address)));
        }
    }

    /// It reports what it restored. `false`: not for the first time.
    pub(super) fn restores(&mut self) -> bool {
        !std::mem::replace(&mut self.has_restored, true)
    }

    /// It is dead: another one takes its place.
    ///
    /// # Errors
    /// It is not needed any more, or too many have failed in a row: how it ended is why the run fails.
    pub(super) fn exited(&mut self, exit: Exit, is_needed: bool, supervision: &mut Supervision) -> Result<(), String> {
        if exit.was_expected {
            return Ok(());
        }
        (self.address, self.has_told_all, self.has_restored) = (None, None, false);
        self.failures += 1;
        if !is_needed || self.failures >= FAILURES_MAX {
            return Err(exit.how);
        }
        supervision.incident(exit.how);
        self.epoch.0 += 1;
        supervision.spawn(self.process());
        Ok(())
    }

    /// Whether the display has reported what it holds since something changed, and with that everything that it compared;
    /// it is asked if it was not. A tile may be done before the report of a comparison that came of it arrives.
    pub(super) fn has_told_all(&mut self, supervision: &mut Supervision) -> bool {
        if self.has_told_all.is_none() {
            self.has_told_all = Some(false);
            self.question += 1;
            self.asked = supervision.now;
            self.tell(DisplayCommand::TellHoldings { question: self.question }, supervision);
        }
        self.has_told_all == Some(true)
    }

    /// Kills a display that leaves the question about what it holds unanswered.
    pub(super) fn tick(&self, supervision: &mut Supervision) {
        let deadline = supervision.plan.run.deadlines.tile;
        if self.has_told_all == Some(false) && supervision.now.saturating_sub(self.asked) > deadline {
            let why = format!("did not report what it holds for more than {}", seconds(deadline));
            supervision.kill_unless_killed(self.process(), why);
        }
    }

    /// What the display reported last is not the end of it.
    pub(super) fn expect_more(&mut self) {
        self.has_told_all = None;
    }

    /// It has reported what it holds. `false`: it was asked before something changed.
    pub(super) fn answers(&mut self, question: u32) -> bool {
        let is_latest = self.has_told_all.is_some() && question == self.question;
        if is_latest {
            self.has_told_all = Some(true);
        }
        is_latest
    }

    /// Only the display knows all that it has of a process: a display that died may have kept pixels of which this manager
    /// knows nothing.
    pub(super) fn condemn(&mut self, process: Producer, supervision: &mut Supervision) {
        self.expect_more();
        self.tell(DisplayCommand::Condemn(process), supervision);
    }
}
