use super::schedule::Fault;
use super::*;
use crate::protocol::hello::Role;
use ground::ids::NodeId;

/// So many in every test run; `cargo bench --bench simulated` does more.
const SLICE: u64 = 200;

#[test]
fn whatever_goes_wrong_the_promises_are_kept() {
    for seed in 0..SLICE {
        let schedule = Schedule::random(seed);
        let outcome = rehearse(&schedule, None);
        assert!(outcome.broken.is_empty(), "{schedule}\n{:#?}\n{:#?}", outcome.broken, outcome.incidents);
    }
}

#[test]
fn beside_a_hostile_process_the_image_is_right_or_the_run_fails_and_ends() {
    let mut broken = Vec::new();
    for seed in 0..SLICE {
        let schedule = Schedule::hostile_of(seed);
        let outcome = rehearse(&schedule, None);
        if !outcome.broken.is_empty() {
            broken.push(format!("{schedule}\n{:#?}\n{:#?}", outcome.broken, outcome.incidents));
        }
    }
    assert!(broken.is_empty(), "{} of {SLICE}:\n{}", broken.len(), broken.join("\n"));
}

/// What was wrong once beside hostile processes: a display that did not say what it holds, or ended without an image; a master
/// that said nothing of its tiles; a server that ended early; tiles taken out of a finished image.
#[test]
fn what_hostile_processes_found_once_is_right() {
    for seed in [64, 453, 1064, 1473, 2808, 4442, 4842, 5777, 6701, 6810, 8530] {
        let schedule = Schedule::hostile_of(seed);
        let outcome = rehearse(&schedule, None);
        assert!(outcome.broken.is_empty(), "{schedule}\n{:#?}\n{:#?}", outcome.broken, outcome.incidents);
    }
}

/// What was wrong once: tiles lost with a dead node's late request, comparisons lost with a display, tiles that went to a
/// master without nodes, a tile taken out of a finished image, books that did not balance.
#[test]
fn what_went_wrong_once_is_right() {
    for seed in [46, 211, 2749, 4090, 6513, 305, 3302, 5786, 10342, 24466, 33148, 34368, 34459, 49255] {
        let schedule = Schedule::random(seed);
        let outcome = rehearse(&schedule, None);
        assert!(outcome.broken.is_empty(), "{schedule}\n{:#?}\n{:#?}", outcome.broken, outcome.incidents);
    }
}

#[test]
fn one_seed_is_one_course_of_events() {
    for seed in [3, 17] {
        let schedule = Schedule::random(seed);
        let [one, other] = [(); 2].map(|()| rehearse(&schedule, None));
        assert_eq!((one.took, one.decisions, one.incidents), (other.took, other.decisions, other.incidents));
    }
}

/// A promise that nothing can break is none.
#[test]
fn without_verification_a_corrupt_nodes_pixels_are_seen() {
    let mut schedule = Schedule::random(0);
    (schedule.play.clusters, schedule.play.nodes, schedule.play.run.verify) = (1, 4, 0.0);
    let role = Role::Node(NodeId(1));
    schedule.faults = vec![Fault { tiles: 1, then: Duration::ZERO, role, what: What::Corrupt }];
    let unseen = rehearse(&schedule, None);
    assert!(unseen.wrong_tiles > 0 && unseen.broken.is_empty(), "{:?}", unseen.broken);
    schedule.play.run.verify = 0.02;
    let verified = rehearse(&schedule, None);
    assert_eq!((verified.wrong_tiles, verified.broken), (0, Vec::new()));
    assert!(verified.incidents.iter().any(|text| text.contains("node 1 (epoch 0) is condemned")));
}
