//! What a simulation ends with.

use serde::Serialize;

use super::Cycle;
use ground::ids::NodeId;

/// All nodes together. Compute, stall and idle cycles add up to `cycles` times the number of nodes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Outcome {
    /// Until the last node was done.
    pub cycles: Cycle,
    /// By node.
    pub nodes: Vec<NodeOutcome>,
    pub compute_cycles: Cycle,
    pub stall_cycles: Cycle,
    pub idle_cycles: Cycle,
    /// Of all nodes, as [`NodeOutcome::efficiency`] is of one.
    pub efficiency: f64,
    pub transactions: u64,
    pub fetched_bytes: u64,
    /// Of all transactions but fetches.
    pub message_bytes: u64,
    /// In which the bus was held.
    pub bus_busy_cycles: Cycle,
    /// Share of all cycles in which the bus was held, 0 to 1.
    pub utilisation: f64,
    /// How long a transaction waited to be granted the bus (both times where it is split): its stall beyond what it
    /// takes on a free bus. The mean is exact.
    pub wait_mean_cycles: f64,
    /// 99% of all waits are not longer. Exact below 512, else rounded up by at most 1/256.
    pub wait_percentile_99_cycles: Cycle,
    pub wait_max_cycles: Cycle,
}

/// One node.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NodeOutcome {
    pub node: NodeId,
    pub compute_cycles: Cycle,
    /// From requests to completions: waiting for the bus and being served.
    pub stall_cycles: Cycle,
    /// From the node's end to the last one's.
    pub idle_cycles: Cycle,
    /// Share of compute in compute and stall; 1 of a node that did nothing.
    pub efficiency: f64,
    pub transactions: u64,
    pub bytes: u64,
}

/// Share of compute in both; 1 where there is neither.
pub(super) fn efficiency(compute_cycles: Cycle, stall_cycles: Cycle) -> f64 {
    match compute_cycles + stall_cycles {
        0 => 1.0,
        cycles => compute_cycles as f64 / cycles as f64,
    }
}
