//! The options that vary a setting.

use clap::Args;

use super::lists::{BusWidth, CycleCount, LineBytes, List, NodeCount, Size, WayCount, WordCycles, arbiter};
use machine::hardware::specification::Transactions;
use machine::replay::plan::grid::Grid;
use machine::replay::plan::setting::{ArbiterName, Assignment, Policy};
use machine::tile_order::TileOrder;

#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Varied settings")]
pub(in crate::cli) struct GridOptions {
    /// Sizes of a node's local memory: "all", shares such as 1/8, bytes such as "64 KiB"; ranges double
    #[arg(long, value_name = "LIST")]
    local_memory: Option<List<Size>>,
    /// Bytes of a line, 16 to 256, of a trace from elsewhere up to 65536; ranges double
    #[arg(long, value_name = "LIST")]
    line: Option<List<LineBytes>>,
    /// Lines of a set, or full; ranges double
    #[arg(long, value_name = "LIST")]
    ways: Option<List<WayCount>>,
    /// Which line of a full set is evicted; lines begin referenced with clock (also clock:1), unreferenced with clock:0
    #[arg(long, value_name = "LIST", value_enum, value_delimiter = ',')]
    replacement: Vec<Policy>,
    /// Processing nodes of a cluster; ranges count
    #[arg(long, value_name = "LIST")]
    nodes: Option<List<NodeCount>>,
    /// Clusters, each with a bus and as many nodes; ranges count
    #[arg(long, value_name = "LIST")]
    clusters: Option<List<NodeCount>>,
    /// In which order tiles are handed out: scanline, morton, random
    #[arg(long, value_name = "LIST", value_parser = tile_order, value_delimiter = ',')]
    tile_order: Vec<TileOrder>,
    /// Which node gets which tile
    #[arg(long, value_name = "LIST", value_enum, value_delimiter = ',')]
    assignment: Vec<Assignment>,
    /// Bytes of a bus word, 1 to 64; ranges double
    #[arg(long, value_name = "LIST")]
    bus_width: Option<List<BusWidth>>,
    /// Who is granted the bus: fifo, round_robin, round_robin:QUANTUM, fixed_priority
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = arbiter)]
    arbiter: Vec<ArbiterName>,
    /// Whether the bus is free while the cluster memory looks for data
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = transactions)]
    transactions: Vec<Transactions>,
    /// Cycles of the cluster memory before the first word of data; ranges double
    #[arg(long, value_name = "LIST")]
    latency: Option<List<CycleCount>>,
    /// Cycles in which a word crosses the bus; ranges double
    #[arg(long, value_name = "LIST")]
    cycles_per_word: Option<List<WordCycles>>,
    /// Cycles of a step to an octree node; ranges double
    #[arg(long, value_name = "LIST")]
    octree_node: Option<List<CycleCount>>,
    /// Cycles of a ray against a triangle, sphere or cone; ranges double
    #[arg(long, value_name = "LIST")]
    primitive_test: Option<List<CycleCount>>,
    /// Cycles of a surface that light falls on; ranges double
    #[arg(long, value_name = "LIST")]
    shading: Option<List<CycleCount>>,
    /// Cycles of a record that is read from local memory, on top of what is done with it; ranges double
    #[arg(long, value_name = "LIST")]
    local_access: Option<List<CycleCount>>,
}

fn transactions(text: &str) -> Result<Transactions, String> {
    let found = [Transactions::Locked, Transactions::Split].into_iter().find(|one| one.to_string() == text);
    found.ok_or_else(|| "expected locked or split".to_owned())
}

fn tile_order(text: &str) -> Result<TileOrder, String> {
    let orders = [TileOrder::Scanline, TileOrder::Morton, TileOrder::Random];
    let found = orders.into_iter().find(|order| order.to_string() == text);
    found.ok_or_else(|| "expected scanline, morton or random".to_owned())
}

/// Columns of a row that are settings, or follow from one.
pub(super) const SETTINGS: [&str; 23] = [
    "local_memory",
    "line",
    "ways",
    "replacement",
    "nodes",
    "clusters",
    "tile_order",
    "assignment",
    "bus_width",
    "arbiter",
    "transactions",
    "latency",
    "cycles_per_word",
    "octree_node",
    "primitive_test",
    "shading",
    "local_access",
    "local_bytes",
    "sets",
    "lines_per_set",
    "node",
    "write_policy",
    "write_allocate",
];

/// Those of [`SETTINGS`] that decide nothing but times.
pub(super) const TIMES: [&str; 9] = [
    "bus_width",
    "arbiter",
    "transactions",
    "latency",
    "cycles_per_word",
    "octree_node",
    "primitive_test",
    "shading",
    "local_access",
];

/// What says nothing of a trace that came from elsewhere: it is of one node, has no tiles, and its words are not known.
pub(super) const OF_RECORDINGS: [&str; 8] =
    ["nodes", "clusters", "tile_order", "assignment", "node", "words_read", "words_moved_per_word_read", "exact"];

/// What says nothing of objects that take one unit each.
pub(super) const OF_LINES: [&str; 5] = ["line", "line_accesses", "line_misses", "words_moved", "local_bytes"];

impl GridOptions {
    pub(in crate::cli) fn grid(&self) -> Grid {
        fn values<T: Copy, U>(list: &Option<List<T>>, value: impl Fn(T) -> U) -> Vec<U> {
            list.iter().flat_map(|list| list.0.iter().map(|&one| value(one))).collect()
        }
        Grid {
            local_memory: values(&self.local_memory, |size| size.0),
            line: values(&self.line, |line| line.0),
            ways: values(&self.ways, |ways| ways.0),
            replacement: self.replacement.clone(),
            nodes: values(&self.nodes, |nodes| nodes.0),
            clusters: values(&self.clusters, |clusters| clusters.0),
            tile_order: self.tile_order.clone(),
            assignment: self.assignment.clone(),
            bus_width: values(&self.bus_width, |width| width.0),
            arbiter: self.arbiter.iter().map(|arbiter| arbiter.0).collect(),
            transactions: self.transactions.clone(),
            latency: values(&self.latency, |cycles| cycles.0),
            cycles_per_word: values(&self.cycles_per_word, |cycles| cycles.0),
            octree_node: values(&self.octree_node, |cycles| cycles.0),
            primitive_test: values(&self.primitive_test, |cycles| cycles.0),
            shading: values(&self.shading, |cycles| cycles.0),
            local_access: values(&self.local_access, |cycles| cycles.0),
        }
    }

    /// Whether anything is varied that decides nothing but times.
    pub(in crate::cli) fn varies_times(&self) -> bool {
        let cycles = [&self.latency, &self.octree_node, &self.primitive_test, &self.shading, &self.local_access];
        self.bus_width.is_some()
            || self.cycles_per_word.is_some()
            || !self.arbiter.is_empty()
            || !self.transactions.is_empty()
            || cycles.iter().any(|list| list.is_some())
    }
}
