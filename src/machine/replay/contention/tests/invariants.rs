//! What holds of any workload.

use proptest::prelude::*;
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;

use super::*;

/// Bursts of all kinds, some of them empty, as many a node as it happens.
fn random(nodes: u16, seed: u64) -> impl Workload<Error = Infallible> {
    let mut random: Vec<Pcg32> = (0..u64::from(nodes)).map(|node| Pcg32::seed_from_u64(seed * 1000 + node)).collect();
    move |node: NodeId, _| {
        let mut draw = |below: u32| random[usize::from(node.0)].next_u32() % below;
        if draw(40) == 0 {
            return Ok(None);
        }
        let kind = [Kind::Fetch, Kind::Fetch, Kind::Job, Kind::Pixels][draw(4) as usize];
        let transaction = (draw(5) > 0).then(|| Transaction { kind, bytes: draw(300) * draw(2) });
        Ok(Some(Burst { compute_cycles: u64::from(draw(100) * draw(2)), transaction }))
    }
}

fn any_bus() -> impl Strategy<Value = Bus> {
    let arbiters =
        [Arbiter::Fifo, Arbiter::RoundRobin { quantum: 1 }, Arbiter::RoundRobin { quantum: 3 }, Arbiter::FixedPriority];
    let transactions = [Transactions::Locked, Transactions::Split];
    (
        proptest::sample::select(arbiters.to_vec()),
        0..7_u32,
        1..4_u32,
        0..20_u32,
        proptest::sample::select(transactions.to_vec()),
    )
        .prop_map(|(arbiter, width, cycles_per_word, latency, transactions)| Bus {
            arbiter,
            width: 1 << width,
            cycles_per_word,
            latency,
            transactions,
        })
}

proptest! {
    #[test]
    fn no_cycle_is_lost_and_the_bus_has_one_holder(nodes in 1..20_u16, bus in any_bus(), seed in 0..1_000_000_u64) {
        let settings = settings(nodes, bus);
        let (outcome, log) = play_logged(&settings, random(nodes, seed));
        let service = Service::new(&bus);

        for node in &outcome.nodes {
            prop_assert_eq!(node.compute_cycles + node.stall_cycles + node.idle_cycles, outcome.cycles);
        }
        let all = outcome.compute_cycles + outcome.stall_cycles + outcome.idle_cycles;
        prop_assert_eq!(all, u64::from(nodes) * outcome.cycles);

        let bytes: u64 = log.requests.iter().map(|request| u64::from(request.bytes)).sum();
        prop_assert_eq!(bytes, outcome.fetched_bytes + outcome.message_bytes);
        prop_assert_eq!(bytes, outcome.nodes.iter().map(|node| node.bytes).sum::<u64>());
        // Split transactions leave the bus to others during the latency.
        let latency = if service.is_split() { service.latency_cycles() } else { 0 };
        let held: Cycle = log.requests.iter().map(|request| service.unloaded_cycles(request.bytes) - latency).sum();
        prop_assert_eq!(held, outcome.bus_busy_cycles);
        prop_assert_eq!(log.requests.len() as u64, outcome.transactions);

        prop_assert!(log.times.is_sorted());
        prop_assert_eq!(&log.holds, &log.released);
        prop_assert!(log.holds.windows(2).all(|pair| pair[0].3 <= pair[1].2), "two hold the bus");
        let mut requests: Vec<Request> = log.completions.iter().map(|(request, _)| *request).collect();
        let mut expected = log.requests.clone();
        requests.sort_by_key(|request| (request.node, request.requested));
        expected.sort_by_key(|request| (request.node, request.requested));
        prop_assert_eq!(requests, expected, "whoever asks is answered once");
        prop_assert_eq!(log.finished.len(), usize::from(nodes));

        let wait = |(request, now): &(Request, Cycle)| now - request.requested - service.unloaded_cycles(request.bytes);
        let mut waits: Vec<Cycle> = log.completions.iter().map(wait).collect();
        waits.sort_unstable();
        prop_assert_eq!(waits.last().copied().unwrap_or(0), outcome.wait_max_cycles);
        if !waits.is_empty() {
            let exact = waits[(waits.len() * 99).div_ceil(100) - 1];
            let told = outcome.wait_percentile_99_cycles;
            prop_assert!(exact <= told && told - exact <= exact / 256, "{} {}", exact, told);
        }

        prop_assert_eq!(play_logged(&settings, random(nodes, seed)), (outcome, log), "it is deterministic");
    }

    /// The bus is never free while somebody waits for it.
    #[test]
    fn the_bus_is_not_left_idle(nodes in 1..20_u16, bus in any_bus(), seed in 0..1_000_000_u64) {
        let bus = Bus { transactions: Transactions::Locked, ..bus };
        let (_, log) = play_logged(&settings(nodes, bus), random(nodes, seed));
        let mut free = 0;
        for &(node, _, from, until) in &log.holds {
            let requested = |request: &&Request| request.node == node && request.requested <= from;
            let last = log.requests.iter().filter(requested).map(|request| request.requested).max();
            prop_assert_eq!(Some(from), last.map(|requested| requested.max(free)));
            free = until;
        }
    }
}

#[test]
fn an_outcome_is_plain_data() {
    let outcome = play(&settings(2, Bus::DEFAULT), repeated(2, 3, |_| fetch(100, 64)));
    let json = serde_json::to_value(&outcome).expect("is JSON");
    assert_eq!(json["nodes"][1]["node"], 1);
    assert_eq!(json["transactions"], 6);
    assert_eq!(json["fetched_bytes"], 384);
}
