//! A trace that came from elsewhere: one stream of references, without tiles or rays.

use std::collections::BTreeMap;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::sync::{Mutex, PoisonError};

use super::TableLines;
use super::table_lines::Extent;
use crate::hardware::references::PART_WORDS;
use crate::replay::{Trace, TraceError, TracedTile};
use ground::ids::{Attempt, Epoch, NodeId, TileId};

/// References of one node in one tile. What was referenced, each different pair of address and size, or of object and size, is a
/// record; records and objects are numbered in the order in which they first appear.
#[derive(Debug)]
pub struct Imported {
    /// The one tile.
    tile: [TracedTile; 1],
    /// Words of all parts, little-endian, in a file that has no name any more.
    words: File,
    word_count: u64,
    notes: Notes,
    /// By record, its place in `sizes`.
    kinds: Vec<u32>,
    /// 32-bit words, begun ones too, in ascending order, each once.
    sizes: Vec<u32>,
    contents: Contents,
    /// No line may be shorter.
    line_bytes_min: u32,
    /// By bytes of a line, all that were asked for so far; that of objects is the same for all.
    tables: Mutex<BTreeMap<u32, TableLines>>,
}

/// What is referenced, by record.
#[derive(Debug)]
pub(super) enum Contents {
    Bytes(Vec<Extent>),
    Objects(Objects),
}

#[derive(Debug, Default)]
pub(super) struct Objects {
    /// By object: its number, which decides its set.
    pub(super) ids: Vec<u64>,
    /// By object: the record of its first size.
    pub(super) first: Vec<u32>,
    /// By record.
    pub(super) objects: Vec<u32>,
    pub(super) bytes: Vec<u64>,
}

impl Objects {
    /// Appends a record.
    pub(super) fn record(&mut self, object: u32, bytes: u64) {
        self.objects.push(object);
        self.bytes.push(bytes);
    }
}

/// What was counted as a trace was read.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct Notes {
    /// Reads, instruction fetches and writes.
    pub references: u64,
    pub writes: u64,
    /// What was written back before it had to be evicted.
    pub copy_backs: u64,
    pub invalidations: u64,
    /// References to objects of size 0, which are left out.
    pub left_out: u64,
    /// References to an object with another size than it had at first.
    pub resized: u64,
    /// References whose operation has a name that is not known; they count as reads.
    pub unknown_operations: u64,
}

impl Imported {
    /// # Errors
    /// There are more lines of `line_bytes_min` than can be simulated.
    pub(super) fn new(
        words: File,
        word_count: u64,
        contents: Contents,
        notes: Notes,
        line_bytes_min: u32,
    ) -> Result<Self, String> {
        let tile = TracedTile {
            node: NodeId(0),
            epoch: Epoch(0),
            tile: TileId(0),
            attempt: Attempt(0),
            accepted: true,
            // Below 2¹⁷: references are at most 2³².
            parts: 0..word_count.div_ceil(PART_WORDS as u64) as u32,
        };
        let record_words: Vec<u32> = match &contents {
            Contents::Bytes(extents) => extents.iter().map(|extent| extent.words()).collect(),
            Contents::Objects(objects) => vec![1; objects.bytes.len()],
        };
        let mut sizes = record_words.clone();
        sizes.sort_unstable();
        sizes.dedup();
        let kinds = record_words.iter().map(|words| sizes.partition_point(|size| size < words) as u32).collect();
        let table = contents.lines(line_bytes_min)?;
        let tables = Mutex::new(BTreeMap::from([(contents.table_of(line_bytes_min), table)]));
        Ok(Self { tile: [tile], words, word_count, notes, kinds, sizes, contents, line_bytes_min, tables })
    }

    /// Where records lie, for lines of so many bytes: a power of two, no less than what the trace was imported for.
    /// Objects are lines, whatever these have.
    ///
    /// # Panics
    /// Lines are shorter.
    pub fn lines(&self, line_bytes: u32) -> TableLines {
        let shortest = self.line_bytes_min;
        assert!(
            self.is_of_objects() || line_bytes >= shortest,
            "lines of {line_bytes} bytes of a trace imported for {shortest} or more"
        );
        let mut tables = self.tables.lock().unwrap_or_else(PoisonError::into_inner);
        let lines = || self.contents.lines(line_bytes).unwrap_or_else(|_| unreachable!("longer lines are fewer"));
        tables.entry(self.contents.table_of(line_bytes)).or_insert_with(lines).clone()
    }

