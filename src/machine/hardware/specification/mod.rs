//! What a cluster is made of, as asked for: values within their ranges, from wherever they come.

mod memory_size;

use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use self::memory_size::{BYTES_MAX, NotASize};
use ground::ids::{ClusterId, NodeId};

/// Clusters of one kind: how many, and what each is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cluster {
    /// Clusters of this kind, each with a bus, a master and nodes of its own, 1 to 64.
    pub count: u16,
    /// Processing nodes of each, 1 to 256. Node ids go on from cluster to cluster.
    pub nodes: u16,
    pub processor: Processor,
    pub local_memory: LocalMemory,
    pub bus: Bus,
}

impl Cluster {
    /// Processing nodes of all clusters.
    pub fn all_nodes(&self) -> u16 {
        self.count * self.nodes
    }

    /// The cluster that a node belongs to.
    pub fn of(&self, node: NodeId) -> ClusterId {
        ClusterId(node.0 / self.nodes)
    }

    /// The first node of a cluster.
    pub fn first_node(&self, cluster: ClusterId) -> NodeId {
        NodeId(cluster.0 * self.nodes)
    }

    pub fn ids(&self) -> impl Iterator<Item = ClusterId> + use<> {
        (0..self.count).map(ClusterId)
    }
}

/// What a processing node's work costs, cycles, each 0 to 1,000,000. A model that a replay applies to what was counted:
/// no live process knows of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Processor {
    /// Of a step to an octree node.
    pub octree_node: u32,
    /// Of a ray against a triangle, sphere or cone.
    pub primitive_test: u32,
    /// Of a surface that light falls on.
    pub shading: u32,
    /// Of a record that is read from local memory, whatever it is.
    pub local_access: u32,
}

impl Processor {
    /// Of the order of a floating-point microprocessor of 1991: a few cycles an operation, tens of operations a test.
    pub const DEFAULT: Self = Self { octree_node: 20, primitive_test: 60, shading: 200, local_access: 1 };
}

/// The local memory of a processing node: a cache of lines of the database.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LocalMemory {
    /// How much of the database it can have at a time.
    pub size: MemorySize,
    /// Bytes, a power of two, 16 to 256.
    pub line: u32,
    /// Lines a set; `None`: fully associative.
    pub ways: Option<u32>,
    /// Which line of a full set is evicted.
    pub replacement: Replacement,
}

impl LocalMemory {
    /// The longest record spans a few lines, and all of them are held at once.
    pub const LINES_MIN: u64 = 16;
}

/// The size of a local memory. As text: `all`, a share such as `1/8`, or a number of bytes such as `64 KiB`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum MemorySize {
    /// The renderer's mode: the database is pulled once, then read without a check.
    All,
    /// Of the database's bytes, above 0 and at most 1.
    Share { numerator: u32, denominator: u32 },
    /// 1 to [`BYTES_MAX`].
    Bytes(u64),
}

/// Which line of a full set is evicted: the least recently used one, the one that was filled first, the next one that clock's
/// hand finds unreferenced, or one at random. Lines begin referenced with clock, which is also clock:1, and unreferenced with
/// clock:0. Newer ones are static re-reference interval prediction, SIEVE, S3-FIFO and tree pseudo-LRU.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(transform = with_alias)]
pub enum Replacement {
    // No text on the variants: the topology's schema would list them one by one.
    Lru,
    Fifo,
    #[serde(alias = "clock:1")]
    Clock,
    Random,
    // What follows is newer: the wire has a variant's number, so that others are added at the end.
    #[serde(rename = "clock:0")]
    Clock0,
    Srrip,
    Sieve,
    #[serde(rename = "s3-fifo", alias = "s3_fifo")]
    S3Fifo,
    Plru,
}

/// The schema's own list has no aliases.
fn with_alias(schema: &mut schemars::Schema) {
    if let Some(serde_json::Value::Array(names)) = schema.get_mut("enum") {
        names.push("clock:1".into());
    }
}

/// Its name in a topology file.
impl fmt::Display for Replacement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

/// The bus of a cluster: who is granted it, and what a transaction costs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Bus {
    /// Decides which of the waiting requests is granted.
    pub arbiter: Arbiter,
    /// Bytes of a bus word, a power of two, 1 to 64. This and what follows is a model as [`Processor`] is.
    pub width: u32,
    /// Cycles in which a word crosses the bus, 1 to 1024.
    pub cycles_per_word: u32,
    /// Cycles of the cluster memory before the first word of data, 0 to 1,000,000.
    pub latency: u32,
    pub transactions: Transactions,
}

impl Bus {
    /// A bus of 1991: 32 bits a cycle, and a dynamic memory that answers after eight.
    pub const DEFAULT: Self =
        Self { arbiter: Arbiter::Fifo, width: 4, cycles_per_word: 1, latency: 8, transactions: Transactions::Locked };
}

/// Whether the bus is free while the cluster memory looks for the data.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Transactions {
    /// Held from the address to the last word of data.
    #[default]
    Locked,
    /// Held for the address, and again for the data.
    Split,
}

/// Its name in a topology file.
impl fmt::Display for Transactions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

/// Who is granted the bus when several wait.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Arbiter {
    /// The longest waiting.
    Fifo,
    /// Each node in turn may hold the bus for up to `quantum` transactions (1 to 1024).
    RoundRobin { quantum: u32 },
    /// The lowest node id.
    FixedPriority,
}
