//! The display's place, played by hand: displays that die, journals and frames that lack tiles.

use super::super::cause::Cause;
use super::super::event::{Action, Event};
use super::super::fixture;
use super::super::process::{Command, ProcessId, Report};
use super::tests::{BUS, DISPLAY, MASTER, Stage, address, finish_display, granted, holdings, node};
use crate::protocol::control::{BusReport, DisplayCommand, DisplayReport, Holdings, MasterReport, NodeCommand, Share};
use ground::ids::{Epoch, NodeId, Producer, TileId};
use machine::hardware::totals::{BusTotals, MasterTotals};

#[test]
fn a_display_that_dies_is_replaced_and_the_nodes_are_told() {
    let mut stage = Stage::running(1, 4);
    stage.done(0, 0, 0);
    stage.done(0, 1, 0);
    let next = ProcessId { epoch: Epoch(1), ..DISPLAY };
    assert!(stage.exits(DISPLAY).contains(&Action::Spawn(next)));
    let actions = stage.happens(Event::Connected(next));
    let [Action::Tell(_, Command::Display(DisplayCommand::Configure(configuration)))] = &actions[..] else {
        panic!("{actions:?}");
    };
    assert!(configuration.resume);
    let told = |report| Event::Report(next, Report::Display(report));
    // It has tile 1 alone: tile 0 is done again.
    stage.happens(told(DisplayReport::Restored(holdings([false, true]))));
    assert_eq!((stage.state.tiles.queue.missing(), stage.state.tiles.ledger.total().tiles), (3, 1));
    let actions = stage.happens(told(DisplayReport::Listening(address(9))));
    let expected = Action::Tell(node(0, 0), Command::Node(NodeCommand::Display(address(9))));
    assert!(actions.contains(&expected), "{actions:?}");
    stage.exits(next);
    stage.exits(ProcessId { epoch: Epoch(2), ..DISPLAY });
    stage.exits(node(0, 0));
    stage.master(MasterReport::Finished(MasterTotals::default()));
    stage.bus(BusReport::Finished(BusTotals::default()));
    stage.all_exit(&[BUS, MASTER]);
    assert_eq!(stage.state.over(), Some(&Cause::Failed("the display (epoch 2) died: signal 9".to_owned())));
}

#[test]
fn a_display_that_dies_over_the_image_is_replaced_and_asked_again() {
    let mut stage = Stage::running(1, 1);
    stage.done(0, 0, 0);
    stage.holds([true]);
    assert!(stage.exits(node(0, 0)).contains(&stage.question()));
    assert_eq!(stage.holds([true]), [finish_display()]);
    let next = ProcessId { epoch: Epoch(1), ..DISPLAY };
    assert!(stage.exits(DISPLAY).contains(&Action::Spawn(next)));
    stage.happens(Event::Connected(next));
    let told = |report| Event::Report(next, Report::Display(report));
    stage.happens(told(DisplayReport::Restored(holdings([true]))));
    let to_next = |command| [Action::Tell(next, Command::Display(command))];
    let actions = stage.happens(told(DisplayReport::Listening(address(9))));
    let question = stage.state.display.question;
    assert_eq!(actions, to_next(DisplayCommand::TellHoldings { question }));
    let actions = stage.happens(told(DisplayReport::Holdings { question, holdings: holdings([true]) }));
    assert_eq!(actions, to_next(DisplayCommand::Finish));
}

#[test]
fn a_journal_that_loses_a_tile_after_the_last_one_is_a_failure() {
    let mut stage = Stage::running(1, 2);
    stage.done(0, 0, 0);
    stage.done(0, 1, 0);
    stage.holds([true; 2]);
    let next = ProcessId { epoch: Epoch(1), ..DISPLAY };
    stage.exits(DISPLAY);
    stage.happens(Event::Connected(next));
    stage.happens(Event::Report(next, Report::Display(DisplayReport::Restored(holdings([true, false])))));
    stage.all_exit(&[node(0, 0), BUS, MASTER, next]);
    assert_eq!(stage.state.over(), Some(&Cause::Failed("the journal lacks 1 tiles that were done".to_owned())));
    assert_eq!(stage.state.tiles.queue.missing(), 1);
}

