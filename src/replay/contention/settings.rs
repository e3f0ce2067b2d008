//! What a simulation of contention needs to know.

use serde::Serialize;

use crate::topology::{Bus, Cluster, Processor};

/// The part of a topology that decides times.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ContentionSettings {
    /// Processing nodes, 1 to 256.
    pub nodes: u16,
    /// For who makes the workload: see [`ReadCycles`](super::ReadCycles).
    pub processor: Processor,
    /// With the arbiter.
    pub bus: Bus,
}

impl From<&Cluster> for ContentionSettings {
    fn from(cluster: &Cluster) -> Self {
        let &Cluster { nodes, processor, bus, .. } = cluster;
        Self { nodes, processor, bus }
    }
}
