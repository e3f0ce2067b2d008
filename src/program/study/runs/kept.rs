//! References in an unnamed temporary file: as many as there is room for on disk, none of them in memory.

use std::fs::File;
use std::io;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::sync::atomic::{AtomicU64, Ordering};

use ground::ids::{Attempt, Epoch, NodeId, TileId};
use machine::hardware::references::{RecordNumbers, Recorder};
use machine::replay::{Trace, TraceError, TracedTile, parallel};
use trace::database::verify::Verified;
use trace::picture::{AovSet, Tiling};
use trace::tracer::slices::Slices;
use trace::tracer::{TileTracer, View};

/// Tiles that a thread traces at a time: setting up takes longer than one.
const TILES_AT_A_TIME: u32 = 64;

/// The references of all tiles of an image, each traced once, by the row from the top.
#[derive(Debug)]
pub struct Kept {
    file: File,
    tiles: Vec<TracedTile>,
    parts: Vec<Part>,
}

/// Where words are in the file.
#[derive(Clone, Copy, Debug)]
struct Part {
    /// Bytes.
    offset: u64,
    words: usize,
}

impl Kept {
    /// Traces on all processors.
    ///
    /// # Errors
    /// There is no place for temporary files, or not enough of it.
    pub fn capture(database: &Verified, view: &View, tiling: Tiling, mailbox: bool) -> io::Result<Self> {
        let file = tempfile::tempfile()?;
        let end = AtomicU64::new(0);
        let capture = Capture { database, view, tiling, mailbox, file: &file, end: &end };
        let count = tiling.tile_count();
        let starts: Vec<u32> = (0..count).step_by(TILES_AT_A_TIME as usize).collect();
        let traced = parallel::map(&starts, |&start| capture.tiles(start..count.min(start + TILES_AT_A_TIME)));
        let (mut tiles, mut parts) = (Vec::new(), Vec::new());
        for tile in traced.into_iter().collect::<io::Result<Vec<_>>>()?.into_iter().flatten() {
            let first = parts.len() as u32;
            parts.extend(tile);
            tiles.push(TracedTile {
                node: NodeId(0),
                epoch: Epoch(0),
                tile: TileId(tiles.len() as u32),
                attempt: Attempt(0),
                accepted: true,
                parts: first..parts.len() as u32,
            });
        }
        Ok(Self { file, tiles, parts })
    }
}

impl Trace for Kept {
    fn tiles(&self) -> &[TracedTile] {
        &self.tiles
    }

    fn read(&self, part: u32, words: &mut Vec<u32>) -> Result<(), TraceError> {
        let Part { offset, words: count } =
            *self.parts.get(part as usize).ok_or_else(|| TraceError(format!("there is no part {part}")))?;
        words.resize(count, 0);
        self.file
            .read_exact_at(bytemuck::cast_slice_mut(words), offset)
            .map_err(|error| TraceError(format!("the temporary file of references: {error}")))
    }
}

/// What threads need to trace, and to write what was read.
#[derive(Clone, Copy)]
struct Capture<'a> {
    database: &'a Verified,
    view: &'a View,
    tiling: Tiling,
    mailbox: bool,
    file: &'a File,
    /// Of the file, bytes.
    end: &'a AtomicU64,
}

impl Capture<'_> {
    /// The parts of each tile.
    fn tiles(&self, tiles: Range<u32>) -> io::Result<Vec<Vec<Part>>> {
        let header = &self.database.database().header;
        let numbers = RecordNumbers::new(&header.layout);
        let mut tracer = TileTracer::new(header, self.view, self.mailbox);
        let mut port = Slices::new(self.database);
        let mut words = Vec::new();
        let trace = |rect| {
            let mut parts = Vec::new();
            let keep = |part: &[u32]| parts.push(self.keep(part));
            let mut recorder = Recorder::new(&mut port, numbers, &mut words, keep);
            let Ok(_) = tracer.trace(&mut recorder, rect, AovSet::default());
            parts.push(self.keep(&words));
            words.clear();
            parts.into_iter().collect()
        };
        tiles.map_while(|tile| self.tiling.rect(TileId(tile))).map(trace).collect()
    }

    fn keep(&self, words: &[u32]) -> io::Result<Part> {
        let bytes: &[u8] = bytemuck::cast_slice(words);
        let offset = self.end.fetch_add(bytes.len() as u64, Ordering::Relaxed);
        self.file.write_all_at(bytes, offset)?;
        Ok(Part { offset, words: words.len() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::runs::fixture;

    #[test]
    fn what_is_kept_is_what_was_captured() {
        let (prepared, traced) = fixture::gears();
        let kept = Kept::capture(&prepared.database, &prepared.view, fixture::TILING, traced.run.octree.mailbox)
            .expect("a temporary file");
        assert_eq!(kept.tiles().len(), traced.trace.tiles().len());
        let words = |trace: &dyn Trace, parts: Range<u32>| {
            let mut part = Vec::new();
            let mut all = Vec::new();
            for index in parts {
                trace.read(index, &mut part).expect("kept");
                all.extend_from_slice(&part);
            }
            all
        };
        for (ours, theirs) in kept.tiles().iter().zip(traced.trace.tiles()) {
            assert_eq!(ours.tile, theirs.tile);
            assert_eq!(words(&kept, ours.parts.clone()), words(&traced.trace, theirs.parts.clone()));
        }
        assert!(kept.read(kept.parts.len() as u32, &mut Vec::new()).is_err());
    }
}
