//! A recording of references, opened: what it is of, what is whole in it, and its words.

use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

use super::scan::{Place, Scan, facts};
use super::{FORMAT_VERSION, LEVELS_NAME, LostTile, SIDECAR_NAME, Sidecar};
use crate::database::{Layout, Section};
use crate::ids::{Epoch, NodeId};
use crate::machine::references::RecordNumbers;
use crate::machine::trace::{Trace, TraceError, TracedTile};
use crate::recording::frames::ReadAt;
use crate::scene::source::Source;
use crate::topology::Topology;
use crate::tracer::Tiling;

/// A longer sidecar is none.
const SIDECAR_BYTES_MAX: u64 = 1 << 28;

/// Why a recording cannot be opened.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error("{0}")]
pub struct OpenError(String);

/// A recording, and what is wrong with it.
#[derive(Debug)]
pub struct Opened {
    pub recording: Recording,
    /// Each names a file, what is wrong with it, and what can be used all the same; empty for a sound recording.
    pub faults: Vec<String>,
}

/// References of a run, tile by tile. All of it was checked when it was opened; what is read is checked again.
#[derive(Debug)]
pub struct Recording {
    pub topology: Topology,
    pub layout: Layout,
    pub tiling: Tiling,
    pub numbers: RecordNumbers,
    /// Of the database image; hexadecimal.
    pub scene_sha256: String,
    /// Bytes of a node's local memory.
    pub local_bytes: u64,
    /// By block of eight octree words; empty when they are lost.
    pub octree_levels: Vec<u8>,
    /// Reads of records in tiles that were traced to their ends.
    pub references: u64,
    pub lost: Vec<LostTile>,
    files: Vec<(PathBuf, File)>,
    parts: Vec<(u32, Place)>,
    tiles: Vec<TracedTile>,
}

impl Recording {
    /// Opens the recording in a folder: that of the run, or its `recording`.
    ///
    /// # Errors
    /// There is no recording of references, its sidecar cannot be understood, or nothing in it can be used.
    pub fn open(folder: &Path) -> Result<Opened, OpenError> {
        let inner = folder.join("recording");
        let folder = if folder.join(SIDECAR_NAME).exists() || !inner.is_dir() { folder } else { &inner };
        let sidecar = Sidecar::read(folder)?;
        let named = |what: String| OpenError(format!("{}: {what}", folder.join(SIDECAR_NAME).display()));
        let source = Source::from_bytes("references.json, topology", sidecar.topology.as_bytes());
        let topology = Topology::from_source(&source, &[]).map_err(|error| named(error.to_string()))?;
        let mut records = [0; Section::COUNT];
        for section in Section::ALL {
            let found = sidecar.records.get(section.name()).copied();
            records[section as usize] =
                found.ok_or_else(|| named(format!("expected the records of section {}", section.name())))?;
        }
        let layout = Layout::new(records).map_err(|error| named(error.to_string()))?;
        let mut opened = Opened {
            recording: Self {
                topology,
                numbers: RecordNumbers::new(&layout),
                layout,
                tiling: sidecar.tiling,
                scene_sha256: sidecar.scene_sha256.clone(),
                local_bytes: sidecar.local_bytes,
                octree_levels: Vec::new(),
                references: 0,
                lost: sidecar.lost.clone(),
                files: Vec::new(),
                parts: Vec::new(),
                tiles: Vec::new(),
            },
            faults: Vec::new(),
        };
        opened.recording.lost.sort_unstable();
        opened.read_levels(folder, &sidecar);
        opened.read_files(folder, &sidecar);
        opened.check_tiles(&sidecar);
        if opened.recording.tiles.is_empty() && !opened.faults.is_empty() {
            return Err(OpenError(format!("nothing of the recording can be used: {}", opened.faults.join("; "))));
        }
        Ok(opened)
    }

    /// Node processes' files of a folder, in order.
    pub(super) fn file_names(folder: &Path) -> std::io::Result<Vec<(NodeId, Epoch, String)>> {
        let mut names = Vec::new();
        for entry in fs::read_dir(folder)? {
            let name = entry?.file_name().to_string_lossy().into_owned();
            if let Some((node, epoch)) = process_of(&name) {
                names.push((node, epoch, name));
            }
        }
        names.sort_unstable();
        Ok(names)
    }
}

/// The process that a file is of, by its name.
pub(super) fn process_of(name: &str) -> Option<(NodeId, Epoch)> {
    let (node, epoch) = name.strip_prefix("references-n")?.strip_suffix(".arrows")?.split_once("-e")?;
    Some((NodeId(node.parse().ok()?), Epoch(epoch.parse().ok()?)))
}

impl Sidecar {
    /// # Errors
    /// It is not there, or not that of a recording which this version reads.
    pub fn read(folder: &Path) -> Result<Self, OpenError> {
        let path = folder.join(SIDECAR_NAME);
        let named = |what: String| OpenError(format!("{}: {what}", path.display()));
        let file = File::open(&path).map_err(|error| {
        let recorded = Recording::file_names(folder).map_or(0, |names| names.len());
        let what = match recorded {
            0 => "expected the folder of a run with `--record references`, or its folder `recording`".to_owned(),
            files => format!(
                "without it nothing tells what the {files} files of references beside it are of: the run did not end, \
                 or the file was removed"
            ),
        };
        named(format!("{error}: {what}"))
    })?;
        let mut text = Vec::new();
        file.take(SIDECAR_BYTES_MAX + 1).read_to_end(&mut text).map_err(|error| named(error.to_string()))?;
        if text.len() as u64 > SIDECAR_BYTES_MAX {
            return Err(named(format!("more than {SIDECAR_BYTES_MAX} bytes, expected a sidecar")));
        }
        #[derive(serde::Deserialize)]
        struct Version {
            format_version: u32,
        }
        let not_ours =
            |error: serde_json::Error| named(format!("{error}, expected the sidecar of recorded references"));
        let Version { format_version } = serde_json::from_slice(&text).map_err(not_ours)?;
        if format_version != FORMAT_VERSION {
            return Err(named(format!("version {format_version} of the format, expected {FORMAT_VERSION}")));
        }
        serde_json::from_slice(&text).map_err(not_ours)
    }
}

