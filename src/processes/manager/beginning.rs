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

    /// A process that is connected and waits for the beginning is not late.
    pub(super) fn wait_for_beginning(&mut self) {
        if self.beginning == Beginning::Awaited {
            self.table.excuse_connected(self.now);
        }
    }
}

fn is_bus(id: ProcessId) -> bool {
    matches!(id.role, Role::Bus(_))
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::super::ending::Cause;
    use super::super::process::Report;
    use super::super::sample;
    use super::super::state::Event;
    use super::*;
    use crate::ids::{ClusterId, NodeId};
    use crate::protocol::control::BusReport;

    const DISPLAY: Role = Role::Display;
    const BUS: Role = Role::Bus(ClusterId(0));

    fn happens(state: &mut State, second: u64, event: Event) -> Vec<Action> {
        state.handle(Duration::from_secs(second), event)
    }

    fn connects(state: &mut State, role: Role) -> Vec<Action> {
        happens(state, 0, Event::Connected(ProcessId::first(role)))
    }

    fn configured(actions: &[Action]) -> Vec<Role> {
        let told = actions.iter().filter_map(|action| match action {
            Action::Tell(id, Command::Bus(_) | Command::Display(_)) => Some(id.role),
            _ => None,
        });
        told.collect()
    }

    #[test]
    fn processes_that_write_files_are_configured_when_the_run_has_begun() {
        let (mut state, _) = State::start(sample::plan(2, 4));
        assert_eq!(connects(&mut state, BUS), []);
        assert_eq!(connects(&mut state, Role::Node(NodeId(0))), []);
        assert_eq!(connects(&mut state, DISPLAY), [Action::Begin]);
        assert_eq!(happens(&mut state, 0, Event::Tick), [], "it is asked once");
        let mut roles = configured(&happens(&mut state, 0, Event::Begun(Ok(()))));
        roles.sort_by_key(|role| *role == BUS);
        assert_eq!(roles, [DISPLAY, BUS]);
        // A process that connects later is configured at once.
        happens(&mut state, 0, Event::Exited(ProcessId::first(DISPLAY), "died".to_owned()));
        let next = state.display_process();
        assert_eq!(configured(&happens(&mut state, 0, Event::Connected(next))), [DISPLAY]);
    }

    #[test]
    fn a_run_that_cannot_begin_fails() {
        let (mut state, _) = State::start(sample::plan(1, 4));
        connects(&mut state, DISPLAY);
        assert_eq!(connects(&mut state, BUS), [Action::Begin]);
        let actions = happens(&mut state, 0, Event::Begun(Err("out: Permission denied".to_owned())));
        assert_eq!(configured(&actions), []);
        let why = match &state.phase {
            Phase::Ending(ending) => ending.cause.clone(),
            phase => panic!("{phase:?}"),
        };
        assert_eq!(why, Cause::Failed("out: Permission denied".to_owned()));
    }

    #[test]
    fn a_bus_that_waits_for_a_display_is_not_late() {
        let mut plan = sample::plan(1, 4);
        plan.run.deadlines.heartbeat = Duration::from_secs(1000);
        // Longer than the deadline of a start.
        plan.run.deadlines.startup = Duration::from_secs(10);
        let (mut state, _) = State::start(plan);
        connects(&mut state, BUS);
        for second in 1..9 {
            assert_eq!(happens(&mut state, second, Event::Tick), []);
        }
        assert!(connects(&mut state, DISPLAY).contains(&Action::Begin));
        happens(&mut state, 9, Event::Begun(Ok(())));
        let killed = happens(&mut state, 12, Event::Tick);
        assert!(!killed.contains(&Action::Kill(ProcessId::first(BUS))), "{killed:?}");
    }

    #[test]
    fn a_bus_that_cannot_close_its_recording_fails_the_run_and_one_that_fails_before_is_replaced() {
        let failed = || Report::Bus(BusReport::Failed("cannot write bus.arrows: No space left".to_owned()));
        let (mut state, _) = State::start(sample::plan(1, 4));
        connects(&mut state, BUS);
        let id = ProcessId::first(BUS);
        assert!(happens(&mut state, 0, Event::Report(id, failed())).contains(&Action::Kill(id)));
        assert!(matches!(state.phase, Phase::Running));

        let (mut state, _) = State::start(sample::plan(1, 4));
        connects(&mut state, BUS);
        connects(&mut state, DISPLAY);
        happens(&mut state, 0, Event::Begun(Ok(())));
        state.end(Cause::Complete);
        happens(&mut state, 0, Event::Report(id, failed()));
        let Phase::Ending(ending) = &state.phase else { panic!("{:?}", state.phase) };
        assert_eq!(ending.cause, Cause::Failed("the bus failed: cannot write bus.arrows: No space left".to_owned()));
    }
}
