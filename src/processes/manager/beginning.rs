//! The way to the beginning of a run: bus and display are configured, and then write files, only when the run has begun
//! in earnest. Until then the output folder is as an earlier run left it.

use super::process::{Command, ProcessId, Stage};
use super::state::{Action, Phase, State};
use crate::protocol::hello::Role;

#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(super) enum Beginning {
    /// For the display and a bus to connect.
    #[default]
    Awaited,
    /// The shell was asked to begin.
    Asked,
    Begun,
}

impl State {
    /// Asks the shell to begin, once the display and a bus have connected.
    pub(super) fn begin_when_possible(&mut self) {
        if self.beginning != Beginning::Awaited {
            return;
        }
        let display = self.display_process();
        let has_display = self.table.iter().any(|process| process.id == display && process.stage == Stage::Connected);
        let has_bus = self.table.iter().any(|process| is_bus(process.id) && process.stage == Stage::Connected);
        let is_possible = match self.phase {
            Phase::Running => has_display && has_bus,
            // Without nodes; the display writes the image that there is.
            Phase::Ending(_) => has_display && self.is_ending_in_peace(),
            Phase::Over(_) => false,
        };
        if is_possible {
            self.beginning = Beginning::Asked;
            self.actions.push(Action::Begin);
        }
    }

    /// The shell has begun, or why it cannot.
    pub(super) fn begun(&mut self, outcome: Result<(), String>) {
        if let Err(why) = outcome {
            return self.fail(why);
        }
        self.beginning = Beginning::Begun;
        let waiting = self.table.iter().filter(|process| process.stage == Stage::Connected);
        let waiting: Vec<_> = waiting.map(|process| process.id).collect();
        waiting.into_iter().for_each(|id| self.configure_writer(id));
    }

    /// Configures a bus or a display that is connected, once the run has begun.
    pub(super) fn configure_writer(&mut self, id: ProcessId) {
        if self.beginning != Beginning::Begun {
            return;
        }
        match id.role {
            Role::Bus(cluster) => self.tell(id, Command::Bus(self.plan.configure_bus(cluster, id.epoch))),
            Role::Display => self.tell(id, Command::Display(self.plan.configure_display(id.epoch))),
            Role::Master(_) | Role::Node(_) | Role::Manager => {}
        }
    }

    /// Who is connected and waits for the beginning is not late.
    pub(super) fn wait_for_beginning(&mut self) {
        if self.beginning == Beginning::Awaited {
            self.table.excuse_connected(self.now);
        }
    }
}

fn is_bus(id: ProcessId) -> bool {
    matches!(id.role, Role::Bus(_))
}
