//! What a simulation of contention needs to know.

use serde::Serialize;

use crate::hardware::specification::{Bus, Cluster};

/// The part of a topology that decides times on the bus; what is computed meanwhile is the workload's.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ContentionSettings {
    /// Processing nodes, 1 to 256.
    pub nodes: u16,
    /// With the arbiter.
    pub bus: Bus,
}

impl From<&Cluster> for ContentionSettings {
    fn from(cluster: &Cluster) -> Self {
        Self { nodes: cluster.nodes, bus: cluster.bus }
    }
}
