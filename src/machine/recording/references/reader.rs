//! A recording of references, opened: what it is of, what is whole in it, and its words.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use super::scan::{Part, Scan};
use super::{Conditions, LEVELS_NAME, LostTile, SIDECAR_NAME, Sidecar, file_name};
use crate::hardware::references::RecordNumbers;
use crate::hardware::trace::{Trace, TraceError, TracedTile};
use crate::recording::frames::ReadAt;
use crate::recording::metadata;
use ground::ids::{Epoch, NodeId};
use ground::regular_file;
use trace::database::{Layout, Section};
use trace::picture::Tiling;

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
    pub conditions: Conditions,
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
    parts: Vec<(u32, Part)>,
    tiles: Vec<TracedTile>,
}

impl Recording {
    /// Opens the recording in a folder: that of the run, or its `recording`. `conditions` reads the text of the run's
    /// topology.
    ///
    /// # Errors
    /// There is no recording of references, its sidecar cannot be understood, or nothing in it can be used.
    pub fn open(
        folder: &Path,
        conditions: impl FnOnce(&str) -> Result<Conditions, String>,
    ) -> Result<Opened, OpenError> {
        let inner = folder.join("recording");
        let folder = if folder.join(SIDECAR_NAME).exists() || !inner.is_dir() { folder } else { &inner };
        let in_sidecar = |what: String| format!("{}: {what}", folder.join(SIDECAR_NAME).display());
        let named = |what: String| OpenError(in_sidecar(what) + &without_sidecar(folder));
        let (sidecar, fault) = Sidecar::read(folder).map_err(named)?;
        let conditions = conditions(&sidecar.topology).map_err(named)?;
        let tiling = Tiling::try_from(sidecar.tiling).map_err(|error| named(error.to_string()))?;
        let layout = metadata::layout(&sidecar.records, sidecar.record_bytes.as_ref()).map_err(named)?;
        let mut opened = Opened {
            recording: Self {
                conditions,
                numbers: RecordNumbers::new(&layout),
                layout,
                tiling,
                scene_sha256: sidecar.scene_sha256.clone(),
                local_bytes: sidecar.local_bytes,
                octree_levels: Vec::new(),
                references: 0,
                lost: sidecar.lost.clone(),
                files: Vec::new(),
                parts: Vec::new(),
                tiles: Vec::new(),
            },
            faults: fault.map(in_sidecar).into_iter().collect(),
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

/// The process that a file is of, by its name. No other name than that is one.
pub(super) fn process_of(name: &str) -> Option<(NodeId, Epoch)> {
    let (node, epoch) = name.strip_prefix("references-n")?.strip_suffix(".arrows")?.split_once("-e")?;
    let process = (NodeId(node.parse().ok()?), Epoch(epoch.parse().ok()?));
    (file_name(process.0, process.1) == name).then_some(process)
}

fn tile_count(tiles: usize) -> String {
    match tiles {
        0 => "no tiles".to_owned(),
        1 => "1 tile".to_owned(),
        _ => format!("{tiles} tiles"),
    }
}

/// What a folder without a sidecar that can be understood is.
fn without_sidecar(folder: &Path) -> String {
    match Recording::file_names(folder).map_or(0, |names| names.len()) {
        0 => ": expected the folder of a run with `--record references`, or its folder `recording`".to_owned(),
        files => format!(
            ": without it nothing tells what the {files} files of references beside it are of, and none can be used; a \
             run writes it at its end"
        ),
    }
}

impl Opened {
    fn read_levels(&mut self, folder: &Path, sidecar: &Sidecar) {
        let path = folder.join(LEVELS_NAME);
        let blocks = self.recording.layout.span(Section::OctreeNodes).records / 8;
        let read = regular_file::open(&path).and_then(|file| {
            let (bytes, expected) = (ReadAt::bytes(&file)?, &sidecar.octree_levels);
            if bytes != blocks || bytes != expected.bytes {
                let expected = format!("{bytes} bytes, expected {blocks}: one a block of octree words");
                return Err(io::Error::other(expected));
            }
            let mut levels = vec![0; bytes as usize];
            ReadAt::read_exact_at(&file, &mut levels, 0)?;
            let crc32c = crc32c::crc32c(&levels);
            if crc32c != expected.crc32c {
                let expected = format!("crc32c is {crc32c:#010x}, expected {:#010x}", expected.crc32c);
                return Err(io::Error::other(expected));
            }
            Ok(levels)
        });
        match read {
            Ok(levels) => self.recording.octree_levels = levels,
            Err(error) => self
                .faults
                .push(format!("{}: {error}: all counts can be used but those by octree level", path.display())),
        }
    }

    fn read_files(&mut self, folder: &Path, sidecar: &Sidecar) {
        let nodes = self.recording.conditions.cluster.all_nodes();
        let mut last = None;
        for facts in &sidecar.files {
            let process = process_of(&facts.name).filter(|process| process.0.0 < nodes && last < Some(*process));
            let Some((node, epoch)) = process else {
                self.faults.push(format!(
                    "{}: {:?}, expected the files of processes of {nodes} nodes in their order: it is left out",
                    folder.join(SIDECAR_NAME).display(),
                    facts.name
                ));
                continue;
            };
            last = process;
            match Scan::of(&folder.join(&facts.name), node, epoch, &self.recording.layout) {
                Ok(scan) => self.take(scan, facts),
                Err(fault) => self.faults.push(format!("{fault}: nothing of {node}, {epoch} can be used")),
            }
        }
        for (.., name) in Recording::file_names(folder).unwrap_or_default() {
            if !sidecar.files.iter().any(|facts| facts.name == name) {
                let path = folder.join(name);
                self.faults
                    .push(format!("{}: expected no such file in this recording: it is left out", path.display()));
            }
        }
    }

    fn take(&mut self, scan: Scan, expected: &super::FileFacts) {
        let whole = scan.tiles.iter().filter(|tile| tile.whole).count();
        if let Some(fault) = &scan.fault {
            self.faults.push(format!("{fault}: {} before that can be used", tile_count(whole)));
        } else if scan.facts != *expected {
            self.faults.push(format!(
                "{}: {} bytes with crc32c {:#010x}, expected {} bytes with {:#010x}: it was cut between frames, or is of \
                 another run; {} in it can be used",
                scan.path.display(),
                scan.facts.bytes,
                scan.facts.crc32c,
                expected.bytes,
                expected.crc32c,
                tile_count(whole)
            ));
        }
        let Recording { files, parts, tiles, lost, references, .. } = &mut self.recording;
        let file = files.len() as u32;
        let mut next = parts.len() as u32;
        parts.extend(scan.parts.into_iter().map(|place| (file, place)));
        for tile in scan.tiles {
            let range = next..next + tile.parts;
            next = range.end;
            // A tile that was cut short is the last of its process: no other one depends on what it left in the memory.
            if tile.whole {
                *references += tile.references;
                let (node, epoch) = (scan.node, scan.epoch);
                let of_lost = LostTile { node, epoch, tile: tile.tile, attempt: tile.attempt };
                let accepted = lost.binary_search(&of_lost).is_err();
                tiles.push(TracedTile { node, epoch, tile: tile.tile, attempt: tile.attempt, accepted, parts: range });
            }
        }
        self.recording.files.push((scan.path, scan.file));
    }

    /// Every tile of the image once, but for those that no node finished.
    fn check_tiles(&mut self, sidecar: &Sidecar) {
        let tiles = self.recording.tiling.tile_count();
        let mut seen = vec![false; tiles as usize];
        let mut odd = 0;
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
            self.faults.push(format!(
                "{} that are there already, or are not of the image, count for nothing",
                tile_count(odd)
            ));
        }
        let found = seen.iter().filter(|seen| **seen).count() as u32;
        let expected = tiles.saturating_sub(sidecar.tiles_missing);
        if found != expected {
            self.faults
                .push(format!("{} can be used, expected {expected} by {SIDECAR_NAME}", tile_count(found as usize)));
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
