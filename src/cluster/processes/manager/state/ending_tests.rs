//! How a run ends, event by event.

use std::time::Duration;

use super::super::cause::{Cause, Interrupt};
use super::super::event::{Action, Event};
use super::super::process::Report;
use super::tests::*;
use crate::protocol::control::{BusReport, DisplayReport, NodeReport};
use ground::ids::{Attempt, TileId};
use machine::hardware::totals::{BusTotals, LostAttempt};

#[test]
fn an_interrupted_run_is_over_in_time_whoever_hangs() {
    let mut stage = Stage::running(1, 4);
    assert!(stage.happens(Event::Signal(Interrupt::Sigint)).contains(&Action::Kill(node(0, 0))));
    let interrupted = stage.now;
    stage.exits(node(0, 0));
    // Nobody answers any more, not even to being killed.
    while stage.state.over().is_none() {
        stage.now += Duration::from_millis(100);
        stage.happens(Event::Tick);
        assert!(stage.now < interrupted + Duration::from_millis(2500));
    }
    assert_eq!(stage.state.over(), Some(&Cause::Interrupted(Interrupt::Sigint)));
}

#[test]
fn an_interrupted_run_kills_a_master_that_hangs_and_keeps_the_image() {
    let mut stage = Stage::running(1, 4);
    stage.happens(Event::Signal(Interrupt::Sigterm));
    let interrupted = stage.now;
    stage.exits(node(0, 0));
    let mut killed = Vec::new();
    while !killed.contains(&Action::Kill(MASTER)) {
        stage.now += Duration::from_millis(100);
        killed = stage.happens(Event::Tick);
    }
    assert!(stage.now <= interrupted + Duration::from_millis(1700));
    // What it had handed out and did not live to tell the end of.
    let open = (0..4).map(|tile| LostAttempt { tile: TileId(tile), attempt: Attempt(0) });
    let actions = stage.exits(MASTER);
    assert!(actions.contains(&finish_bus(open.collect())), "{actions:?}");
    assert!(actions.contains(&stage.question()), "the display ends after the master: {actions:?}");
    assert_eq!(stage.holds([false; 4]), [finish_display()]);
}

#[test]
fn a_second_signal_kills_everybody_at_once() {
    let mut stage = Stage::running(1, 4);
    stage.happens(Event::Signal(Interrupt::Sigint));
    let actions = stage.happens(Event::Signal(Interrupt::Sigint));
    for id in [BUS, MASTER, DISPLAY, node(0, 0)] {
        assert!(actions.contains(&Action::Kill(id)), "{id}");
    }
    stage.all_exit(&[BUS, MASTER, DISPLAY, node(0, 0)]);
    assert_eq!(stage.state.over(), Some(&Cause::Interrupted(Interrupt::Sigint)));
}

#[test]
fn a_server_that_does_not_close_its_books_is_named_and_the_image_is_whole() {
    let mut stage = Stage::running(1, 1);
    stage.done(0, 0, 0);
    stage.holds([true]);
    stage.happens(Event::Report(node(0, 0), Report::Node(NodeReport::Finished)));
    stage.exits(node(0, 0));
    stage.holds([true]);
    stage.display(DisplayReport::Finished(display_totals()));
    stage.exits(DISPLAY);
    for second in 1..62 {
        stage.now = Duration::from_secs(second);
        stage.heartbeats(&[BUS, MASTER]);
        stage.happens(Event::Tick);
    }
    assert!(stage.exits(MASTER).contains(&finish_bus(vec![])));
    stage.bus(BusReport::Finished(BusTotals::default()));
    stage.exits(BUS);
    assert_eq!(stage.state.over(), Some(&Cause::Complete));
    assert_eq!(stage.incidents(), ["the master did not end in time"]);
}
