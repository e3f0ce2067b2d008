//! The end of a recording: what holds for all that node processes left in a folder is written beside it.

use std::io;
use std::path::Path;

use super::{FileFacts, LEVELS_NAME, LostTile, Sidecar, cut_torn_tails, scan};
use crate::recording::metadata;
use ground::atomic_file;
use trace::database::Layout;
use trace::picture::Tiling;

/// What was recorded.
#[derive(Clone, Debug)]
pub struct Seal {
    /// Of the run, as TOML.
    pub topology: String,
    pub layout: Layout,
    pub tiling: Tiling,
    /// By block of eight octree words.
    pub octree_levels: Vec<u8>,
    /// Of the database image; hexadecimal.
    pub scene_sha256: String,
    /// Of one node's local memory.
    pub local_bytes: u64,
}

impl Seal {
    /// Cuts what processes that were killed left half written, and writes the levels of the octree and the sidecar.
    ///
    /// # Errors
    /// A file cannot be read or written; the error names it.
    pub fn put(&self, folder: &Path, tiles_missing: u32, is_accepted: impl Fn(&LostTile) -> bool) -> io::Result<()> {
        let levels = &self.octree_levels;
        atomic_file::write(&folder.join(LEVELS_NAME), |file| io::Write::write_all(file, levels))?;
        cut_torn_tails(folder).map_err(io::Error::other)?;
        let scanned = scan(folder, &self.layout).map_err(io::Error::other)?;
        let by_name = |numbers: Vec<(&str, u64)>| numbers.into_iter().map(|(name, n)| (name.to_owned(), n)).collect();
        Sidecar {
            format_version: metadata::format_version(&self.layout),
            marti_version: env!("CARGO_PKG_VERSION").to_owned(),
            scene_sha256: self.scene_sha256.clone(),
            topology: self.topology.clone(),
            tiling: self.tiling.sides(),
            records: by_name(metadata::records(&self.layout)),
            record_bytes: metadata::record_bytes(&self.layout).map(by_name),
            local_bytes: self.local_bytes,
            tiles_missing,
            lost: scanned.attempts.into_iter().filter(|tile| !is_accepted(tile)).collect(),
            files: scanned.files,
            octree_levels: FileFacts {
                name: LEVELS_NAME.to_owned(),
                bytes: levels.len() as u64,
                crc32c: crc32c::crc32c(levels),
            },
        }
        .write(folder)
    }
}
