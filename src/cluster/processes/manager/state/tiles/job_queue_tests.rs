//! The job queue, event by event.

use super::*;
use crate::processes::manager::fixture;
use ground::ids::{Epoch, RunId};
use machine::tile_order::TileOrder;
use trace::picture::{Sides, Tiling};

const FIRST: ClusterId = ClusterId(0);
const NOW: Duration = Duration::ZERO;
const BY: Producer = Producer { run: RunId(1), node: NodeId(0), epoch: Epoch(0) };

fn queue(assignment: Assignment, tiles: u32, nodes: u16, count: u16) -> JobQueue {
    let tiling = Tiling::new(Sides { width: tiles, height: 1, tile_width: 1, tile_height: 1 }).expect("possible");
    let run = Run { assignment, order: TileOrder::Scanline, ..fixture::run() };
    JobQueue::new(&run, tiling, Cluster { count, ..fixture::plan(nodes, tiles).cluster })
}

/// Tile and node of each grant.
fn granted(queue: &mut JobQueue, cluster: u16, wanted: u32, now: Duration) -> Vec<(u32, Option<u16>)> {
    let first = queue.clusters.first_node(ClusterId(cluster)).0;
    let nodes: Vec<_> = (first..first + queue.clusters.nodes).map(NodeId).collect();
    let grants = queue.grants(ClusterId(cluster), wanted, &nodes, now);
    grants.iter().map(|grant| (grant.tile.0, grant.node.map(|node| node.0))).collect()
}

fn done(queue: &mut JobQueue, tile: u32, attempt: u32) -> Completion {
    queue.complete(TileId(tile), Attempt(attempt), BY, NOW)
}

#[test]
fn no_more_is_granted_than_wanted_and_all_of_it_once() {
    let mut queue = queue(Assignment::OnDemand, 5, 4, 1);
    assert_eq!(granted(&mut queue, 0, 0, NOW), []);
    assert_eq!(granted(&mut queue, 0, 2, NOW), [(0, None), (1, None)]);
    assert_eq!(granted(&mut queue, 0, 9, NOW), [(2, None), (3, None), (4, None)]);
    for tile in 0..5 {
        assert_eq!(queue.missing(), 5 - tile);
        assert_eq!(done(&mut queue, tile, 0), Completion::Accepted);
        assert_eq!(done(&mut queue, tile, 0), Completion::Unknown, "once");
    }
    assert_eq!((queue.missing(), queue.reissued()), (0, 0));
}

#[test]
fn interleaved_tiles_go_to_their_node_in_its_cluster() {
    let mut queue = queue(Assignment::Interleaved, 7, 2, 2);
    assert_eq!(granted(&mut queue, 0, 9, NOW), [(0, Some(0)), (1, Some(1)), (4, Some(0)), (5, Some(1))]);
    assert_eq!(granted(&mut queue, 1, 1, NOW), [(2, Some(2))]);
    queue.set_aside(NodeId(2));
    assert_eq!(granted(&mut queue, 0, 9, NOW), [(6, None)]);
    assert_eq!(granted(&mut queue, 1, 9, NOW), [(3, Some(3))]);
}

#[test]
fn a_lost_tile_waits_ahead_of_the_others_and_its_next_attempt_has_another_number() {
    let mut queue = queue(Assignment::OnDemand, 4, 1, 1);
    granted(&mut queue, 0, 2, NOW);
    assert!(queue.lose(TileId(1), Attempt(0)));
    assert!(!queue.lose(TileId(1), Attempt(0)), "once");
    assert_eq!(granted(&mut queue, 0, 1, NOW), [(1, None)]);
    assert_eq!(done(&mut queue, 1, 0), Completion::Unknown, "the lost one");
    assert_eq!(done(&mut queue, 1, 1), Completion::Accepted);
    assert_eq!((queue.accepted(TileId(1)), queue.reissued()), (Some(Attempt(1)), 1));
}

#[test]
fn what_a_cluster_had_goes_to_another_in_order() {
    let mut queue = queue(Assignment::OnDemand, 6, 2, 2);
    assert_eq!(granted(&mut queue, 0, 3, NOW).len(), 3);
    assert_eq!(granted(&mut queue, 1, 1, NOW), [(3, None)]);
    assert_eq!(done(&mut queue, 1, 0), Completion::Accepted);
    assert_eq!(queue.lose_cluster(FIRST), 2);
    assert_eq!(granted(&mut queue, 1, 9, NOW), [(0, None), (2, None), (4, None), (5, None)]);
}

