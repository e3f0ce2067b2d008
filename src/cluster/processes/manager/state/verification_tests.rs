//! Runs whose tiles are verified, or whose nodes forge what they report, played by hand.

use std::time::Duration;

use super::super::cause::{Cause, Interrupt};
use super::super::event::{Action, Event};
use super::super::fixture;
use super::super::process::Command;
use super::tests::{DISPLAY, MASTER, Stage, granted, holdings, node, to_master};
use crate::protocol::control::{
    Comparison, DisplayCommand, DisplayReport, Holdings, MasterCommand, MasterReport, NodeCommand, Share, TileResult,
    TileSet,
};
use crate::protocol::work::TileDone;
use ground::ids::{Attempt, Epoch, NodeId, Producer, RunId, TileId};
use trace::tracer::TraceStats;

fn by(node: u16) -> Producer {
    Producer { run: fixture::RUN, node: NodeId(node), epoch: Epoch(0) }
}

fn compared(tile: u32, kept: (Producer, u8), other: (Producer, u8)) -> DisplayReport {
    let result = |(producer, digest)| TileResult { producer, digest: [digest; 32] };
    DisplayReport::Compared(Comparison { tile: TileId(tile), kept: result(kept), other: result(other) })
}

fn condemn(producer: Producer) -> Action {
    Action::Tell(DISPLAY, Command::Display(DisplayCommand::Condemn(producer)))
}

fn tiles_and_attempts(actions: &[Action]) -> Vec<(u32, u32)> {
    granted(actions).iter().map(|grant| (grant.tile.0, grant.attempt.0)).collect()
}

#[test]
fn a_corrupt_node_is_found_and_its_tiles_are_done_again() {
    let mut plan = fixture::plan(3, 6);
    plan.run.verify = 1e-9;
    let mut stage = Stage::configured(plan, 6);
    // Tiles 0, 1 are node 0's, 2 is node 1's; the first of each is checked by another one.
    let checks: Vec<_> = [(0, 0), (0, 1), (1, 2)].into_iter().flat_map(|(n, tile)| stage.done(n, tile, 0)).collect();
    assert!(granted(&checks).is_empty(), "none are wanted yet");
    let checks = granted(&stage.master(MasterReport::TilesWanted(9)));
    assert_eq!(checks.iter().map(|grant| (grant.tile.0, grant.except[0].0)).collect::<Vec<_>>(), [(0, 0), (2, 1)]);
    stage.display(compared(2, (by(1), 5), (by(2), 5)));
    let actions = stage.display(compared(0, (by(0), 6), (by(1), 7)));
    assert_eq!(granted(&actions)[0].except, [NodeId(0), NodeId(1)], "{actions:?}");
    let actions = stage.display(compared(0, (by(0), 6), (by(2), 7)));
    assert!(actions.contains(&Action::Kill(node(0, 0))));
    assert!(actions.contains(&to_master(MasterCommand::NodeSetAside { node: NodeId(0) })));
    assert!(actions.contains(&condemn(by(0))), "{actions:?}");
    assert_eq!(tiles_and_attempts(&actions), [(0, 3), (1, 1)]);
    assert_eq!(stage.state.tiles.queue.missing(), 5);
    // What it reports before it is dead does not count.
    stage.done(0, 3, 0);
    assert_eq!(stage.state.tiles.queue.missing(), 5);
    assert!(stage.incidents().iter().any(|text| text.starts_with("node 0 (epoch 0) is condemned: other nodes agree")));

    // A display that died had kept its pixels of tile 2 and compared node 1's with them, which was not reported.
    stage.display(DisplayReport::Condemned(by(1), [false, false, true].into_iter().collect()));
    assert_eq!(stage.state.tiles.queue.missing(), 5, "nothing is wrong with node 1");
    let actions = stage.display(DisplayReport::Condemned(by(0), [true, true, true].into_iter().collect()));
    assert_eq!(stage.state.tiles.queue.missing(), 6);
    assert_eq!(tiles_and_attempts(&actions), [(2, 2)]);
}

#[test]
fn a_process_that_forges_is_condemned_without_a_comparison() {
    let forgeries: [fn(&mut Stage) -> Vec<Action>; 3] = [
        |stage| {
            let why = "it reported tile 1, attempt 0 without a receipt of the display".to_owned();
            stage.master(MasterReport::Forged { node: NodeId(0), epoch: Epoch(0), why })
        },
        |stage| {
            let why = "tile 3, attempt 0: the master did not hand it to this process".to_owned();
            stage.display(DisplayReport::Forged { node: NodeId(0), epoch: Epoch(0), why })
        },
        |stage| {
            let done = TileDone {
                tile: TileId(1),
                attempt: Attempt(0),
                trace: TraceStats { rays: [u64::MAX; 4], ..TraceStats::default() },
                memory: None,
                render_cpu_nanoseconds: 5,
            };
            stage.master(MasterReport::Done { node: NodeId(0), epoch: Epoch(0), done: Box::new(done) })
        },
    ];
    for forge in forgeries {
        let mut stage = Stage::configured(fixture::plan(2, 4), 4);
        stage.done(0, 0, 0);
        stage.master(MasterReport::TilesWanted(4));
        let actions = forge(&mut stage);
        assert!(actions.contains(&Action::Kill(node(0, 0))) && actions.contains(&condemn(by(0))), "{actions:?}");
        assert!(tiles_and_attempts(&actions).contains(&(0, 1)), "{actions:?}");
        let incidents = stage.incidents();
        assert!(incidents[0].starts_with("node 0 (epoch 0) is condemned: it "), "{incidents:?}");
        assert_eq!(incidents[1], "node 0 is set aside: it is condemned");
        assert_eq!(
            (stage.state.tiles.ledger.total().tiles, stage.state.tiles.ledger.rays()),
            (0, 0),
            "its counts do not count"
        );
        // Once is enough.
        let again = forge(&mut stage);
        assert!(!again.contains(&condemn(by(0))), "{again:?}");
    }
}

