//! Runs whose tiles are verified, played by hand.

use std::time::Duration;

use super::process::Command;
use super::sample;
use super::state::{Action, Event};
use super::state_tests::{DISPLAY, Stage, granted, node, to_master};
use crate::ids::{Attempt, Epoch, NodeId, TileId};
use crate::protocol::control::{
    Comparison, DisplayCommand, DisplayReport, MasterCommand, MasterReport, NodeCommand, Revocation, TileResult,
};

#[test]
fn a_corrupt_node_is_found_out_and_its_tiles_are_done_again() {
    let mut plan = sample::plan(3, 6);
    plan.run.verify = 1e-9;
    let mut stage = Stage::configured(plan, 6);
    // Tiles 0, 1 are node 0's, 2 is node 1's; the first of each is checked by another one.
    let checks: Vec<_> = [(0, 0), (0, 1), (1, 2)].into_iter().flat_map(|(n, tile)| stage.done(n, tile, 0)).collect();
    assert!(granted(&checks).is_empty(), "none are wanted yet");
    let checks = granted(&stage.master(MasterReport::TilesWanted(9)));
    assert_eq!(checks.iter().map(|grant| (grant.tile.0, grant.except[0].0)).collect::<Vec<_>>(), [(0, 0), (2, 1)]);
    let result = |n: u16, digest| TileResult {
        attempt: Attempt(u32::from(n)),
        source: Some((NodeId(n), Epoch(0))),
        digest: [digest; 32],
    };
    let compared = |tile, kept, other| DisplayReport::Compared(Comparison { tile: TileId(tile), kept, other });
    stage.display(compared(2, result(1, 5), result(2, 5)));
    let actions = stage.display(compared(0, result(0, 6), result(1, 7)));
    assert_eq!(granted(&actions)[0].except, [NodeId(0), NodeId(1)], "{actions:?}");
    let actions = stage.display(compared(0, result(0, 6), result(2, 7)));
    assert!(actions.contains(&Action::Kill(node(0, 0))));
    assert!(actions.contains(&to_master(MasterCommand::NodeSetAside { node: NodeId(0) })));
    let revoked = |tile, attempt| Revocation { tile: TileId(tile), attempt: Attempt(attempt) };
    let revocations = vec![revoked(0, 2), revoked(1, 0)];
    let revoke = DisplayCommand::Revoke(revocations.clone());
    assert!(actions.contains(&Action::Tell(DISPLAY, Command::Display(revoke))), "{actions:?}");
    assert_eq!(stage.state.queue.missing(), 5);
    // What it says before it is dead is not believed.
    stage.done(0, 3, 0);
    assert_eq!(stage.state.queue.missing(), 5);
    let again = granted(&stage.display(DisplayReport::Revoked(revocations)));
    assert_eq!(again.iter().map(|grant| (grant.tile.0, grant.attempt.0)).collect::<Vec<_>>(), [(1, 1), (0, 3)]);
    assert!(stage.incidents().iter().any(|text| text.starts_with("node 0 (epoch 0) is corrupt")));

    // A display that died had kept its pixels of tile 2 and compared node 1's with them, which nobody was told.
    let question = Action::Tell(DISPLAY, Command::Display(DisplayCommand::TilesOf(NodeId(0), Epoch(0))));
    assert!(actions.contains(&question), "{actions:?}");
    let missing = stage.state.queue.missing();
    stage.display(DisplayReport::TilesOf(NodeId(1), Epoch(0), vec![0b10_0000]));
    assert_eq!(stage.state.queue.missing(), missing, "nothing is wrong with node 1");
    let actions = stage.display(DisplayReport::TilesOf(NodeId(0), Epoch(0), vec![0b100]));
    let revocations = vec![revoked(2, 1)];
    let revoke = Command::Display(DisplayCommand::Revoke(revocations.clone()));
    assert!(actions.contains(&Action::Tell(DISPLAY, revoke)), "{actions:?}");
    assert_eq!(stage.state.queue.missing(), missing + 1);
    let again = granted(&stage.display(DisplayReport::Revoked(revocations)));
    assert_eq!(again.iter().map(|grant| (grant.tile.0, grant.attempt.0)).collect::<Vec<_>>(), [(2, 2)]);
}

#[test]
fn a_comparison_that_was_lost_is_made_again() {
    let mut plan = sample::plan(2, 1);
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
    let mut plan = sample::plan(2, 1);
    plan.run.verify = 1.0;
    let mut stage = Stage::configured(plan, 1);
    stage.done(0, 0, 0);
    stage.master(MasterReport::TilesWanted(9));
    stage.done(1, 0, 1);
    let result = |n: u16, digest| TileResult {
        attempt: Attempt(u32::from(n)),
        source: Some((NodeId(n), Epoch(0))),
        digest: [digest; 32],
    };
    let compared = |kept, other| DisplayReport::Compared(Comparison { tile: TileId(0), kept, other });
    // Comparisons that are under way come before the answer to this.
    let nothing = Action::Tell(DISPLAY, Command::Display(DisplayCommand::Revoke(Vec::new())));
    assert_eq!(stage.display(compared(result(0, 5), result(1, 5))), [nothing]);
    let finish_node = Action::Tell(node(0, 0), Command::Node(NodeCommand::Finish));
    assert!(stage.display(DisplayReport::Revoked(Vec::new())).contains(&finish_node));
    // What is found out now does not take a tile out of the image.
    assert!(stage.display(compared(result(0, 5), result(1, 6))).is_empty());
    assert!(stage.incidents()[0].starts_with("two results of tile 0 differ"));
    assert_eq!(stage.state.queue.missing(), 0);
}

#[test]
fn a_display_that_compares_what_there_is_not_is_ended() {
    let mut stage = Stage::configured(sample::plan(2, 4), 4);
    let result = |digest| TileResult { attempt: Attempt(0), source: None, digest: [digest; 32] };
    let comparison = Comparison { tile: TileId(4), kept: result(1), other: result(2) };
    assert_eq!(stage.display(DisplayReport::Compared(comparison)), [Action::Kill(DISPLAY)]);
}