#[test]
fn a_straggler_is_handed_out_once_more_and_either_result_counts_once() {
    let late = Duration::from_secs(60);
    for winner in [1, 0] {
        let mut queue = queue(Assignment::OnDemand, 2, 2, 1);
        granted(&mut queue, 0, 2, NOW);
        assert_eq!(granted(&mut queue, 0, 2, late), [], "what is usual is not known yet");
        assert_eq!(done(&mut queue, 0, 0), Completion::Accepted);
        assert_eq!(granted(&mut queue, 0, 2, STRAGGLE_MIN), [], "not late yet");
        assert_eq!(granted(&mut queue, 0, 2, late), [(1, None)], "once");
        assert_eq!(done(&mut queue, 1, winner), Completion::Accepted);
        assert_eq!(granted(&mut queue, 0, 2, 2 * late), [], "it is done, though an attempt is still out");
        assert_eq!(done(&mut queue, 1, 1 - winner), Completion::Extra);
        assert_eq!((queue.missing(), queue.reissued()), (0, 0));
    }
    let mut queue = queue(Assignment::Interleaved, 2, 2, 1);
    granted(&mut queue, 0, 2, NOW);
    done(&mut queue, 0, 0);
    assert_eq!(granted(&mut queue, 0, 2, late), [], "counts are to be reproducible");
}

#[test]
fn of_a_straggler_that_is_lost_the_other_attempt_goes_on() {
    let late = Duration::from_secs(60);
    let mut queue = queue(Assignment::OnDemand, 2, 2, 1);
    granted(&mut queue, 0, 2, NOW);
    done(&mut queue, 0, 0);
    granted(&mut queue, 0, 2, late);
    assert!(queue.lose(TileId(1), Attempt(0)));
    assert_eq!(granted(&mut queue, 0, 2, late), [], "it is out");
    assert!(queue.lose(TileId(1), Attempt(1)));
    assert_eq!(granted(&mut queue, 0, 2, late), [(1, None)]);
    assert_eq!(done(&mut queue, 1, 2), Completion::Accepted);
}

#[test]
fn a_check_is_for_another_node_and_comes_back_when_it_is_lost() {
    let mut queue = queue(Assignment::OnDemand, 1, 2, 1);
    granted(&mut queue, 0, 1, NOW);
    done(&mut queue, 0, 0);
    queue.check(TileId(0), vec![NodeId(0)]);
    assert_eq!(queue.grants(FIRST, 9, &[NodeId(0)], NOW), []);
    let grants = queue.grants(FIRST, 9, &[NodeId(0), NodeId(1)], NOW);
    let expected = TileGrant { tile: TileId(0), attempt: Attempt(1), node: None, except: vec![NodeId(0)] };
    assert_eq!(grants, [expected]);
    assert!(queue.lose(TileId(0), Attempt(1)) && queue.checks(TileId(0)));
    assert_eq!(queue.grants(FIRST, 9, &[NodeId(1)], NOW).len(), 1);
    assert_eq!(done(&mut queue, 0, 2), Completion::Extra);
    assert_eq!((queue.missing(), queue.checks(TileId(0))), (0, false));
    queue.check(TileId(0), vec![NodeId(0)]);
    assert_eq!(queue.give_up_checks(&[NodeId(0)]), [TileId(0)]);
}

#[test]
fn tiles_that_are_done_again_take_any_result_that_is_still_out() {
    let mut queue = queue(Assignment::OnDemand, 3, 2, 1);
    granted(&mut queue, 0, 3, NOW);
    (0..2).for_each(|tile| assert_eq!(done(&mut queue, tile, 0), Completion::Accepted));
    queue.check(TileId(0), vec![]);
    queue.check(TileId(1), vec![]);
    assert_eq!(granted(&mut queue, 0, 1, NOW), [(0, None)]);
    assert_eq!(queue.redo(|_, by| by == Some(BY)), [(TileId(1), Some(BY)), (TileId(0), Some(BY))]);
    assert_eq!((queue.missing(), queue.checks(TileId(1))), (3, false), "nothing is there to be compared with");
    // The check that is out counts for nothing, whatever it brings.
    assert_eq!(done(&mut queue, 0, 1), Completion::Extra);
    assert_eq!(granted(&mut queue, 0, 9, NOW), [(0, None), (1, None)]);
    assert_eq!(done(&mut queue, 0, 2), Completion::Accepted);
    assert_eq!(queue.redo(|tile, _| tile == TileId(2)), [], "it is not done");
}

#[test]
fn a_journal_is_taken_over_and_what_a_later_one_lacks_is_done_again() {
    let mut queue = queue(Assignment::OnDemand, 4, 1, 1);
    assert_eq!(queue.resume(|tile| tile.0 % 2 == 0), 2);
    assert_eq!(granted(&mut queue, 0, 9, NOW), [(1, None), (3, None)]);
    assert_eq!((done(&mut queue, 1, 0), queue.missing()), (Completion::Accepted, 1));
    let redone = queue.redo(|tile, _| tile.0 == 1 || tile.0 == 2);
    assert_eq!(redone, [(TileId(2), None), (TileId(1), Some(BY))]);
    assert_eq!(granted(&mut queue, 0, 9, NOW), [(1, None), (2, None)]);
    assert_eq!(queue.missing(), 3);
}
