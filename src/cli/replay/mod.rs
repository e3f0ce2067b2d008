//! `marti replay RECORDING`

mod contention;
mod curve;
mod lists;
pub(super) mod table;

use std::path::PathBuf;

use clap::Args;

use self::lists::{BusWidth, LineBytes, List, NodeCount, Size, WayCount};
use self::table::{Format, Table};
use super::{Failure, print};
use crate::recording::references::{Opened, Recording};
use crate::replay::evaluation::{Evaluation, Row, evaluate};
use crate::replay::grid::Grid;
use crate::replay::setting::{ArbiterName, Assignment, Policy, Setting};
use crate::topology::TileOrder;

/// Put recorded references through other memories, node counts and buses
///
/// Each option takes a list such as 1,4,9 or a range such as 1..16, 1..64x2 or 1/32..1/4; every combination is
/// simulated. What is not given stays as recorded.
#[derive(Clone, Debug, Args)]
pub struct ReplayArguments {
    /// Folder of a run with `--record references`
    pub recording: PathBuf,
    #[command(flatten)]
    grid: GridOptions,
    /// Print the exact misses of LRU memories of all sizes, by node and of all nodes
    #[arg(long, group = "mode")]
    curve: bool,
    /// Recompute a sample of the curve by brute force
    #[arg(long, requires = "curve")]
    verify: bool,
    /// Print how nodes fare that share a bus, simulated and by formula; default for --nodes: 1..256x2
    #[arg(long, group = "mode")]
    contention: bool,
    /// Also divide misses into compulsory, capacity and conflict misses
    #[arg(long)]
    classes: bool,
    /// Also simulate the buses, in cycles of the recorded cost model
    #[arg(long)]
    timings: bool,
    /// How the table is printed
    #[arg(long, value_enum, default_value_t = Format::Text)]
    format: Format,
    /// Replay what is whole of a damaged recording
    #[arg(long)]
    partial: bool,
}

#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "What is varied")]
pub(super) struct GridOptions {
    /// Sizes of a node's local memory: "all", shares such as 1/8, bytes such as "64 KiB"; ranges double
    #[arg(long, value_name = "LIST")]
    local_memory: Option<List<Size>>,
    /// Bytes of a line, 16 to 256; ranges double
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
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    arbiter: Vec<ArbiterName>,
}

fn tile_order(text: &str) -> Result<TileOrder, String> {
    let orders = [TileOrder::Scanline, TileOrder::Morton, TileOrder::Random];
    let found = orders.into_iter().find(|order| order.to_string() == text);
    found.ok_or_else(|| "expected scanline, morton or random".to_owned())
}

impl GridOptions {
    pub(super) fn grid(&self) -> Grid {
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
}

pub(super) fn replay(arguments: &ReplayArguments) -> Result<(), Failure> {
    let Opened { recording, faults } =
        Recording::open(&arguments.recording).map_err(|error| Failure::bad_input(error.to_string()))?;
    let damage = damage(&faults, arguments.partial)?;
    let recorded = Setting::recorded(&recording.topology);
    let settings = arguments.grid.grid().settings(recorded).map_err(Failure::bad_input)?;
    if arguments.curve {
        return curve::print_curves(&recording, &settings, arguments.format, arguments.verify);
    }
    if arguments.contention {
        let are_nodes_given = arguments.grid.nodes.is_some();
        return contention::print_contention(&recording, &settings, are_nodes_given, arguments.format);
    }
    let varies_bus = !arguments.grid.arbiter.is_empty() || arguments.grid.bus_width.is_some();
    let evaluation = Evaluation { timings: arguments.timings || varies_bus, classes: arguments.classes, damage };
    let rows =
        evaluate(&recording, &settings, &evaluation, |_| {}).map_err(|error| Failure::bad_input(error.to_string()))?;
    print_rows(&rows, arguments.format)
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

fn print_rows(rows: &[Row], format: Format) -> Result<(), Failure> {
    let mut reasons: Vec<&str> = rows.iter().filter_map(|row| row.reason.as_deref()).collect();
    reasons.sort_unstable();
    reasons.dedup();
    print(&Table::new(rows)?.print(format, &SETTINGS)?)?;
    if format == Format::Text {
        reasons.iter().try_for_each(|reason| print(&format!("\napproximate: {reason}\n")))?;
    }
    Ok(())
}

/// Why nothing that comes of a damaged recording is exact.
fn damage(faults: &[String], partial: bool) -> Result<Option<String>, Failure> {
    if faults.is_empty() {
        return Ok(None);
    }
    if !partial {
        let told = faults.iter().map(|fault| format!("\n  {fault}")).collect::<String>();
        return Err(Failure::bad_input(format!(
            "the recording is damaged; --partial replays what is whole of it{told}"
        )));
    }
    for fault in faults {
        eprintln!("warning: {fault}");
    }
    Ok(Some(format!("the recording is damaged: {}", faults.join("; "))))
}
