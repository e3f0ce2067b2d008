//! What becomes of recorded references at the end of a run: what holds for all of them is written beside them, and they
//! are replayed and compared with what the nodes counted.

use std::collections::BTreeMap;
use std::io;
use std::path::Path;

use sha2::{Digest, Sha256};

use super::state::State;
use crate::database::{Layout, Section};
use crate::ids::NodeId;
use crate::machine::stats::MemoryStats;
use crate::preparation::Prepared;
use crate::recording::references::{
    FORMAT_VERSION, FileFacts, LEVELS_NAME, LostTile, Recording, Sidecar, cut_torn_tails, octree_levels, scan,
};
use crate::replay::live;
use crate::report::conservation::Check;
use crate::topology::Topology;

/// What is known of a recording before the run begins.
pub(super) struct Facts {
    topology: Topology,
    layout: Layout,
    levels: Vec<u8>,
    scene_sha256: String,
    local_bytes: u64,
}

impl Facts {
    pub(super) fn new(topology: &Topology, prepared: &Prepared, local_bytes: u64) -> Self {
        let database = prepared.database.database();
        Self {
            topology: topology.clone(),
            layout: database.header.layout.clone(),
            levels: octree_levels(&prepared.database),
            scene_sha256: hexadecimal(&Sha256::digest(database.bytes())),
            local_bytes,
        }
    }

    /// Writes the sidecar, and replays what was recorded.
    ///
    /// # Errors
    /// A file of the recording cannot be read or written; the error names it.
    pub(super) fn close(self, state: &State, folder: &Path) -> io::Result<Vec<Check>> {
        self.write_sidecar(state, folder)?;
        let opened = Recording::open(folder).map_err(io::Error::other)?;
        let mut checks = vec![Check::new("faults of the recorded references = 0", opened.faults.len() as u64, 0)];
        let replayed = live::counts(&opened.recording).map_err(io::Error::other)?;
        let accounts = state.ledger.nodes.iter().map(|account| account.memory.clone().unwrap_or_default());
        for ((node, live), replayed) in (0..).map(NodeId).zip(accounts).zip(&replayed) {
            checks.push(Check::new(
                format!("{node}: counters that differ when its references are replayed = 0"),
                differing(&live, replayed),
                0,
            ));
        }
        Ok(checks)
    }

    fn write_sidecar(&self, state: &State, folder: &Path) -> io::Result<()> {
        let levels = folder.join(LEVELS_NAME);
        crate::atomic_file::write(&levels, |file| io::Write::write_all(file, &self.levels))?;
        cut_torn_tails(folder).map_err(io::Error::other)?;
        let scanned = scan(folder, &self.layout).map_err(io::Error::other)?;
        let is_accepted = |tile: &LostTile| state.queue.accepted(tile.tile) == Some(tile.attempt);
        let records: BTreeMap<_, _> = Section::ALL
            .into_iter()
            .map(|section| (section.name().to_owned(), self.layout.span(section).records))
            .collect();
        Sidecar {
            format_version: FORMAT_VERSION,
            marti_version: env!("CARGO_PKG_VERSION").to_owned(),
            scene_sha256: self.scene_sha256.clone(),
            topology: self.topology.to_toml().map_err(io::Error::other)?,
            tiling: state.plan.tiling,
            records,
            local_bytes: self.local_bytes,
            tiles_missing: state.queue.missing(),
            lost: scanned.attempts.into_iter().filter(|tile| !is_accepted(tile)).collect(),
            files: scanned.files,
            octree_levels: FileFacts {
                name: LEVELS_NAME.to_owned(),
                bytes: self.levels.len() as u64,
                crc32c: crc32c::crc32c(&self.levels),
            },
        }
        .write(folder)
    }
}

/// How many of the counters differ.
fn differing(live: &MemoryStats, replayed: &MemoryStats) -> u64 {
    let pairs = live.counters.as_flattened().iter().zip(replayed.counters.as_flattened());
    pairs.filter(|(live, replayed)| live != replayed).count() as u64
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
