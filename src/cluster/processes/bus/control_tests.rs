//! A bus's control conversation, event by event.

use super::*;
use ground::ids::{Attempt, ClusterId, TileId};
use machine::hardware::specification::Arbiter;
use trace::database::{Layout, Section};

const BEGIN: Duration = Duration::from_secs(100);

fn configuration(folder: &str) -> BusConfiguration {
    BusConfiguration {
        cluster: ClusterId(0),
        arbiter: Arbiter::Fifo,
        layout: Layout::new([8; Section::COUNT]).expect("small"),
        recording: folder.into(),
    }
}

fn configure(folder: &str) -> Event {
    Event::Command(BusCommand::Configure(configuration(folder)))
}

fn lost() -> Vec<LostAttempt> {
    vec![LostAttempt { tile: TileId(3), attempt: Attempt(1) }]
}

fn finish() -> Event {
    Event::Command(BusCommand::Finish { lost: lost() })
}

fn totals() -> BusTotals {
    BusTotals { fetches: 7, ..BusTotals::default() }
}

fn at(state: &mut Control, seconds: u64, event: Event) -> Vec<Action> {
    state.handle(BEGIN + Duration::from_secs(seconds), event)
}

/// The last report and the outcome, where nothing else is done.
fn end(actions: &[Action]) -> Option<(&BusReport, &Result<(), String>)> {
    match actions {
        [Action::Report(report), Action::End(outcome)] => Some((report, outcome)),
        _ => None,
    }
}

fn reported(actions: &[Action]) -> &BusReport {
    match actions {
        [Action::Report(report)] => report,
        _ => panic!("one report alone, not {} actions", actions.len()),
    }
}

fn serving() -> Control {
    let mut state = Control::default();
    let actions = at(&mut state, 0, configure("recording"));
    let [Action::Task(Task::Serve(served)), Action::Listen(Admission::BusClients)] = &actions[..] else {
        panic!("the memory is there before a client may come")
    };
    assert_eq!(*served, configuration("recording"));
    let address = ([127, 0, 0, 1], 5).into();
    assert_eq!(*reported(&at(&mut state, 1, Event::Listening(address))), BusReport::Listening(address));
    state
}

fn finishing() -> Control {
    let mut state = serving();
    assert_eq!(state.next_deadline(), None, "it serves for as long as the run takes");
    let actions = at(&mut state, 2, finish());
    assert!(matches!(&actions[..], [Action::Task(Task::Finish { lost: told })] if *told == lost()));
    state
}

fn over() -> Control {
    let mut state = finishing();
    let actions = at(&mut state, 3, Event::Answer(Answer::Ended(Ok(totals()))));
    assert_eq!(end(&actions), Some((&BusReport::Finished(totals()), &Ok(()))));
    state
}

fn failed(actions: &[Action]) -> &str {
    match end(actions) {
        Some((BusReport::Failed(why), Err(outcome))) if why == outcome => why,
        _ => panic!("it does not fail"),
    }
}

#[test]
fn a_bus_serves_finishes_and_ends_with_its_totals_and_nothing_after_them() {
    let mut state = over();
    assert_eq!(state.next_deadline(), None);
    let address = ([127, 0, 0, 1], 5).into();
    let failure = || Event::Answer(Answer::Ended(Err("late".to_owned())));
    for event in [configure("other"), finish(), Event::Listening(address), failure(), Event::Failed("late".to_owned())]
    {
        assert!(at(&mut state, 4, event).is_empty());
    }
    assert!(at(&mut state, 4000, Event::Deadline).is_empty());
}

#[test]
fn a_bus_that_was_not_configured_has_nothing_to_report() {
    let mut state = Control::default();
    let address = ([127, 0, 0, 1], 5).into();
    assert!(at(&mut state, 0, Event::Listening(address)).is_empty(), "it was not asked to listen");
    assert!(at(&mut state, 0, Event::Terminate).is_empty());
    assert_eq!(end(&at(&mut state, 1, finish())), Some((&BusReport::Finished(BusTotals::default()), &Ok(()))));
}

#[test]
fn a_second_configuration_is_an_incident_in_every_phase() {
    for mut state in [serving(), finishing()] {
        let actions = at(&mut state, 3, configure("other"));
        let BusReport::Incident(text) = reported(&actions) else { panic!("an incident") };
        assert_eq!(text, "configured twice: the second is not heeded");
    }
}

#[test]
fn incidents_and_refusals_are_reported_as_they_come() {
    for mut state in [Control::default(), serving(), finishing()] {
        for event in [Event::Refused("a guest".to_owned()), Event::Answer(Answer::Incident("a guest".to_owned()))] {
            assert_eq!(*reported(&at(&mut state, 3, event)), BusReport::Incident("a guest".to_owned()));
        }
    }
}

#[test]
fn a_recording_that_is_not_closed_within_60_s_is_a_failure() {
    let mut state = finishing();
    let deadline = BEGIN + Duration::from_secs(2) + FINISH_DEADLINE;
    assert_eq!(state.next_deadline(), Some(deadline));
    assert!(state.handle(deadline - Duration::from_nanos(1), Event::Deadline).is_empty());
    // A second request does not put it off.
    assert!(at(&mut state, 30, finish()).is_empty());
    assert_eq!(state.next_deadline(), Some(deadline));
    assert_eq!(failed(&state.handle(deadline, Event::Deadline)), "the recording was not closed within 60 s");
    assert!(at(&mut state, 63, Event::Answer(Answer::Ended(Ok(totals())))).is_empty(), "too late");
}

#[test]
fn a_memory_loop_that_ends_by_itself_ends_the_bus_even_without_an_error() {
    let actions = at(&mut serving(), 2, Event::Answer(Answer::Ended(Ok(totals()))));
    assert_eq!(failed(&actions), "the thread that owns the memory connections has ended");
    for mut state in [serving(), finishing()] {
        let actions = at(&mut state, 3, Event::Answer(Answer::Ended(Err("no space left".to_owned()))));
        assert_eq!(failed(&actions), "no space left");
        assert_eq!(state.next_deadline(), None);
    }
}

#[test]
fn what_the_worker_or_the_port_cannot_do_ends_the_bus_in_every_phase() {
    for mut state in [Control::default(), serving(), finishing()] {
        assert_eq!(
            failed(&at(&mut state, 3, Event::Failed("recording: not a folder".to_owned()))),
            "recording: not a folder"
        );
        assert!(at(&mut state, 4, Event::Failed("again".to_owned())).is_empty());
    }
}
