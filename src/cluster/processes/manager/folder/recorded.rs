//! What becomes of recorded references at the end of a run: what holds for all of them is written beside them, and they
//! are replayed and compared with what the nodes counted.

use std::io;
use std::path::Path;

use crate::processes::manager::state::State;
use crate::report::conservation::Check;
use crate::topology::Topology;
use crate::topology::recorded::open_references;
use ground::ids::NodeId;
use machine::hardware::stats::MemoryStats;
use machine::recording::references::{Seal, octree_levels};
use machine::replay::model::live;
use trace::picture::Tiling;
use trace::preparation::Prepared;

/// What is known of a recording before the run begins.
///
/// # Errors
/// The topology cannot be written as TOML.
pub(in crate::processes::manager) fn seal(
    topology: &Topology,
    prepared: &Prepared,
    scene_sha256: &[u8; 32],
    tiling: Tiling,
    local_bytes: u64,
) -> io::Result<Seal> {
    let database = prepared.database.database();
    Ok(Seal {
        topology: topology.to_toml().map_err(io::Error::other)?,
        layout: database.header.layout.clone(),
        tiling,
        octree_levels: octree_levels(&prepared.database),
        scene_sha256: scene_sha256.iter().map(|byte| format!("{byte:02x}")).collect(),
        local_bytes,
    })
}

/// Writes what holds for the whole recording, and replays it.
///
/// # Errors
/// A file of the recording cannot be read or written; the error names it.
pub(in crate::processes::manager) fn close(seal: &Seal, state: &State, folder: &Path) -> io::Result<Vec<Check>> {
    seal.put(folder, state.tiles.queue.missing(), |tile| state.tiles.queue.accepted(tile.tile) == Some(tile.attempt))?;
    let opened = open_references(folder).map_err(io::Error::other)?;
    let mut checks = vec![Check::new("faults of the recorded references = 0", opened.faults.len() as u64, 0)];
    let replayed = live::counts(&opened.recording).map_err(io::Error::other)?;
    let accounts = state.tiles.ledger.nodes(state.supervision.plan.cluster.all_nodes());
    let accounts = accounts.into_iter().map(|account| account.memory.unwrap_or_default());
    for ((node, live), replayed) in (0..).map(NodeId).zip(accounts).zip(&replayed) {
        checks.push(Check::new(
            format!("{node}: counters that differ when its references are replayed = 0"),
            differing(&live, replayed),
            0,
        ));
    }
    Ok(checks)
}

/// How many of the counters differ.
fn differing(live: &MemoryStats, replayed: &MemoryStats) -> u64 {
    let pairs = live.counters.as_flattened().iter().zip(replayed.counters.as_flattened());
    pairs.filter(|(live, replayed)| live != replayed).count() as u64
}
