//! The formulas against one another, and the simulation against the formulas.

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;

use super::*;

/// Knee at 11 nodes.
const NETWORK: ClosedNetwork = ClosedNetwork { compute_cycles: 20_000.0, latency_cycles: 0.0, service_cycles: 2_000.0 };
const NODES: [u16; 8] = [1, 2, 4, 8, 11, 16, 32, 64];

/// By inverse transform.
fn exponential(random: &mut Pcg32, mean: f64) -> f64 {
    let uniform = (f64::from(random.next_u32()) + 0.5) / f64::from(u32::MAX);
    -mean * libm::log(uniform.min(1.0))
}

/// A byte a cycle, after an address that takes one.
const BYTE_A_CYCLE: Bus = Bus { width: 1, latency: 0, ..Bus::DEFAULT };

/// Bytes that keep [`BYTE_A_CYCLE`] busy for an exponential time, rounded to cycles.
fn exponential_bytes(random: &mut Pcg32) -> u32 {
    (exponential(random, NETWORK.service_cycles) + 0.5) as u32
}

/// About a million transactions.
fn until(nodes: u16) -> Cycle {
    20_000_000_000 / u64::from(nodes).min(10)
}

/// Compute times are exponential.
fn play_random(nodes: u16, mut bytes: impl FnMut(&mut Pcg32) -> u32) -> Outcome {
    let mut random = Pcg32::seed_from_u64(u64::from(nodes));
    play(&settings(nodes, BYTE_A_CYCLE), move |_: NodeId, now| {
        let compute_cycles = exponential(&mut random, NETWORK.compute_cycles) as u64;
        Ok((now < until(nodes)).then(|| fetch(compute_cycles, bytes(&mut random))))
    })
}

#[track_caller]
fn assert_near(outcome: &Outcome, load: &Load, error_max: f64) {
    let nodes = load.nodes;
    let near = |what: &str, got: f64, expected: f64| {
        let error = (got / expected - 1.0).abs();
        assert!(error < error_max, "{what} of {nodes} nodes: {got}, expected {expected}, off by {error:.4}");
    };
    near("throughput", outcome.transactions as f64 / outcome.cycles as f64, load.throughput);
    near("utilisation", outcome.utilisation, load.utilisation);
    near("efficiency", outcome.efficiency, load.efficiency);
    // The wait itself is 0 of one node.
    let response = |wait: f64| wait + NETWORK.service_cycles;
    near("response", response(outcome.wait_mean_cycles), response(load.wait_cycles));
}

#[test]
fn mean_value_analysis_is_the_machine_repairmans_sum() {
    let r = NETWORK.service_cycles / NETWORK.compute_cycles;
    for load in NETWORK.exponential_service(64) {
        let mut term = 1.0;
        let sum: f64 = (0..=load.nodes)
            .map(|n| {
                let this = term;
                term *= f64::from(load.nodes - n.min(load.nodes)) * r;
                this
            })
            .sum();
        assert!((load.utilisation - (1.0 - 1.0 / sum)).abs() < 1e-12, "{load:?}");
    }
}

#[test]
fn one_and_two_nodes_with_fixed_service_are_as_by_hand() {
    let loads = NETWORK.fixed_service(2);
    assert!((loads[0].utilisation - 1.0 / 11.0).abs() < 1e-15);
    assert_eq!(loads[0].wait_cycles, 0.0);
    // While one is served, the other comes with probability 1 - exp(-S / Z); whoever is left alone begins anew:
    // a busy period has 1 / exp(-S / Z) services on average, and then half a think time passes.
    let busy = 2_000.0 * libm::exp(0.1);
    assert!((loads[1].utilisation - busy / (busy + 10_000.0)).abs() < 1e-12);
}

#[test]
fn random_service_waits_as_mean_value_analysis_says() {
    let loads = NETWORK.exponential_service(64);
    for nodes in NODES {
        let outcome = play_random(nodes, exponential_bytes);
        assert_near(&outcome, &loads[usize::from(nodes) - 1], 0.01);
    }
}

#[test]
fn fixed_service_waits_as_the_finite_source_queue_says() {
    let loads = NETWORK.fixed_service(64);
    for nodes in NODES {
        let outcome = play_random(nodes, |_| 1_999);
        assert_near(&outcome, &loads[usize::from(nodes) - 1], 0.01);
    }
}

#[test]
fn how_think_times_are_spread_does_not_matter_where_service_is_exponential() {
    let network = ClosedNetwork { latency_cycles: 10_000.0, ..NETWORK };
    let loads = network.exponential_service(64);
    for nodes in [1, 8, 32] {
        let mut random = Pcg32::seed_from_u64(u64::from(nodes));
        let outcome = play(&settings(nodes, BYTE_A_CYCLE), move |_: NodeId, now| {
            let compute_cycles = 10_000 + exponential(&mut random, NETWORK.compute_cycles) as u64;
            Ok((now < until(nodes)).then(|| fetch(compute_cycles, exponential_bytes(&mut random))))
        });
        let load = loads[usize::from(nodes) - 1];
        // What the network calls latency is computed here.
        let efficiency = load.efficiency * network.think_cycles() / network.compute_cycles;
        assert_near(&outcome, &Load { efficiency, ..load }, 0.01);
    }
}