    /// What was counted as the trace was read.
    pub fn notes(&self) -> Notes {
        self.notes
    }

    /// A record's first byte and how many it has; an object has one. What lies within 16 bytes at a multiple of 16 begins there.
    ///
    /// # Panics
    /// There is no such record.
    pub fn extent(&self, record: u32) -> (u64, u32) {
        match &self.contents {
            Contents::Bytes(extents) => (extents[record as usize].address(), extents[record as usize].bytes()),
            Contents::Objects(_) => (0, 1),
        }
    }

    pub fn is_of_objects(&self) -> bool {
        matches!(self.contents, Contents::Objects(_))
    }

    /// The object of a record; in a trace of bytes each record is one.
    ///
    /// # Panics
    /// There is no such record.
    pub fn object(&self, record: u32) -> u32 {
        match &self.contents {
            Contents::Bytes(_) => record,
            Contents::Objects(objects) => objects.objects[record as usize],
        }
    }

    /// How many different objects there are.
    pub fn objects(&self) -> u32 {
        match &self.contents {
            Contents::Bytes(extents) => extents.len() as u32,
            Contents::Objects(objects) => objects.ids.len() as u32,
        }
    }

    /// The size that an object has where this record is referenced.
    ///
    /// # Panics
    /// There is no such record.
    pub fn object_bytes(&self, record: u32) -> u64 {
        match &self.contents {
            Contents::Bytes(extents) => u64::from(extents[record as usize].bytes()),
            Contents::Objects(objects) => objects.bytes[record as usize],
        }
    }

    /// Of all different objects together, each with its first size, as libCacheSim counts a working set; `None` for a trace of bytes, whose footprint depends on its lines.
    pub fn objects_bytes(&self) -> Option<u128> {
        match &self.contents {
            Contents::Bytes(_) => None,
            Contents::Objects(Objects { first, bytes, .. }) => {
                Some(first.iter().map(|&record| u128::from(bytes[record as usize])).sum())
            }
        }
    }

    /// Records of the same number of 32-bit words are of one kind.
    #[inline(always)]
    pub fn kind(&self, record: u32) -> usize {
        self.kinds[record as usize] as usize
    }

    /// By kind: 32-bit words, begun ones too. An object is one.
    pub fn record_words(&self) -> &[u32] {
        &self.sizes
    }

    /// How many different pairs of address and size there are, or of object and size.
    pub fn records(&self) -> u32 {
        self.kinds.len() as u32
    }
}

impl Contents {
    /// Which table serves lines of so many bytes.
    fn table_of(&self, line_bytes: u32) -> u32 {
        match self {
            Self::Bytes(_) => line_bytes,
            Self::Objects(_) => 0,
        }
    }

    fn lines(&self, line_bytes: u32) -> Result<TableLines, String> {
        match self {
            Self::Bytes(extents) => TableLines::of_extents(extents, line_bytes),
            Self::Objects(Objects { ids, objects, .. }) => Ok(TableLines::of_objects(ids.clone(), objects)),
        }
    }
}

impl Trace for Imported {
    fn tiles(&self) -> &[TracedTile] {
        &self.tile
    }

    fn read(&self, part: u32, words: &mut Vec<u32>) -> Result<(), TraceError> {
        let first = u64::from(part) * PART_WORDS as u64;
        if first >= self.word_count {
            return Err(TraceError(format!("there is no part {part}")));
        }
        let count = (self.word_count - first).min(PART_WORDS as u64) as usize;
        words.clear();
        words.resize(count, 0);
        let read = self.words.read_exact_at(bytemuck::cast_slice_mut(words), first * size_of::<u32>() as u64);
        read.map_err(|error| TraceError(format!("the imported trace's temporary file: {error}")))
    }
}
