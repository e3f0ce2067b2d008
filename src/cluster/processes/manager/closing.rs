//! From the state at the end of a run to its report.

use std::time::Duration;

use super::RunError;
use super::cause::Cause;
use super::plan::Plan;
use super::state::State;
use crate::protocol::control::Packets;
use crate::report::conservation::{Books, Check, ClusterBook, Conservation, NodeBook};
use crate::report::{
    Bus, Camera, Image, Kernel, Memory, Node, NodeMemory, Octree, Rays, Report, SCHEMA_VERSION, Scene, Seconds, Status,
    Tests, Tiles,
};
use crate::topology::Topology;
use ground::ids::NodeId;
use machine::hardware::local_memory::{Geometry, MemoryShape};
use machine::hardware::specification::MemorySize;
use machine::hardware::stats::MemoryStats;
use trace::database::Layout;
use trace::preparation::Prepared;
use trace::scene::Warning;
use trace::tracer::octree::census::Census;

/// What is known of a run before it begins.
pub(super) struct Facts {
    scene: Scene,
    camera: Camera,
    warnings: Vec<Warning>,
    /// Without accesses.
    octree: Octree,
    load: Duration,
    build: Duration,
    memory: MemoryShape,
}

impl Facts {
    pub(super) fn new(topology: &Topology, prepared: &Prepared, memory: MemoryShape) -> Self {
        Self {
            scene: Scene::new(topology.scene.to_string(), prepared),
            camera: prepared.into(),
            warnings: prepared.warnings.clone(),
            octree: Octree::new(&Census::of(&prepared.database)),
            load: prepared.load,
            build: prepared.build,
            memory,
        }
    }
}

/// One node's local memory, resolved.
///
/// # Errors
/// The topology asks for a memory that cannot be made for this image.
pub(super) fn memory_shape(topology: &Topology, layout: &Layout) -> Result<MemoryShape, RunError> {
    let memory = topology.cluster.local_memory;
    match memory.size {
        // No cache, but the database as it is.
        MemorySize::All => {
            let local_bytes = layout.database_bytes();
            Ok(MemoryShape { local_bytes, sets: 1, lines_per_set: local_bytes / u64::from(memory.line) })
        }
        _ => Ok(Geometry::new(&memory, layout)?.into()),
    }
}

/// `recorded`: checks of the recording besides those of the books.
pub(super) fn report(state: &State, facts: Facts, recorded: Vec<Check>, elapsed: Duration) -> Report {
    let (ledger, queue, image) = (&state.tiles.ledger, &state.tiles.queue, &state.supervision.plan.view.image);
    let total = ledger.total();
    let line_bytes = state.supervision.plan.cluster.local_memory.line;
    let counted = counted(state);
    let conservation = conservation(state, &counted, line_bytes).map(|books| books.and(recorded));
    let imbalance = conservation.as_ref().and_then(Conservation::imbalance);
    let (status, error) = status(state.over(), imbalance.as_deref());
    let kernel = kernel(state);
    let (octree, tests) = match kernel {
        Some(Kernel::Single) => (facts.octree.with_accesses(&total.trace), Some(Tests::new(&total.trace))),
        _ => (facts.octree, None),
    };
    let render = ledger.last_tile.zip(ledger.first_tile).map_or(Duration::ZERO, |(last, first)| last - first);
    Report {
        schema_version: SCHEMA_VERSION,
        build: env!("CARGO_PKG_VERSION").to_owned(),
        status,
        error,
        scene: facts.scene,
        camera: Some(facts.camera),
        image: Image {
            width: image.width(),
            height: image.height(),
            sha256: ledger.display.as_ref().map(|display| display.sha256.clone()),
            non_finite_pixels: total.trace.non_finite_pixels,
            unverified: imbalance.clone(),
            files: ledger.display.as_ref().map_or_else(Vec::new, |display| display.written.clone()),
            // The display may have written where this process cannot read.
            file_sha256: None,
        },
        kernel,
        rays: Rays::new(&total.trace),
        octree,
        tests,
        tiles: Some(Tiles {
            total: u64::from(queue.total()),
            done: u64::from(queue.total() - queue.missing()),
            reissued: queue.reissued(),
            stale: ledger
                .books
                .values()
                .filter_map(|book| book.master)
                .map(|master| master.attempts_stale)
                .sum::<u64>()
                + ledger.display.as_ref().map_or(0, |display| display.tiles_stale),
            resumed: u64::from(ledger.resumed),
            verified: state.tiles.verification.verified(),
            disagreements: state.tiles.verification.disagreements(),
        }),
        nodes: nodes(state, line_bytes),
        memory: (!counted.is_empty()).then(|| {
            let mut all = MemoryStats::default();
            counted.iter().for_each(|book| all.add(&book.memory));
            Memory::new(&all, &state.supervision.plan.header.layout, line_bytes, facts.memory)
        }),
        bus: bus(state),
        conservation,
        verification: (!state.display.shares.is_empty())
            .then(|| state.tiles.verification.report(&state.display.shares, state.supervision.plan.id)),
        incidents: state.supervision.incidents.all(),
        warnings: facts.warnings,
        chaos: None,
        seconds: Seconds {
            load: facts.load.as_secs_f64(),
            octree: facts.build.as_secs_f64(),
            render: render.as_secs_f64(),
            render_cpu: Duration::from_nanos(total.render_cpu_nanoseconds).as_secs_f64(),
            total: elapsed.as_secs_f64(),
        },
    }
}

