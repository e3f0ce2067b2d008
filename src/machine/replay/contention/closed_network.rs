//! What queueing theory expects of nodes that share a bus.
//!
//! Nodes are customers of a closed network: each thinks (computes, and waits for the memory where the bus is free
//! meanwhile), queues for the bus, is served, and thinks again.
//!
//! How near this is to a simulated bus, as `tests/theory.rs` holds it: with exponential think times, locked transactions
//! of one size are exactly the queue with [fixed service](ClosedNetwork::fixed_service), and up to 6% better than
//! [exponential service](ClosedNetwork::exponential_service), whose waits are longer. Split transactions visit the bus
//! twice, for times that differ; as one visit, their efficiency is off by up to 6% with the default latency, and by up
//! to 20% where the latency is many times what the bus is held.
//!
//! All of it is about nodes that think independently of one another. Nodes that trace neighbouring tiles at the same time
//! meet the same empty and the same rich parts of the image together, and wait several times as long, at the same
//! utilisation; tiles in random order come near to the formulas.

use serde::Serialize;

use super::Outcome;

/// Nodes that are all alike; mean cycles a transaction.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ClosedNetwork {
    /// Of compute.
    pub compute_cycles: f64,
    /// Of latency that does not hold the bus: 0 where transactions are locked.
    pub latency_cycles: f64,
    /// Of the bus being held, above 0.
    pub service_cycles: f64,
}

/// How a number of nodes fares.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Load {
    pub nodes: u16,
    /// Transactions a cycle, of all nodes.
    pub throughput: f64,
    /// Mean cycles for which a transaction waits to be granted the bus.
    pub wait_cycles: f64,
    /// Share of time in which the bus is held.
    pub utilisation: f64,
    /// Share of a node's time in which it computes.
    pub efficiency: f64,
    /// Throughput in that of one node.
    pub speed_up: f64,
}

impl ClosedNetwork {
    /// The network whose means a simulation had; `None` without a transaction. Any number of nodes will do, but their
    /// compute and their transactions should not depend on it.
    pub fn of(outcome: &Outcome) -> Option<Self> {
        Self::of_each(std::slice::from_ref(outcome))
    }

    /// The same of several buses alike, whose means are those of all transactions.
    pub fn of_each(outcomes: &[Outcome]) -> Option<Self> {
        let all = |part: fn(&Outcome) -> f64| outcomes.iter().map(part).sum::<f64>();
        let transactions =
            Some(all(|outcome| outcome.transactions as f64)).filter(|&transactions| transactions > 0.0)?;
        let mean = |part| all(part) / transactions;
        let waited = |outcome: &Outcome| outcome.wait_mean_cycles * outcome.transactions as f64;
        let service_cycles = mean(|outcome| outcome.bus_busy_cycles as f64);
        Some(Self {
            compute_cycles: mean(|outcome| outcome.compute_cycles as f64),
            latency_cycles: (mean(|outcome| outcome.stall_cycles as f64) - mean(waited) - service_cycles).max(0.0),
            service_cycles,
        })
    }

    /// Z: all that a transaction takes of a node while it neither has nor wants the bus.
    pub fn think_cycles(&self) -> f64 {
        self.compute_cycles + self.latency_cycles
    }

    /// N* = (Z + S) / S: with fewer nodes, the bus could serve each without waiting; with more, it cannot.
    pub fn knee(&self) -> f64 {
        (self.think_cycles() + self.service_cycles) / self.service_cycles
    }

    /// For 1 to `nodes_max` nodes by exact mean value analysis: think times of any kind, service times exponential, first
    /// come first served.
    ///
    /// M. Reiser, S. S. Lavenberg, "Mean-Value Analysis of Closed Multichain Queuing Networks", JACM 27(2), 1980.
    pub fn exponential_service(&self, nodes_max: u16) -> Vec<Load> {
        let mut queue = 0.0;
        let of = |nodes| {
            // Who arrives finds what one node fewer would leave.
            let response = self.service_cycles * (1.0 + queue);
            let throughput = f64::from(nodes) / (self.think_cycles() + response);
            queue = throughput * response;
            self.load(nodes, throughput)
        };
        (1..=nodes_max).map(of).collect()
    }

    /// For 1 to `nodes_max` nodes by the finite-source queue M/D/1//N: think times exponential, service times all the
    /// same, first come first served. A bus that moves lines of one size is nearer to this.
    ///
    /// H. Takagi, "Queueing Analysis", vol. 2: "Finite Systems", 1993, after L. Takács, 1962: the mean busy period is
    /// S Σₙ C(N − 1, n) Πᵢ₌₁ₙ (1 / B*(i / Z) − 1) for n from 0 to N − 1, B* the Laplace transform of service times.
    pub fn fixed_service(&self, nodes_max: u16) -> Vec<Load> {
        let of = |nodes: u16| {
            let (mut term, mut sum) = (1.0, 1.0);
            for i in 1..nodes {
                let (i, left) = (f64::from(i), f64::from(nodes - i));
                term *= left / i * libm::expm1(i * self.service_cycles / self.think_cycles());
                sum += term;
            }
            let idle_cycles = self.think_cycles() / f64::from(nodes);
            // Sums too large for a number are those of a bus that is never free.
            let utilisation = 1.0 / (1.0 + idle_cycles / (self.service_cycles * sum));
            self.load(nodes, utilisation / self.service_cycles)
        };
        (1..=nodes_max).map(of).collect()
    }

    fn load(&self, nodes: u16, throughput: f64) -> Load {
        let alone_cycles = self.think_cycles() + self.service_cycles;
        let transaction_cycles = f64::from(nodes) / throughput;
        Load {
            nodes,
            throughput,
            wait_cycles: (transaction_cycles - alone_cycles).max(0.0),
            utilisation: throughput * self.service_cycles,
            efficiency: self.compute_cycles / transaction_cycles,
            speed_up: throughput * alone_cycles,
        }
    }
}

/// The paper's bound: with `misses_per_access` of a node's accesses on the bus, and each of them as long as one of the
/// local memory, so many nodes saturate it (1 / p; 37 for the paper's 0.027). Infinite for no misses.
pub fn saturation_nodes(misses_per_access: f64) -> f64 {
    1.0 / misses_per_access
}

/// The largest number of nodes up to which all reach `share`, of `(nodes, share reached)` in ascending order. What is
/// reached may be the efficiency of a simulation or of a [`Load`], or the speed-up divided by the nodes.
pub fn largest_nodes(reached: impl IntoIterator<Item = (u16, f64)>, share: f64) -> Option<u16> {
    reached.into_iter().take_while(|&(_, reached)| reached >= share).last().map(|(nodes, _)| nodes)
}
