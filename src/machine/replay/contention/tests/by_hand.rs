//! Small cases, worked out on paper.

use super::*;

/// An address word, 2 cycles of latency, a word of data: 4 cycles.
const FOUR: Bus = Bus { latency: 2, ..Bus::DEFAULT };

fn waits(log: &Log, service: Service) -> Vec<Cycle> {
    let wait = |(request, now): &(Request, Cycle)| now - request.requested - service.unloaded_cycles(request.bytes);
    log.completions.iter().map(wait).collect()
}

fn holds(log: &Log) -> Vec<(u16, Cycle, Cycle)> {
    log.holds.iter().map(|&(node, _, from, until)| (node.0, from, until)).collect()
}

#[test]
fn three_nodes_fall_into_step_when_the_bus_has_room() {
    let (outcome, log) = play_logged(&settings(3, FOUR), repeated(3, 2, |_| fetch(10, 4)));
    assert_eq!(holds(&log), [(0, 10, 14), (1, 14, 18), (2, 18, 22), (0, 24, 28), (1, 28, 32), (2, 32, 36)]);
    assert_eq!(waits(&log, Service::new(&FOUR)), [0, 4, 8, 0, 0, 0]);
    assert_eq!((outcome.cycles, outcome.bus_busy_cycles), (36, 24));
    assert_eq!((outcome.wait_mean_cycles, outcome.wait_percentile_99_cycles, outcome.wait_max_cycles), (2.0, 8, 8));
    assert_eq!(outcome.nodes.iter().map(|node| node.stall_cycles).collect::<Vec<_>>(), [8, 12, 16]);
    assert_eq!(outcome.nodes.iter().map(|node| node.idle_cycles).collect::<Vec<_>>(), [8, 4, 0]);
    assert_eq!(outcome.nodes[1].efficiency, 20.0 / 32.0);
    assert_eq!(outcome.efficiency, 60.0 / 96.0);
    assert_eq!(outcome.utilisation, 24.0 / 36.0);
    assert_eq!(log.finished, [(NodeId(0), 28), (NodeId(1), 32), (NodeId(2), 36)]);
}

#[test]
fn three_nodes_wait_for_one_another_when_it_has_none() {
    let (outcome, log) = play_logged(&settings(3, FOUR), repeated(3, 2, |_| fetch(2, 4)));
    assert_eq!(holds(&log), [(0, 2, 6), (1, 6, 10), (2, 10, 14), (0, 14, 18), (1, 18, 22), (2, 22, 26)]);
    assert_eq!(waits(&log, Service::new(&FOUR)), [0, 4, 8, 6, 6, 6]);
    assert_eq!(outcome.cycles, 26);
}

#[test]
fn all_alike_on_either_side_of_the_knee() {
    let (think, service, count) = (36, 4, 50);
    let network = ClosedNetwork { compute_cycles: think as f64, latency_cycles: 0.0, service_cycles: service as f64 };
    assert_eq!(network.knee(), 10.0);
    for nodes in 1..=40 {
        let outcome = play(&settings(nodes, FOUR), repeated(nodes, count, |_| fetch(think, 4)));
        let n = u64::from(nodes);
        let expected = if f64::from(nodes) <= network.knee() {
            // They wait in the first round alone.
            count * (think + service) + (n - 1) * service
        } else {
            think + count * n * service
        };
        assert_eq!(outcome.cycles, expected, "{nodes} nodes");
    }
}

#[test]
fn a_split_transaction_has_the_bus_twice() {
    // An address word, 4 cycles of latency, 3 words of data.
    let bus = Bus { latency: 4, transactions: Transactions::Split, ..Bus::DEFAULT };
    let workload = || repeated(3, 1, |node| fetch(if node.0 == 2 { 15 } else { 10 }, 12));
    let (outcome, log) = play_logged(&settings(3, bus), workload());
    use Phase::{Address, Data};
    let by_hand = [
        (NodeId(0), Address, 10, 11),
        (NodeId(1), Address, 11, 12),
        // Node 2 asks at 15, too, and before the memory has found what node 1 asked for, at 16.
        (NodeId(0), Data, 15, 18),
        (NodeId(2), Address, 18, 19),
        (NodeId(1), Data, 19, 22),
        (NodeId(2), Data, 23, 26),
    ];
    assert_eq!(log.holds, by_hand);
    assert_eq!(log.released, by_hand);
    assert_eq!(waits(&log, Service::new(&bus)), [0, 1 + 3, 3]);
    assert_eq!((outcome.cycles, outcome.bus_busy_cycles, outcome.wait_mean_cycles), (26, 12, 7.0 / 3.0));
}

#[test]
fn tiles_of_a_shared_queue_go_to_who_is_first_in_simulated_time() {
    let mut tiles = [30, 10, 10, 10, 10].into_iter();
    let mut taken = Vec::new();
    let mut workload = |node: NodeId, now| {
        let Some(compute_cycles) = tiles.next() else { return Ok::<_, Infallible>(None) };
        taken.push((node.0, now));
        Ok(Some(Burst { compute_cycles, transaction: None }))
    };
    let Ok(outcome) = simulate(&settings(2, Bus::DEFAULT), &mut workload, &mut ());
    // Node 0 is asked first in cycle 30, too.
    assert_eq!(taken, [(0, 0), (1, 0), (1, 10), (1, 20), (0, 30)]);
    assert_eq!((outcome.cycles, outcome.idle_cycles, outcome.transactions), (40, 10, 0));
    assert_eq!((outcome.efficiency, outcome.utilisation), (1.0, 0.0));
    assert_eq!(ClosedNetwork::of(&outcome), None, "nothing asked for the bus");
}

#[test]
fn nothing_to_do_takes_no_time() {
    for nodes in [0, 1, 256] {
        let outcome = play(&settings(nodes, Bus::DEFAULT), |_, _| Ok(None));
        assert_eq!((outcome.cycles, outcome.nodes.len()), (0, usize::from(nodes)));
        assert_eq!((outcome.efficiency, outcome.utilisation), (1.0, 0.0));
    }
}

#[test]
fn a_workloads_error_ends_the_simulation() {
    let mut workload = |node: NodeId, now| if now < 100 { Ok(Some(fetch(10, 4))) } else { Err((node, now)) };
    let error = simulate(&settings(1, FOUR), &mut workload, &mut ()).expect_err("the workload's");
    assert_eq!(error, (NodeId(0), 8 * 14));
}
