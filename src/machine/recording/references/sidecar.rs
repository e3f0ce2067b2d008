//! `references.json`: what holds for all references of a run, written when the run is over.

use std::collections::BTreeMap;
use std::io;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::FORMAT_VERSION;
use crate::recording::sidecar::{self, SidecarFault};
use ground::ids::{Attempt, Epoch, NodeId, TileId};
use trace::picture::Sides;

/// The sidecar's name.
pub const SIDECAR_NAME: &str = "references.json";

/// A longer sidecar is none.
const BYTES_MAX: u64 = 1 << 26;
/// More node processes than this no run has.
const FILES_MAX: usize = 1 << 16;

/// The last key: the checksum of all bytes before it.
const CHECKSUM: &str = ",\"crc32c\":";

/// By which a reader knows what was recorded, and that all of it is there.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Sidecar {
    pub format_version: u32,
    pub marti_version: String,
    /// Of the database image; hexadecimal.
    pub scene_sha256: String,
    /// The resolved topology: TOML.
    pub topology: String,
    pub tiling: Sides,
    /// Of each section of the image; polygons are left out where there are none.
    pub records: BTreeMap<String, u64>,
    /// Bytes of a record of each section; `None` in version 1, whose records have no padding.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub record_bytes: Option<BTreeMap<String, u64>>,
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

impl sidecar::Sidecar for Sidecar {
    const NAME: &'static str = SIDECAR_NAME;
    const FORMAT_VERSION: u32 = FORMAT_VERSION;
    const BYTES_MAX: u64 = BYTES_MAX;
}

impl Sidecar {
    /// # Errors
    /// The file cannot be written; the error names it.
    pub fn write(&self, folder: &Path) -> io::Result<()> {
        let mut json = serde_json::to_string(self)?;
        // The closing brace.
        json.pop();
        sidecar::write::<Self>(folder, &format!("{json}{CHECKSUM}{}}}\n", crc32c::crc32c(json.as_bytes())))
    }

    /// Reads the sidecar of a folder, and what is wrong with it all the same.
    ///
    /// # Errors
    /// It is not there, or nothing can be made of it.
    pub fn read(folder: &Path) -> Result<(Self, Option<String>), String> {
        let (sidecar, text) = sidecar::read::<Self>(folder).map_err(|fault| match fault {
            SidecarFault::Io(error) => error.to_string(),
            SidecarFault::Long(_) => format!("more than {BYTES_MAX} bytes, expected a sidecar"),
            SidecarFault::Json(error) => format!("{error}, expected the sidecar of recorded references"),
            SidecarFault::Version { found, .. } => {
                format!("version {found} of the format, expected 1 to {FORMAT_VERSION}")
            }
        })?;
        if sidecar.files.len() > FILES_MAX {
            return Err(format!("{} files, expected at most {FILES_MAX}", sidecar.files.len()));
        }
        Ok((sidecar, checksum_fault(&text)))
    }
}

fn checksum_fault(text: &[u8]) -> Option<String> {
    let last = text.windows(CHECKSUM.len()).rposition(|window| window == CHECKSUM.as_bytes());
    let told = last.and_then(|at| {
        let number = std::str::from_utf8(&text[at + CHECKSUM.len()..]).ok()?.trim_end().strip_suffix('}')?;
        Some((crc32c::crc32c(&text[..at]), number.parse::<u32>().ok()?))
    });
    match told {
        Some((found, expected)) if found == expected => None,
        Some((found, expected)) => Some(format!(
            "crc32c of what stands before it is {found:#010x}, expected {expected:#010x}: what it says of the run may be \
             wrong, the files beside it can be used as far as they agree with it"
        )),
        None => Some(
            "expected a crc32c as its last key: what it says of the run may be wrong, the files beside it can be used as \
             far as they agree with it"
                .to_owned(),
        ),
    }
}
