//! The file beside a recording by which a reader knows what it is of and that it is whole: JSON.

use std::fs::File;
use std::io::{self, Read, Write};
use std::path::Path;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::frames::ReadAt;
use ground::atomic_file;
use ground::regular_file;

/// How much of a file is summed at once.
const CHECK_BYTES: u64 = 1 << 18;

/// What a sidecar of one kind says.
pub(super) trait Sidecar: Serialize + DeserializeOwned {
    const NAME: &'static str;
    /// The newest; all from 1 on can be read.
    const FORMAT_VERSION: u32;
    /// A longer file is none.
    const BYTES_MAX: u64;
}

/// Why a file is no sidecar of this version.
pub(super) enum SidecarFault {
    Io(io::Error),
    /// So many bytes.
    Long(u64),
    Json(serde_json::Error),
    /// Of another version, or of a recording that is not complete.
    Version {
        found: u32,
        complete: bool,
    },
}

impl From<io::Error> for SidecarFault {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

impl From<serde_json::Error> for SidecarFault {
    fn from(error: serde_json::Error) -> Self {
        Self::Json(error)
    }
}

/// Reads the sidecar of a folder, and its text.
pub(super) fn read<S: Sidecar>(folder: &Path) -> Result<(S, Vec<u8>), SidecarFault> {
    #[derive(Deserialize)]
    struct Version {
        format_version: u32,
        #[serde(default = "yes")]
        complete: bool,
    }
    fn yes() -> bool {
        true
    }
    let file = regular_file::open(&folder.join(S::NAME))?;
    let bytes = file.metadata()?.len();
    if bytes > S::BYTES_MAX {
        return Err(SidecarFault::Long(bytes));
    }
    let mut text = Vec::new();
    file.take(S::BYTES_MAX).read_to_end(&mut text)?;
    let Version { format_version: found, complete } = serde_json::from_slice(&text)?;
    if !(1..=S::FORMAT_VERSION).contains(&found) || !complete {
        return Err(SidecarFault::Version { found, complete });
    }
    Ok((serde_json::from_slice(&text)?, text))
}

/// Writes a sidecar's text.
///
/// # Errors
/// The file cannot be written; the error names it.
pub(super) fn write<S: Sidecar>(folder: &Path, text: &str) -> io::Result<()> {
    atomic_file::write(&folder.join(S::NAME), |file| file.write_all(text.as_bytes()))
}

/// The checksum of so many bytes of a file, read in pieces.
///
/// # Errors
/// They are not there, or cannot be read.
pub(super) fn checksum(file: &File, bytes: u64) -> io::Result<u32> {
    let mut buffer = vec![0; bytes.min(CHECK_BYTES) as usize];
    let (mut offset, mut crc32c) = (0, 0);
    while offset < bytes {
        let part = &mut buffer[..(bytes - offset).min(CHECK_BYTES) as usize];
        ReadAt::read_exact_at(file, part, offset)?;
        crc32c = crc32c::crc32c_append(crc32c, part);
        offset += part.len() as u64;
    }
    Ok(crc32c)
}