fn status(cause: Option<&Cause>, imbalance: Option<&str>) -> (Status, Option<String>) {
    match (cause, imbalance) {
        (Some(Cause::Complete | Cause::NoNodes) | None, Some(imbalance)) => (
            Status::Failed,
            Some(format!("the counts do not agree, and the image is not to be relied on: {imbalance}")),
        ),
        (Some(Cause::Complete), None) => (Status::Done, None),
        (Some(Cause::NoNodes) | None, None) => (Status::TilesMissing, None),
        (Some(Cause::Interrupted(_)), _) => (Status::Interrupted, None),
        (Some(Cause::Failed(why)), _) => (Status::Failed, Some(why.clone())),
    }
}

/// `None` where no node reported its hierarchy.
fn kernel(state: &State) -> Option<Kernel> {
    match state.supervision.plan.cluster.local_memory.size {
        MemorySize::All => {
            state.tiles.ledger.packets.map(|Packets { simd, derived_bytes }| Kernel::Packets { simd, derived_bytes })
        }
        _ => Some(Kernel::Single),
    }
}

/// What crossed the buses that reported at the end; `None` where none did.
pub(super) fn bus(state: &State) -> Option<Bus> {
    let totals = state.tiles.ledger.books.values().filter_map(|book| book.bus);
    totals.map(Bus::from).reduce(Bus::and)
}

/// The nodes that counted accesses.
fn counted(state: &State) -> Vec<NodeBook> {
    let accounts = state.tiles.ledger.nodes(state.supervision.plan.cluster.all_nodes());
    let book = (0..)
        .map(NodeId)
        .zip(accounts)
        .filter_map(|(node, account)| Some(NodeBook { node, trace: account.trace, memory: account.memory? }));
    book.collect()
}

pub(super) fn nodes(state: &State, line_bytes: u32) -> Vec<Node> {
    let Plan { header, cluster, .. } = &state.supervision.plan;
    let accounts = state.tiles.ledger.nodes(cluster.all_nodes());
    let node = (0..).zip(accounts).map(|(id, account)| Node {
        id,
        tiles: account.tiles,
        memory: account.memory.as_ref().map(|memory| NodeMemory::new(memory, &header.layout, line_bytes)),
    });
    node.collect()
}

/// Compares the counts; `None` when no bus and no master reported its totals.
#[cfg(any(test, feature = "testing"))]
pub(super) fn books(state: &State) -> Option<Conservation> {
    conservation(state, &counted(state), state.supervision.plan.cluster.local_memory.line)
}

/// `None` when no bus and no master reported its totals.
fn conservation(state: &State, nodes: &[NodeBook], line_bytes: u32) -> Option<Conservation> {
    let (ledger, queue) = (&state.tiles.ledger, &state.tiles.queue);
    let is_alone = ledger.books.len() == 1;
    let clusters = ledger.books.iter().map(|((cluster, epoch), book)| ClusterBook {
        name: if is_alone { String::new() } else { format!("{cluster} ({epoch}): ") },
        told_done: book.told_done,
        missed: book.missed,
        told_lost: book.lost.len() as u64,
        bus: book.bus,
        master: book.master,
    });
    let clusters: Vec<_> = clusters.collect();
    clusters.iter().find(|book| book.bus.is_some() || book.master.is_some())?;
    Some(Conservation::of(&Books {
        nodes,
        clusters: &clusters,
        line_bytes,
        tiles_total: u64::from(queue.total()),
        tiles_done: ledger.total().tiles,
        tiles_resumed: u64::from(ledger.resumed),
        tiles_missing: u64::from(queue.missing()),
    }))
}
