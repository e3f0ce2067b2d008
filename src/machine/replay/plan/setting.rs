//! A machine that recorded references are put through.

use std::fmt;

use serde::Serialize;

use crate::hardware::specification::{self, Arbiter, Bus, Cluster, MemorySize, Processor, Transactions};
use crate::tile_order::TileOrder;

/// Which line of a full set is evicted.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug, Serialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Policy {
    Lru,
    Fifo,
    #[value(alias = "clock:1")]
    Clock,
    #[value(name = "clock:0")]
    #[serde(rename = "clock:0")]
    Clock0,
    Random,
    Srrip,
    Sieve,
    #[value(name = "s3-fifo", alias = "s3_fifo")]
    #[serde(rename = "s3-fifo")]
    S3Fifo,
    Plru,
    /// The line that is not needed for the longest time to come: the bound of all policies.
    Optimal,
}

impl From<specification::Replacement> for Policy {
    fn from(replacement: specification::Replacement) -> Self {
        match replacement {
            specification::Replacement::Lru => Self::Lru,
            specification::Replacement::Fifo => Self::Fifo,
            specification::Replacement::Clock => Self::Clock,
            specification::Replacement::Random => Self::Random,
            specification::Replacement::Clock0 => Self::Clock0,
            specification::Replacement::Srrip => Self::Srrip,
            specification::Replacement::Sieve => Self::Sieve,
            specification::Replacement::S3Fifo => Self::S3Fifo,
            specification::Replacement::Plru => Self::Plru,
        }
    }
}

impl Policy {
    /// That of a local memory; `None` for [`Self::Optimal`], which no memory has.
    pub fn replacement(self) -> Option<specification::Replacement> {
        match self {
            Self::Lru => Some(specification::Replacement::Lru),
            Self::Fifo => Some(specification::Replacement::Fifo),
            Self::Clock => Some(specification::Replacement::Clock),
            Self::Clock0 => Some(specification::Replacement::Clock0),
            Self::Random => Some(specification::Replacement::Random),
            Self::Srrip => Some(specification::Replacement::Srrip),
            Self::Sieve => Some(specification::Replacement::Sieve),
            Self::S3Fifo => Some(specification::Replacement::S3Fifo),
            Self::Plru => Some(specification::Replacement::Plru),
            Self::Optimal => None,
        }
    }
}

/// As it is typed.
impl fmt::Display for Policy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

/// Which node gets which tile.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug, Serialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Assignment {
    /// The one that had it.
    Recorded,
    /// The one that asks first, in simulated cycles.
    #[value(alias = "on_demand")]
    OnDemand,
    /// The i-th tile goes to node i mod nodes.
    Interleaved,
}

impl Assignment {
    /// Why a live run need not count the same; `None` where it counts the same.
    pub fn is_approximate(self) -> Option<&'static str> {
        /// What is known of no live run.
        const ON_DEMAND: &str = "on demand, tiles go to the nodes that are first by the topology's cost model, which no live \
                                 run follows exactly";
        (self == Self::OnDemand).then_some(ON_DEMAND)
    }
}

/// Everything that a replay can vary.
#[derive(Clone, Copy, PartialEq, Debug, Serialize)]
#[serde(into = "Columns")]
pub struct Setting {
    pub local_memory: MemorySize,
    /// Bytes.
    pub line: u32,
    /// `None`: fully associative.
    pub ways: Option<u32>,
    pub replacement: Policy,
    /// A cluster.
    pub nodes: u16,
    pub clusters: u16,
    pub tile_order: TileOrder,
    pub assignment: Assignment,
    /// What a transaction costs. It decides times, and no count but those of on-demand assignment.
    pub bus: Bus,
    /// What computing costs, as `bus` does.
    pub processor: Processor,
}

