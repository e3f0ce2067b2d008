//! The processes that are not known to be dead, what is said to them, and what went wrong. Every machine of the state acts
//! through it: it collects the actions of an event, in order.

use std::time::Duration;

use super::super::event::Action;
use super::super::plan::Plan;
use super::super::process::{Command, Process, ProcessId, Stage};
use super::incident_log::IncidentLog;
use super::process_table::ProcessTable;

/// A node or a cluster is set aside, and a run without a display fails, after so many failures without a tile done in
/// between.
pub(super) const FAILURES_MAX: u32 = 3;
/// More incidents of one process are counted, not kept.
const PROCESS_INCIDENTS_MAX: u32 = 100;

#[derive(Debug)]
pub(crate) struct Supervision {
    pub(crate) plan: Plan,
    pub(crate) table: ProcessTable,
    pub(crate) incidents: IncidentLog,
    /// Of the event that is dealt with, since the run began.
    pub(crate) now: Duration,
    pub(super) actions: Vec<Action>,
}

/// A process that is confirmed dead.
pub(super) struct Exit {
    pub(super) id: ProcessId,
    /// What became of it, as a sentence.
    pub(super) how: String,
    /// It had reported for the last time.
    pub(super) was_expected: bool,
    /// It went as it was asked to.
    pub(super) left: bool,
}

impl Supervision {
    pub(super) fn new(plan: Plan) -> Self {
        Self {
            plan,
            table: ProcessTable::default(),
            incidents: IncidentLog::default(),
            now: Duration::ZERO,
            actions: Vec::new(),
        }
    }

    /// The processes that are chosen.
    pub(super) fn those(&self, chosen: impl Fn(&Process) -> bool) -> Vec<ProcessId> {
        self.table.iter().filter(|process| chosen(process)).map(|process| process.id).collect()
    }

    pub(super) fn spawn(&mut self, id: ProcessId) {
        let connect_deadline = Some(self.plan.connect_deadline(id.role));
        self.table.insert(Process { connect_deadline, ..Process::spawned(id, self.now) });
        self.actions.push(Action::Spawn(id));
    }

    pub(super) fn is_at(&self, id: ProcessId, stage: Stage) -> bool {
        self.table.iter().any(|process| process.id == id && process.stage == stage)
    }

    pub(super) fn enter(&mut self, id: ProcessId, stage: Stage) {
        let now = self.now;
        if let Some(process) = self.table.get_mut(id) {
            process.enter(stage, now);
        }
    }

    /// Kills a process; its place is free when it is confirmed dead.
    pub(super) fn kill(&mut self, id: ProcessId, why: String) {
        if let Some(process) = self.table.get_mut(id) {
            process.killed.get_or_insert(why);
            self.actions.push(Action::Kill(id));
        }
    }

    /// The same, for what is found at every tick.
    pub(super) fn kill_unless_killed(&mut self, id: ProcessId, why: String) {
        if self.table.get_mut(id).is_some_and(|process| process.killed.is_none()) {
            self.kill(id, why);
        }
    }

    /// Ends a process that is not needed any more.
    pub(super) fn dismiss(&mut self, id: ProcessId) {
        self.enter(id, Stage::Finished);
        self.kill(id, "was ended with the run".to_owned());
    }

    /// A process that is not connected, or was killed, gets no commands.
    pub(super) fn tell(&mut self, id: ProcessId, command: Command) {
        if self.table.get_mut(id).is_some_and(|process| process.can_be_told()) {
            self.actions.push(Action::Tell(id, command));
        }
    }

    /// What went wrong and was dealt with.
    pub(crate) fn incident(&mut self, text: impl AsRef<str>) {
        self.incidents.add(self.now, text);
    }

    /// An incident that a process reported.
    pub(super) fn reported(&mut self, id: ProcessId, text: &str) {
        let Some(process) = self.table.get_mut(id) else { return };
        process.incidents = process.incidents.saturating_add(1);
        match process.incidents {
            ..PROCESS_INCIDENTS_MAX => self.incident(format!("{id}: {text}")),
            PROCESS_INCIDENTS_MAX => {
                self.incident(format!("{id}: {text} (its further incidents are counted only)"));
            }
            _ => self.incidents.drop_one(),
        }
    }

    pub(super) fn connected(&mut self, id: ProcessId) -> bool {
        let now = self.now;
        let Some(process) = self.table.get_mut(id) else { return false };
        process.enter(Stage::Connected, now);
        process.last_sign = now;
        true
    }

    pub(super) fn disconnected(&mut self, id: ProcessId, nonsense: Option<String>) {
        let now = self.now;
        let Some(process) = self.table.get_mut(id) else { return };
        process.hung_up = Some(now);
        self.actions.push(Action::HangUp(id));
        if let Some(nonsense) = nonsense {
            self.kill(id, format!("broke the protocol: {nonsense}"));
        }
    }

    /// `how`: as the rest of a sentence that begins with its name.
    pub(super) fn exited(&mut self, id: ProcessId, how: String) -> Option<Exit> {
        let process = self.table.remove(id)?;
        self.actions.push(Action::HangUp(id));
        let left = process.leaving;
        let how = if left { "left, as it was asked to".to_owned() } else { process.killed.unwrap_or(how) };
        Some(Exit { id, how: format!("{id} {how}"), was_expected: process.stage == Stage::Finished, left })
    }

    pub(super) fn kill_overdue(&mut self) {
        for (id, why) in self.table.overdue(self.now, &self.plan.run.deadlines) {
            self.kill(id, why);
        }
    }
}