#[test]
fn a_tile_that_the_display_does_not_have_is_not_done_whatever_was_reported() {
    let mut stage = Stage::running(1, 2);
    stage.done(0, 0, 0);
    assert_eq!(stage.done(0, 1, 0), [stage.question()]);
    stage.master(MasterReport::TilesWanted(1));
    let again = stage.holds([true, false]);
    assert_eq!(granted(&again).iter().map(|grant| (grant.tile.0, grant.attempt.0)).collect::<Vec<_>>(), [(1, 1)]);
    assert_eq!(stage.incidents(), ["the display lacks 1 tiles that were done: they are done again"]);
    assert_eq!(stage.done(0, 1, 1), [stage.question()], "it is asked again");
    // An answer to the first question, which was long under way.
    let stale = DisplayReport::Holdings { question: 1, holdings: holdings([true; 2]) };
    assert!(stage.display(stale).is_empty());
}

/// Found by `simulation::arbitrary`: with verification, the tile was to be done once more, and there is no such tile.
#[test]
fn a_display_that_has_a_tile_beyond_the_image_is_killed() {
    let mut plan = fixture::plan(1, 2);
    plan.run.verify = 1.0;
    let share = Share { producer: Producer::default(), tiles: 1, latest: TileId(2) };
    let impossible = || Holdings { shares: vec![share], ..holdings([true; 2]) };
    let mut stage = Stage::configured(plan, 2);
    assert_eq!(stage.display(DisplayReport::Restored(impossible())), [Action::Kill(DISPLAY)]);
    stage.exits(DISPLAY);
    assert_eq!(stage.incidents(), ["the display reported a tile that an image of 2 does not have"]);
}

/// Each such report asked for all comparisons once more.
#[test]
fn a_display_that_reports_twice_what_it_restored_is_killed() {
    let mut plan = fixture::plan(1, 4);
    plan.run.verify = 1.0;
    let mut stage = Stage::restored(plan, holdings([true, true, false, false]));
    let again = stage.display(DisplayReport::Restored(holdings([true, true, false, false])));
    assert!(again.contains(&Action::Kill(DISPLAY)), "{again:?}");
    assert_eq!((stage.state.tiles.queue.waiting_checks(), stage.state.tiles.ledger.resumed), (2, 2));
}

#[test]
fn a_run_that_is_over_does_nothing_more() {
    let mut stage = Stage::running(1, 2);
    stage.all_exit(&[DISPLAY, ProcessId { epoch: Epoch(1), ..DISPLAY }, ProcessId { epoch: Epoch(2), ..DISPLAY }]);
    stage.all_exit(&[node(0, 0), BUS, MASTER]);
    assert!(stage.state.over().is_some() && stage.state.next_deadline().is_none());
    assert!(stage.bus(BusReport::Listening(address(7))).is_empty() && stage.happens(Event::Tick).is_empty());
}

/// Found by `simulation::arbitrary`: the node was told of a new display, which killed it.
#[test]
fn a_node_that_is_not_connected_does_not_work_whatever_a_master_reports() {
    let mut stage = Stage::running(1, 2);
    stage.exits(node(0, 0));
    stage.master(MasterReport::NodeReady { node: NodeId(0), epoch: Epoch(1) });
    let next = ProcessId { epoch: Epoch(1), ..DISPLAY };
    stage.exits(DISPLAY);
    stage.happens(Event::Connected(next));
    stage.happens(Event::Report(next, Report::Display(DisplayReport::Restored(holdings([])))));
    let actions = stage.happens(Event::Report(next, Report::Display(DisplayReport::Listening(address(9)))));
    assert!(!actions.iter().any(|action| matches!(action, Action::Tell(id, _) if *id == node(0, 1))), "{actions:?}");
}
