//! Latency and throughput, as formulas give them.

use super::*;
use crate::hardware::specification::Cluster;
use trace::database::Section;

const WIDTHS: [u32; 7] = [1, 2, 4, 8, 16, 32, 64];
const BOTH: [Transactions; 2] = [Transactions::Locked, Transactions::Split];

#[test]
fn an_unloaded_transaction_takes_address_latency_and_data() {
    for width in WIDTHS {
        for transactions in BOTH {
            for (cycles_per_word, latency) in [(1, 8), (3, 100), (2, 0), (1024, 1_000_000)] {
                for bytes in [0, 1, 16, 33, 64, 256, 8192, u32::MAX] {
                    let bus = Bus { width, transactions, cycles_per_word, latency, ..Bus::DEFAULT };
                    let outcome = play(&settings(1, bus), repeated(1, 3, |_| fetch(5, bytes)));
                    let words = u64::from(bytes).div_ceil(width.into()) + 1;
                    let (data, latency) = (words * u64::from(cycles_per_word), u64::from(latency));
                    assert_eq!(outcome.cycles, 3 * (5 + data + latency), "{bus:?} {bytes}");
                    assert_eq!((outcome.wait_mean_cycles, outcome.wait_max_cycles), (0.0, 0));
                    let held = if transactions == Transactions::Locked { data + latency } else { data };
                    assert_eq!(outcome.bus_busy_cycles, 3 * held);
                    assert_eq!((outcome.compute_cycles, outcome.idle_cycles), (15, 0));
                }
            }
        }
    }
}

#[test]
fn a_saturated_bus_moves_what_its_width_allows() {
    const BYTES: u32 = 64;
    for width in WIDTHS {
        for transactions in BOTH {
            for arbiter in [Arbiter::Fifo, Arbiter::RoundRobin { quantum: 1 }] {
                let bus = Bus { width, transactions, arbiter, ..Bus::DEFAULT };
                let outcome = play(&settings(32, bus), repeated(32, 1000, |_| fetch(0, BYTES)));
                let words = f64::from(BYTES / width);
                let latency = if transactions == Transactions::Locked { f64::from(bus.latency) } else { 0.0 };
                let peak = f64::from(BYTES) / (1.0 + latency + words);
                let throughput = outcome.fetched_bytes as f64 / outcome.cycles as f64;
                assert!((throughput / peak - 1.0).abs() < 0.001, "{bus:?}: {throughput} of {peak} bytes a cycle");
                assert!(outcome.utilisation > 0.999 && outcome.utilisation <= 1.0, "{}", outcome.utilisation);
            }
        }
    }
}

#[test]
fn a_split_bus_overlaps_what_a_locked_one_does_not() {
    // As many nodes as it takes to fill the latency: each has the bus for 2 cycles of 102.
    let bus = Bus { width: 64, latency: 100, transactions: Transactions::Split, ..Bus::DEFAULT };
    let cycles = |bus| play(&settings(51, bus), repeated(51, 100, |_| fetch(0, 64))).cycles;
    assert_eq!(cycles(Bus { transactions: Transactions::Locked, ..bus }), 51 * 100 * 102);
    assert!(cycles(bus) < 100 * 102 + 51 * 102, "{}", cycles(bus));
}

#[test]
fn settings_and_costs_come_from_the_topology() {
    let processor = Processor { octree_node: 20, primitive_test: 60, shading: 200, local_access: 3 };
    let local_memory = crate::hardware::specification::LocalMemory {
        size: crate::hardware::specification::MemorySize::All,
        line: 64,
        ways: None,
        replacement: crate::hardware::specification::Replacement::Lru,
    };
    let cluster = Cluster { count: 1, nodes: 9, processor, local_memory, bus: Bus { width: 8, ..Bus::DEFAULT } };
    let settings = ContentionSettings::from(&cluster);
    assert_eq!(settings, ContentionSettings { nodes: 9, bus: cluster.bus });
    let cycles = ReadCycles::new(&processor);
    assert_eq!(Section::ALL.map(|section| cycles.of(section)), [23, 3, 63, 63, 63, 203, 3, 3, 3]);
}
