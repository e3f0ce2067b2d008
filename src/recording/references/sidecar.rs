//! `references.json`: what holds for all references of a run, written when the run is over.

use std::collections::BTreeMap;
use std::io;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::atomic_file;
use crate::ids::{Attempt, Epoch, NodeId, TileId};
use crate::tracer::Tiling;

/// The sidecar's name.
pub const SIDECAR_NAME: &str = "references.json";

/// By which a reader knows what was recorded, and that all of it is there.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Sidecar {
    pub format_version: u32,
    pub marti_version: String,
    /// Of the database image; hexadecimal.
    pub scene_sha256: String,
    /// The resolved topology: TOML.
    pub topology: String,
    pub tiling: Tiling,
    /// Of each section of the image.
    pub records: BTreeMap<String, u64>,
    /// Of one node's local memory, resolved.
    pub local_bytes: u64,
    /// Tiles that no node finished.
    pub tiles_missing: u32,
    /// Traced, at least in part, and not accepted: their references count for nothing.
    pub lost: Vec<LostTile>,
    /// By node and epoch.
    pub files: Vec<FileFacts>,
    /// The file with the level of each block of eight octree words, a byte each.
    pub octree_levels: FileFacts,
}

/// An attempt at a tile that is not part of the image.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug, Serialize, Deserialize)]
pub struct LostTile {
    pub node: NodeId,
    pub epoch: Epoch,
    pub tile: TileId,
    pub attempt: Attempt,
}

/// By which a reader knows that a file is whole.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct FileFacts {
    pub name: String,
    pub bytes: u64,
    pub crc32c: u32,
}

impl Sidecar {
    /// # Errors
    /// The file cannot be written; the error names it.
    pub fn write(&self, folder: &Path) -> io::Result<()> {
        let json = serde_json::to_string(self).map_err(io::Error::other)?;
        atomic_file::write(&folder.join(SIDECAR_NAME), |file| io::Write::write_all(file, json.as_bytes()))
    }
}