impl Opened {
    fn read_levels(&mut self, folder: &Path, sidecar: &Sidecar) {
        let path = folder.join(LEVELS_NAME);
        let blocks = self.recording.layout.span(Section::OctreeNodes).records / 8;
        let read = File::open(&path).and_then(|file| {
            let found = facts(&path, &file)?;
            if found != sidecar.octree_levels || found.bytes != blocks {
                return Err(std::io::Error::other("is not the file that was recorded"));
            }
            fs::read(&path)
        });
        match read {
            Ok(levels) => self.recording.octree_levels = levels,
            Err(error) => self
                .faults
                .push(format!("{}: {error}: all counts can be used but those by octree level", path.display())),
        }
    }

    fn read_files(&mut self, folder: &Path, sidecar: &Sidecar) {
        for facts in &sidecar.files {
            let path = folder.join(&facts.name);
            let Some((node, epoch)) = process_of(&facts.name) else {
                self.faults.push(format!("{SIDECAR_NAME}: {:?} is no name of a file of references", facts.name));
                continue;
            };
            match Scan::of(&path, node, epoch, &self.recording.layout) {
                Ok(scan) => self.take(scan, facts),
                Err(fault) => self.faults.push(format!("{fault}: nothing of {node}, {epoch} can be used")),
            }
        }
        for (.., name) in Recording::file_names(folder).unwrap_or_default() {
            if !sidecar.files.iter().any(|facts| facts.name == name) {
                let path = folder.join(name);
                self.faults.push(format!("{}: not of this recording, and left out", path.display()));
            }
        }
    }

    fn take(&mut self, scan: Scan, expected: &super::FileFacts) {
        let whole = scan.tiles.iter().filter(|tile| tile.whole).count();
        if let Some(fault) = &scan.fault {
            self.faults.push(format!("{fault}: the {whole} tiles before it can be used"));
        } else if scan.facts != *expected {
            self.faults.push(format!(
                "{}: {} bytes with crc32c {:#010x}, expected {} bytes with {:#010x}: the {whole} tiles in it are whole",
                scan.path.display(),
                scan.facts.bytes,
                scan.facts.crc32c,
                expected.bytes,
                expected.crc32c
            ));
        }
        let Recording { files, parts, tiles, lost, .. } = &mut self.recording;
        let file = files.len() as u32;
        let mut next = parts.len() as u32;
        parts.extend(scan.parts.into_iter().map(|place| (file, place)));
        for tile in scan.tiles {
            let range = next..next + tile.parts;
            next = range.end;
            // A tile that was cut short is the last of its process: no other one depends on what it left in the memory.
            if tile.whole {
                let (node, epoch) = (scan.node, scan.epoch);
                let of_lost = LostTile { node, epoch, tile: tile.tile, attempt: tile.attempt };
                let accepted = lost.binary_search(&of_lost).is_err();
                tiles.push(TracedTile { node, epoch, tile: tile.tile, attempt: tile.attempt, accepted, parts: range });
            }
        }
        self.recording.references += scan.references;
        self.recording.files.push((scan.path, scan.file));
    }

    /// Every tile of the image once, but for those that no node finished.
    fn check_tiles(&mut self, sidecar: &Sidecar) {
        let tiles = sidecar.tiling.tile_count();
        let mut seen = vec![false; tiles as usize];
        let mut odd = 0u64;
        for tile in self.recording.tiles.iter_mut().filter(|tile| tile.accepted) {
            match seen.get_mut(tile.tile.0 as usize) {
                Some(seen) if !*seen => *seen = true,
                _ => {
                    tile.accepted = false;
                    odd += 1;
                }
            }
        }
        if odd > 0 {
            self.faults
                .push(format!("{odd} tiles are there twice, or are no tiles of the image: they count for nothing"));
        }
        let found = seen.iter().filter(|seen| **seen).count() as u32;
        let expected = tiles.saturating_sub(sidecar.tiles_missing);
        if found != expected {
            self.faults.push(format!("the references of {found} tiles are whole, expected {expected}"));
        }
    }
}

impl Trace for Recording {
    fn tiles(&self) -> &[TracedTile] {
        &self.tiles
    }

    fn read(&self, part: u32, words: &mut Vec<u32>) -> Result<(), TraceError> {
        let (file, place) = self.parts[part as usize];
        let (path, file) = &self.files[file as usize];
        words.resize(place.words as usize, 0);
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(words);
        let named = |what: String| TraceError(format!("{}: byte {}: {what}", path.display(), place.offset));
        ReadAt::read_exact_at(file, bytes, place.offset).map_err(|error| named(error.to_string()))?;
        if crc32c::crc32c(bytes) != place.crc32c {
            return Err(named("has changed since it was opened".to_owned()));
        }
        Ok(())
    }
}