/// A setting as a row shows it: under the names of the options.
#[derive(Serialize)]
struct Columns {
    local_memory: String,
    line: u32,
    ways: Option<u32>,
    replacement: Policy,
    nodes: u16,
    clusters: u16,
    tile_order: TileOrder,
    assignment: Assignment,
    bus_width: u32,
    /// As it is typed: the quantum after a colon.
    arbiter: String,
    transactions: Transactions,
    latency: u32,
    cycles_per_word: u32,
    octree_node: u32,
    primitive_test: u32,
    shading: u32,
    local_access: u32,
}

impl From<Setting> for Columns {
    fn from(setting: Setting) -> Self {
        let Setting { local_memory, line, ways, replacement, nodes, clusters, tile_order, assignment, bus, processor } =
            setting;
        let Bus { arbiter, width, cycles_per_word, latency, transactions } = bus;
        let Processor { octree_node, primitive_test, shading, local_access } = processor;
        Self {
            local_memory: local_memory.to_string(),
            line,
            ways,
            replacement,
            nodes,
            clusters,
            tile_order,
            assignment,
            bus_width: width,
            arbiter: ArbiterName(arbiter).to_string(),
            transactions,
            latency,
            cycles_per_word,
            octree_node,
            primitive_test,
            shading,
            local_access,
        }
    }
}

impl Setting {
    /// That of a recorded run.
    pub fn recorded(cluster: &Cluster, tile_order: TileOrder) -> Self {
        let Cluster { count, nodes, local_memory, bus, processor } = *cluster;
        Self {
            local_memory: local_memory.size,
            line: local_memory.line,
            ways: local_memory.ways,
            replacement: local_memory.replacement.into(),
            nodes,
            clusters: count,
            tile_order,
            assignment: Assignment::Recorded,
            bus,
            processor,
        }
    }

    /// For a trace that came from elsewhere: one node with an eighth of what it referenced, lines of 64 bytes.
    pub fn imported() -> Self {
        Self {
            local_memory: MemorySize::Share { numerator: 1, denominator: 8 },
            line: 64,
            ways: None,
            replacement: Policy::Lru,
            nodes: 1,
            clusters: 1,
            tile_order: TileOrder::Scanline,
            assignment: Assignment::Recorded,
            bus: Bus::DEFAULT,
            processor: Processor::DEFAULT,
        }
    }

    /// The topology's words for its local memory; [`Policy::Optimal`] has none, and LRU stands for it.
    pub fn memory(&self) -> specification::LocalMemory {
        let replacement = self.replacement.replacement().unwrap_or(specification::Replacement::Lru);
        specification::LocalMemory { size: self.local_memory, line: self.line, ways: self.ways, replacement }
    }

    /// Of all clusters together.
    pub fn all_nodes(&self) -> u32 {
        u32::from(self.nodes) * u32::from(self.clusters)
    }
}

/// An arbiter as it is typed.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct ArbiterName(pub Arbiter);

impl fmt::Display for ArbiterName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Arbiter::Fifo => f.write_str("fifo"),
            Arbiter::RoundRobin { quantum: 1 } => f.write_str("round_robin"),
            Arbiter::RoundRobin { quantum } => write!(f, "round_robin:{quantum}"),
            Arbiter::FixedPriority => f.write_str("fixed_priority"),
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::ValueEnum;

    use super::*;

    #[test]
    fn policies_are_spelled_the_same_everywhere() {
        for policy in Policy::value_variants() {
            let typed = policy.to_possible_value().expect("none is hidden");
            assert_eq!(typed.get_name(), policy.to_string());
            let Some(replacement) = policy.replacement() else {
                assert_eq!(*policy, Policy::Optimal);
                continue;
            };
            assert_eq!(replacement.to_string(), policy.to_string());
            assert_eq!(Policy::from(replacement), *policy);
            for name in typed.get_name_and_aliases() {
                let read: specification::Replacement = serde_json::from_value(name.into()).expect("a topology's word");
                assert_eq!(read, replacement, "{name}");
            }
        }
    }
}