/// How far the formulas are from buses that move 64 bytes at a time, whose think times are exponential. With locked
/// transactions service is fixed, and its formula is exact. Split ones have the bus for different times at their two
/// visits, which no formula here knows.
#[test]
fn formulas_are_as_near_to_real_buses_as_is_said() {
    use Transactions::{Locked, Split};
    for (transactions, latency, random_error_max, fixed_error_max) in
        [(Locked, 8, 0.06, 0.005), (Locked, 100, 0.06, 0.005), (Split, 8, 0.03, 0.06), (Split, 100, 0.15, 0.2)]
    {
        let bus = Bus { transactions, latency, ..Bus::DEFAULT };
        for nodes in [1, 2, 4, 8, 12, 16, 32, 64] {
            let (mut random, mut left) = (Pcg32::seed_from_u64(1), 200_000);
            let outcome = play(&settings(nodes, bus), |_: NodeId, _| {
                left -= i32::from(left > 0);
                Ok((left > 0).then(|| fetch(exponential(&mut random, 100.0) as u64, 64)))
            });
            let network = ClosedNetwork::of(&outcome).expect("has transactions");
            let loads = [network.exponential_service(nodes), network.fixed_service(nodes)];
            for (loads, error_max) in loads.iter().zip([random_error_max, fixed_error_max]) {
                let expected = loads[usize::from(nodes) - 1].efficiency;
                let error = (expected / outcome.efficiency - 1.0).abs();
                assert!(error < error_max, "{bus:?}, {nodes} nodes: {expected}, simulated {}", outcome.efficiency);
            }
        }
    }
}

/// Between what so many transactions a cycle must lie, however think and service times are spread: the least is
/// when each node always finds all others before it, the most when none ever waits or the bus is always held.
fn throughput_bounds(network: &ClosedNetwork, nodes: u16) -> (f64, f64) {
    let (n, think, service) = (f64::from(nodes), network.think_cycles(), network.service_cycles);
    (n / (think + n * service), (n / (think + service)).min(1.0 / service))
}

#[test]
fn bounds_hold_and_meet_at_the_ends() {
    for loads in [NETWORK.exponential_service(256), NETWORK.fixed_service(256)] {
        for load in loads {
            let (least, most) = throughput_bounds(&NETWORK, load.nodes);
            let throughput = least * (1.0 - 1e-12)..=most * (1.0 + 1e-12);
            assert!(throughput.contains(&load.throughput), "{load:?} {throughput:?}");
            assert!(load.speed_up <= f64::from(load.nodes) * (1.0 + 1e-12) && load.speed_up <= NETWORK.knee() + 1e-9);
            assert!(load.utilisation <= 1.0 + 1e-12);
        }
    }
    // Service that does not vary lets fewer wait.
    let pairs = NETWORK.exponential_service(64).into_iter().zip(NETWORK.fixed_service(64));
    assert!(pairs.skip(1).take(20).all(|(random, fixed)| fixed.wait_cycles < random.wait_cycles));
}

#[test]
fn knees_and_bounds_are_their_formulas() {
    assert_eq!(NETWORK.knee(), 11.0);
    assert_eq!(ClosedNetwork { latency_cycles: 4_000.0, ..NETWORK }.knee(), 13.0);
    assert_eq!(saturation_nodes(0.027) as u32, 37);
    let loads = NETWORK.exponential_service(64);
    let largest = |share| largest_nodes(loads.iter().map(|load| (load.nodes, load.efficiency)), share);
    let efficiency = |nodes: u16| loads[usize::from(nodes) - 1].efficiency;
    let nodes = largest(0.8).expect("one node computes for 10/11 of its time");
    assert!(efficiency(nodes) >= 0.8 && efficiency(nodes + 1) < 0.8, "{nodes}");
    assert_eq!(largest(0.95), None);
}

#[test]
fn hundreds_of_nodes_on_a_bus_that_is_never_free() {
    let network = ClosedNetwork { compute_cycles: 0.0, latency_cycles: 0.0, service_cycles: 10.0 };
    for loads in [network.exponential_service(256), network.fixed_service(256)] {
        for load in loads {
            assert!((load.throughput - 0.1).abs() < 1e-12, "{load:?}");
            assert!((load.wait_cycles - 10.0 * f64::from(load.nodes - 1)).abs() < 1e-6, "{load:?}");
        }
    }
}
