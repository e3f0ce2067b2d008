//! The options that vary a setting.

use clap::Args;

use super::lists::{BusWidth, LineBytes, List, NodeCount, Size, WayCount, arbiter};
use machine::replay::plan::grid::Grid;
use machine::replay::plan::setting::{ArbiterName, Assignment, Policy};
use machine::tile_order::TileOrder;

#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "What is varied")]
pub(in crate::cli) struct GridOptions {
    /// Sizes of a node's local memory: "all", shares such as 1/8, bytes such as "64 KiB"; ranges double
    #[arg(long, value_name = "LIST")]
    local_memory: Option<List<Size>>,
    /// Bytes of a line, 16 to 256, of a trace of others up to 65536; ranges double
    #[arg(long, value_name = "LIST")]
    line: Option<List<LineBytes>>,
    /// Lines of a set, or full; ranges double
    #[arg(long, value_name = "LIST")]
    ways: Option<List<WayCount>>,
    /// Which line of a full set gives way
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
}

fn tile_order(text: &str) -> Result<TileOrder, String> {
    let orders = [TileOrder::Scanline, TileOrder::Morton, TileOrder::Random];
    let found = orders.into_iter().find(|order| order.to_string() == text);
    found.ok_or_else(|| "expected scanline, morton or random".to_owned())
}

/// Columns of a row that are settings.
pub(super) const SETTINGS: [&str; 10] = [
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
];

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
        }
    }

    pub(super) fn has_nodes(&self) -> bool {
        self.nodes.is_some()
    }

    /// What decides nothing but times.
    pub(in crate::cli) fn varies_bus(&self) -> bool {
        self.bus_width.is_some() || !self.arbiter.is_empty()
    }
}
