//! Every reference that nodes made, kept as data: one Arrow IPC stream a node process, and a sidecar for all.
//!
//! docs/recording.md says how to read them. Each node writes its stream with [`Writer`]; at the end the manager writes
//! what is common to all streams ([`Sidecar`]). [`Recording`] reads both, and is what is replayed.

mod conditions;
mod format;
mod levels;
mod reader;
mod scan;
mod seal;
mod sidecar;
mod torn_tail;
mod writer;

use std::path::Path;

use self::scan::Scan;
use trace::database::Layout;

pub use conditions::Conditions;
pub use format::{FORMAT_VERSION, file_name};
pub use levels::{LEVELS_NAME, octree_levels};
pub use reader::{OpenError, Opened, Recording};
pub use seal::Seal;
pub use sidecar::{FileFacts, LostTile, SIDECAR_NAME, Sidecar};
pub use torn_tail::cut_torn_tails;
pub use writer::Writer;

/// What node processes have left in a folder.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Scanned {
    /// By node and epoch.
    pub files: Vec<FileFacts>,
    /// All attempts at tiles, whole or not, by file.
    pub attempts: Vec<LostTile>,
}

/// Reads what node processes have left in a folder, to write the sidecar.
///
/// # Errors
/// The folder or a file in it cannot be read; the text names it.
pub fn scan(folder: &Path, layout: &Layout) -> Result<Scanned, String> {
    let names = Recording::file_names(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let mut scanned = Scanned::default();
    for (node, epoch, name) in names {
        let scan = Scan::of(&folder.join(name), node, epoch, layout)?;
        let attempt = |tile: &scan::ScannedTile| LostTile { node, epoch, tile: tile.tile, attempt: tile.attempt };
        scanned.attempts.extend(scan.tiles.iter().map(attempt));
        scanned.files.push(scan.facts);
    }
    Ok(scanned)
}

#[cfg(test)]
mod tests;
