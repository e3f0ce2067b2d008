//! From the state at the end of a run to its report.

use std::time::Duration;

use super::RunError;
use super::ending::Cause;
use super::state::State;
use crate::database::Layout;
use crate::ids::NodeId;
use crate::machine::local_memory::Geometry;
use crate::machine::stats::MemoryStats;
use crate::preparation::Prepared;
use crate::protocol::control::Packets;
use crate::report::conservation::{Books, Check, Conservation, NodeBook};
use crate::report::{
    Bus, Image, Kernel, Memory, Node, NodeMemory, Octree, Rays, Report, SCHEMA_VERSION, Scene, Seconds, Status, Tests,
    Tiles,
};
use crate::topology::{MemorySize, Topology};
use crate::tracer::octree::census::Census;

/// What is known of a run before it begins.
pub(super) struct Facts {
    scene: Scene,
    /// Without accesses.
    octree: Octree,
    load: Duration,
    build: Duration,
    local_bytes: u64,
}

impl Facts {
    pub(super) fn new(topology: &Topology, prepared: &Prepared, local_bytes: u64) -> Self {
        let header = &prepared.database.database().header;
        Self {
            scene: Scene {
                source: topology.scene.to_string(),
                primitives: header.scene_primitives,
                database_bytes: header.layout.image_bytes(),
            },
            octree: Octree::new(&Census::of(&prepared.database)),
            load: prepared.load,
            build: prepared.build,
            local_bytes,
        }
    }
}

/// Bytes of one node's local memory, resolved.
///
/// # Errors
/// The topology asks for a memory that cannot be made for this image.
pub(super) fn local_bytes(topology: &Topology, layout: &Layout) -> Result<u64, RunError> {
    match topology.cluster.local_memory.size {
        MemorySize::All => Ok(layout.image_bytes()),
        _ => Ok(Geometry::new(&topology.cluster.local_memory, layout)?.local_bytes()),
    }
}

/// `recorded`: checks of the recording besides those of the books.
pub(super) fn report(state: &State, facts: Facts, recorded: Vec<Check>, total: Duration) -> Report {
    let (ledger, queue, image) = (&state.ledger, &state.queue, &state.plan.view.image);
    let line_bytes = state.plan.cluster.local_memory.line;
    let counted = counted(state);
    let (status, error) = status(state.over());
    let kernel = kernel(state);
    let (octree, tests) = match kernel {
        Some(Kernel::Single) => (facts.octree.with_accesses(&ledger.trace), Some(Tests::new(&ledger.trace))),
        _ => (facts.octree, None),
    };
    let render = ledger.last_tile.zip(ledger.first_tile).map_or(Duration::ZERO, |(last, first)| last - first);
    Report {
        schema_version: SCHEMA_VERSION,
        build: env!("CARGO_PKG_VERSION").to_owned(),
        status,
        error,
        scene: facts.scene,
        image: Image {
            width: image.width,
            height: image.height,
            sha256: ledger.display.as_ref().map(|display| display.sha256.clone()),
            non_finite_pixels: ledger.trace.non_finite_pixels,
            files: ledger.display.as_ref().map_or_else(Vec::new, |display| display.written.clone()),
        },
        kernel,
        rays: Rays::new(&ledger.trace),
        octree,
        tests,
        tiles: Some(Tiles {
            total: u64::from(queue.total()),
            done: u64::from(queue.total() - queue.missing()),
            reissued: queue.reissued(),
            stale: ledger.master.map_or(0, |master| master.attempts_stale)
                + ledger.display.as_ref().map_or(0, |display| display.tiles_stale),
        }),
        nodes: nodes(state, line_bytes),
        memory: (!counted.is_empty()).then(|| {
            let mut all = MemoryStats::default();
            counted.iter().for_each(|book| all.add(&book.memory));
            Memory::new(&all, line_bytes, facts.local_bytes)
        }),
        bus: ledger.bus.map(|bus| Bus {
            transactions: bus.transactions,
            fetches: bus.fetches,
            bytes: bus.fetched_bytes + bus.bulk_bytes,
            message_bytes: bus.message_bytes,
            wire_bytes: bus.wire_bytes,
            log_rows: bus.log_rows,
            log_waits: bus.log_waits,
        }),
        conservation: conservation(state, &counted, line_bytes).map(|books| books.and(recorded)),
        incidents: ledger.incidents(),
        chaos: None,
        seconds: Seconds {
            load: facts.load.as_secs_f64(),
            octree: facts.build.as_secs_f64(),
            render: render.as_secs_f64(),
            render_cpu: Duration::from_nanos(ledger.render_cpu_nanoseconds).as_secs_f64(),
            total: total.as_secs_f64(),
        },
    }
}

fn status(cause: Option<&Cause>) -> (Status, Option<String>) {
    match cause {
        Some(Cause::Complete) => (Status::Done, None),
        Some(Cause::NoNodes) | None => (Status::TilesMissing, None),
        Some(Cause::Interrupted(_)) => (Status::Interrupted, None),
        Some(Cause::Failed(why)) => (Status::Failed, Some(why.clone())),
    }
}

/// `None` where no node came so far as to tell what it derived.
fn kernel(state: &State) -> Option<Kernel> {
    match state.plan.cluster.local_memory.size {
        MemorySize::All => {
            state.ledger.packets.map(|Packets { simd, derived_bytes }| Kernel::Packets { simd, derived_bytes })
        }
        _ => Some(Kernel::Single),
    }
}

/// The nodes that counted accesses.
fn counted(state: &State) -> Vec<NodeBook> {
    let accounts = state.ledger.nodes.iter().enumerate();
    let book = accounts.filter_map(|(node, account)| {
        Some(NodeBook { node: NodeId(node as u16), trace: account.trace.clone(), memory: account.memory.clone()? })
    });
    book.collect()
}

fn nodes(state: &State, line_bytes: u32) -> Vec<Node> {
    let accounts = state.ledger.nodes.iter().enumerate();
    let node = accounts.map(|(node, account)| Node {
        id: node as u16,
        tiles: account.tiles,
        memory: account.memory.as_ref().map(|memory| NodeMemory::new(memory, line_bytes)),
    });
    node.collect()
}

/// `None` when bus or master did not live to close its books.
fn conservation(state: &State, nodes: &[NodeBook], line_bytes: u32) -> Option<Conservation> {
    let (ledger, queue) = (&state.ledger, &state.queue);
    Some(Conservation::of(&Books {
        nodes,
        line_bytes,
        bus: ledger.bus?,
        master: ledger.master?,
        tiles_total: u64::from(queue.total()),
        tiles_done: ledger.nodes.iter().map(|account| account.tiles).sum(),
        tiles_missing: u64::from(queue.missing()),
        attempts_lost: ledger.lost.len() as u64,
    }))
}