#[test]
fn tiles_of_an_earlier_run_are_verified_by_their_processes() {
    let mut plan = fixture::plan(3, 4);
    (plan.run.verify, plan.resume) = (1e-12, true);
    let earlier = Producer { run: RunId(99), ..by(0) };
    let shares = vec![Share { producer: earlier, tiles: 2, latest: TileId(3) }];
    let restored = Holdings { shares, ..holdings([true, false, false, true]) };
    let mut stage = Stage::restored(plan, restored);
    let grants = granted(&stage.master(MasterReport::TilesWanted(9)));
    let check = grants.iter().find(|grant| grant.tile == TileId(3)).expect("the latest of the process");
    assert_eq!((grants.len(), &check.except[..]), (3, &[NodeId(0)][..]));
    for (n, tile) in [(1, 1), (2, 2)] {
        stage.done(n, tile, 0);
    }
    stage.display(compared(3, (earlier, 1), (by(1), 2)));
    let actions = stage.display(compared(3, (earlier, 1), (by(2), 2)));
    assert!(actions.contains(&condemn(earlier)), "{actions:?}");
    assert!(!actions.iter().any(|action| matches!(action, Action::Kill(_))), "it died with its run");
    stage.master(MasterReport::TilesWanted(9));
    let taken_out: TileSet = [true, false, false, true].into_iter().collect();
    let actions = stage.display(DisplayReport::Condemned(earlier, taken_out));
    assert_eq!(granted(&actions).iter().map(|grant| grant.tile.0).collect::<Vec<_>>(), [0, 3]);
    assert_eq!(stage.state.tiles.ledger.resumed, 0);
    let incidents = stage.incidents();
    assert!(
        incidents.iter().any(|text| text.starts_with("node 0 (epoch 0) of an earlier run is condemned")),
        "{incidents:?}"
    );
}

#[test]
fn a_condemnation_reaches_the_journal_of_a_run_that_is_interrupted() {
    let mut plan = fixture::plan(3, 6);
    plan.run.verify = 1.0;
    let mut stage = Stage::configured(plan, 6);
    stage.done(0, 0, 0);
    stage.done(0, 1, 0);
    stage.display(compared(0, (by(0), 6), (by(1), 7)));
    stage.happens(Event::Signal(Interrupt::Sigint));
    for n in 0..3 {
        stage.happens(Event::Exited(node(n, 0), "died".to_owned()));
    }
    // The comparison that settles it was on its way.
    let actions = stage.display(compared(0, (by(0), 6), (by(2), 7)));
    assert!(actions.contains(&condemn(by(0))), "{actions:?}");
    assert_eq!(stage.state.tiles.queue.missing(), 6);
    stage.display(DisplayReport::Condemned(by(0), [true, true].into_iter().collect()));
    stage.happens(Event::Exited(MASTER, "ended".to_owned()));
    let actions = stage.holds([false; 6]);
    assert_eq!(actions, [Action::Tell(DISPLAY, Command::Display(DisplayCommand::Finish))]);
}

#[test]
fn a_comparison_that_was_lost_is_made_again() {
    let mut plan = fixture::plan(2, 1);
    plan.run.verify = 1.0;
    let mut stage = Stage::configured(plan, 1);
    stage.done(0, 0, 0);
    assert_eq!(granted(&stage.master(MasterReport::TilesWanted(9)))[0].attempt, Attempt(1));
    // The display died after it had acknowledged the second result, and before it told.
    assert!(granted(&stage.done(1, 0, 1)).is_empty());
    assert!(granted(&stage.happens(Event::Tick)).is_empty());
    stage.now += Duration::from_secs(1);
    let again = granted(&stage.happens(Event::Tick));
    assert_eq!((again[0].attempt, &again[0].except[..]), (Attempt(2), &[NodeId(0)][..]));
    stage.now += Duration::from_secs(1);
    assert!(granted(&stage.happens(Event::Tick)).is_empty(), "once at a time");
}

#[test]
fn a_verified_run_ends_when_the_display_has_told_all() {
    let mut plan = fixture::plan(2, 1);
    plan.run.verify = 1.0;
    let mut stage = Stage::configured(plan, 1);
    stage.done(0, 0, 0);
    stage.master(MasterReport::TilesWanted(9));
    stage.done(1, 0, 1);
    // Comparisons that are under way come before the answer to this.
    assert_eq!(stage.display(compared(0, (by(0), 5), (by(1), 5))), [stage.question()]);
    let finish_node = Action::Tell(node(0, 0), Command::Node(NodeCommand::Finish));
    assert!(stage.holds([true]).contains(&finish_node));
    // What is found now cannot be settled: the image is not to be relied on.
    stage.display(compared(0, (by(0), 5), (by(1), 6)));
    for n in 0..2 {
        stage.happens(Event::Exited(node(n, 0), "ended".to_owned()));
    }
    stage.now += Duration::from_secs(10);
    while stage.state.over().is_none() {
        stage.now += Duration::from_secs(1);
        stage.happens(Event::Tick);
    }
    let expected = "two results of tile 0 differ, which was found after the last tile".to_owned();
    assert_eq!(stage.state.over(), Some(&Cause::Failed(expected)));
}

#[test]
fn a_display_that_compares_what_there_is_not_is_ended() {
    let mut stage = Stage::configured(fixture::plan(2, 4), 4);
    assert_eq!(stage.display(compared(4, (by(0), 1), (by(1), 2))), [Action::Kill(DISPLAY)]);
}
