//! The beginning of a run, played by hand.

use std::time::Duration;

use super::super::cause::Cause;
use super::super::event::{Action, Event};
use super::super::fixture;
use super::super::process::{Command, ProcessId, Report};
use super::State;
use crate::protocol::control::BusReport;
use crate::protocol::hello::Role;
use ground::ids::{ClusterId, NodeId};

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
    let (mut state, _) = State::start(fixture::plan(2, 4));
    assert_eq!(connects(&mut state, BUS), []);
    assert_eq!(connects(&mut state, Role::Node(NodeId(0))), []);
    assert_eq!(connects(&mut state, DISPLAY), [Action::Begin]);
    assert_eq!(happens(&mut state, 0, Event::Tick), [], "it is asked once");
    let mut roles = configured(&happens(&mut state, 0, Event::Begun(Ok(()))));
    roles.sort_by_key(|role| *role == BUS);
    assert_eq!(roles, [DISPLAY, BUS]);
    // A process that connects later is configured at once.
    happens(&mut state, 0, Event::Exited(ProcessId::first(DISPLAY), "died".to_owned()));
    let next = state.display.process();
    assert_eq!(configured(&happens(&mut state, 0, Event::Connected(next))), [DISPLAY]);
}

#[test]
fn a_run_that_cannot_begin_fails() {
    let (mut state, _) = State::start(fixture::plan(1, 4));
    connects(&mut state, DISPLAY);
    assert_eq!(connects(&mut state, BUS), [Action::Begin]);
    let actions = happens(&mut state, 0, Event::Begun(Err("out: Permission denied".to_owned())));
    assert_eq!(configured(&actions), []);
    assert_eq!(state.ending.cause(), Some(&Cause::Failed("out: Permission denied".to_owned())));
}

#[test]
fn a_bus_that_waits_for_a_display_is_not_late() {
    let mut plan = fixture::plan(1, 4);
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
    let (mut state, _) = State::start(fixture::plan(1, 4));
    connects(&mut state, BUS);
    let id = ProcessId::first(BUS);
    assert!(happens(&mut state, 0, Event::Report(id, failed())).contains(&Action::Kill(id)));
    assert!(state.ending.is_running());

    let (mut state, _) = State::start(fixture::plan(1, 4));
    connects(&mut state, BUS);
    connects(&mut state, DISPLAY);
    happens(&mut state, 0, Event::Begun(Ok(())));
    state.end(Cause::Complete);
    happens(&mut state, 0, Event::Report(id, failed()));
    let failed = Cause::Failed("the bus failed: cannot write bus.arrows: No space left".to_owned());
    assert_eq!(state.ending.cause(), Some(&failed));
}
