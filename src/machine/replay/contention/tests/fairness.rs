//! Who waits how long under which arbiter.

use super::*;

/// All the bus's time is asked for by each of these nodes.
fn greedy(nodes: u16, count: u64) -> impl Workload<Error = Infallible> {
    repeated(nodes, count, |_| fetch(0, 64))
}

fn bus(arbiter: Arbiter) -> Bus {
    Bus { arbiter, ..Bus::DEFAULT }
}

fn grants(log: &Log) -> Vec<u16> {
    log.holds.iter().map(|&(node, ..)| node.0).collect()
}

#[test]
fn under_fifo_nobody_waits_for_more_than_one_transaction_of_each_other() {
    let service = Service::new(&Bus::DEFAULT).unloaded_cycles(64);
    for nodes in [2, 7, 256] {
        let (outcome, log) = play_logged(&settings(nodes, bus(Arbiter::Fifo)), greedy(nodes, 20));
        assert_eq!(outcome.wait_max_cycles, u64::from(nodes - 1) * service);
        let turns = grants(&log);
        assert!(turns.chunks(nodes.into()).all(|turn| turn.iter().copied().eq(0..nodes)), "{turns:?}");
    }
}

#[test]
fn under_fixed_priority_the_last_node_waits_for_all_others() {
    let service = Service::new(&Bus::DEFAULT).unloaded_cycles(64);
    let (outcome, log) = play_logged(&settings(3, bus(Arbiter::FixedPriority)), greedy(3, 100));
    assert_eq!(outcome.wait_max_cycles, 200 * service, "node 2 starves until both others have ended");
    assert!(grants(&log).is_sorted());
    assert_eq!(outcome.nodes.iter().map(|node| node.idle_cycles / service).collect::<Vec<_>>(), [200, 100, 0]);
}

#[test]
fn under_round_robin_each_has_its_quantum() {
    for quantum in [1, 4] {
        let (outcome, log) = play_logged(&settings(5, bus(Arbiter::RoundRobin { quantum })), greedy(5, 40));
        let turns = grants(&log);
        let turn = quantum as usize;
        let expected: Vec<u16> = (0..200).map(|grant| (grant / turn % 5) as u16).collect();
        assert_eq!(turns, expected);
        let service = Service::new(&Bus::DEFAULT).unloaded_cycles(64);
        assert_eq!(outcome.wait_max_cycles, 4 * u64::from(quantum) * service);
    }
}

#[test]
fn round_robin_shares_the_bus_with_who_asks_for_more_at_a_time() {
    // Node 0 moves 1024 bytes at a time, the others 64: each has as many transactions as the others.
    let workload = repeated(4, 50, |node| fetch(0, if node.0 == 0 { 1024 } else { 64 }));
    let (_, log) = play_logged(&settings(4, bus(Arbiter::RoundRobin { quantum: 1 })), workload);
    let mut counts = [0_u32; 4];
    for node in grants(&log) {
        counts[usize::from(node)] += 1;
        assert!(counts.iter().max().zip(counts.iter().min()).is_some_and(|(most, least)| most - least <= 1));
    }
}

#[test]
fn arbiters_share_out_the_same_work() {
    // Whoever goes first, a bus that is never free is done at the same time.
    let cycles = |arbiter| play(&settings(8, bus(arbiter)), greedy(8, 30)).cycles;
    let expected = 8 * 30 * Service::new(&Bus::DEFAULT).unloaded_cycles(64);
    for arbiter in [Arbiter::Fifo, Arbiter::RoundRobin { quantum: 3 }, Arbiter::FixedPriority] {
        assert_eq!(cycles(arbiter), expected);
    }
}
