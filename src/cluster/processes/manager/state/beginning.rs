//! The way to the beginning of a run: bus and display are configured, and then write files, only when the run has begun
//! in earnest. Until then the output folder is as an earlier run left it.

use super::super::event::Action;
use super::super::process::{Command, ProcessId, Stage};
use super::display::Display;
use super::ending::Ending;
use super::supervision::Supervision;
use crate::protocol::hello::Role;

#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(crate) enum Beginning {
    /// For the display and a bus to connect.
    #[default]
    Awaited,
    /// The shell was asked to begin.
    Asked,
    Begun,
}

impl Beginning {
    /// Asks the shell to begin, once the display and a bus have connected; without nodes once the display has, which writes
    /// the image that there is.
    pub(super) fn advance(&mut self, display: &Display, ending: &Ending, supervision: &mut Supervision) {
        if *self != Self::Awaited {
            return;
        }
        let is_connected = |chosen: &dyn Fn(ProcessId) -> bool| {
            supervision.table.iter().any(|process| chosen(process.id) && process.stage == Stage::Connected)
        };
        let has_bus = || is_connected(&|id| matches!(id.role, Role::Bus(_)));
        let is_possible = ending.is_orderly() || (ending.is_running() && has_bus());
        if is_possible && is_connected(&|id| id == display.process()) {
            *self = Self::Asked;
            supervision.actions.push(Action::Begin);
        }
    }

    /// The shell has begun.
    pub(super) fn begun(&mut self, supervision: &mut Supervision) {
        *self = Self::Begun;
        for id in supervision.those(|process| process.stage == Stage::Connected) {
            self.configure_writer(id, supervision);
        }
    }

    /// Configures a bus or a display that is connected, once the run has begun.
    pub(super) fn configure_writer(self, id: ProcessId, supervision: &mut Supervision) {
        if self != Self::Begun {
            return;
        }
        let command = match id.role {
            Role::Bus(cluster) => Command::Bus(supervision.plan.configure_bus(cluster, id.epoch)),
            Role::Display => Command::Display(supervision.plan.configure_display(id.epoch)),
            Role::Master(_) | Role::Node(_) | Role::Manager => return,
        };
        supervision.tell(id, command);
    }

    /// A process that is connected and waits for the beginning is not late.
    pub(super) fn tick(self, supervision: &mut Supervision) {
        if self == Self::Awaited {
            supervision.table.excuse_connected(supervision.now);
        }
    }
}
