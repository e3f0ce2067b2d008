//! A trace that came from elsewhere: one stream of references, without tiles or rays.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::fs::File;
use std::io::{self, Write};
use std::os::unix::fs::FileExt;

use super::TableLines;
use super::table_lines::{Extent, Unit};
use crate::hardware::references::{PART_WORDS, ReferenceWord};
use crate::replay::{Trace, TraceError, TracedTile};
use ground::ids::{Attempt, Epoch, NodeId, TileId};

/// References of one node in one tile. What was referenced, each different pair of address and size, is a record; these
/// are numbered in the order in which they first appear.
#[derive(Debug)]
pub struct Imported {
    /// The one tile.
    tile: [TracedTile; 1],
    /// Words of all parts, little-endian, in a file that has no name any more.
    words: File,
    references: u64,
    /// References that write. They are counted as reads: a memory that allocates on writes makes no difference.
    pub writes: u64,
    /// References to nothing, of size zero, that are left out as libCacheSim leaves them out.
    pub left_out: u64,
    /// By record, its place in `sizes`.
    kinds: Vec<u32>,
    /// 32-bit words, begun ones too, in ascending order, each once.
    sizes: Vec<u32>,
    table: TableLines,
}

impl Imported {
    /// Where records lie, for lines of so many bytes: a power of two, 16 to 256.
    pub fn lines(&self, line_bytes: u32) -> TableLines {
        self.table.with_line(line_bytes)
    }

    /// Of all different granules of 256 bytes that are referenced. An object counts as one of these.
    pub fn database_bytes(&self) -> u64 {
        self.table.database_bytes()
    }

    pub fn references(&self) -> u64 {
        self.references
    }

    /// Records of the same number of 32-bit words are of one kind.
    #[inline(always)]
    pub fn kind(&self, record: u32) -> usize {
        self.kinds[record as usize] as usize
    }

    /// By kind: 32-bit words, begun ones too. What has no size is within one.
    pub fn record_words(&self) -> &[u32] {
        &self.sizes
    }

    /// How many different pairs of address and size there are.
    pub fn records(&self) -> u32 {
        self.table.records()
    }
}

impl Trace for Imported {
    fn tiles(&self) -> &[TracedTile] {
        &self.tile
    }

    fn read(&self, part: u32, words: &mut Vec<u32>) -> Result<(), TraceError> {
        let first = u64::from(part) * PART_WORDS as u64;
        if first >= self.references {
            return Err(TraceError(format!("there is no part {part}")));
        }
        let count = (self.references - first).min(PART_WORDS as u64) as usize;
        words.clear();
        words.resize(count, 0);
        let read = self.words.read_exact_at(bytemuck::cast_slice_mut(words), first * size_of::<u32>() as u64);
        read.map_err(|error| TraceError(format!("the imported trace's temporary file: {error}")))
    }
}

/// Collects references into an [`Imported`].
pub(super) struct Builder {
    unit: Unit,
    /// By extent, its record's number.
    numbers: HashMap<Extent, u32>,
    records: Vec<Extent>,
    /// Of the part that is not full yet.
    part: Vec<u32>,
    words: File,
    references: u64,
    pub(super) writes: u64,
    pub(super) left_out: u64,
}

impl Builder {
    pub(super) fn new(unit: Unit) -> Result<Self, String> {
        Ok(Self {
            unit,
            numbers: HashMap::new(),
            records: Vec::new(),
            part: Vec::with_capacity(PART_WORDS),
            words: tempfile::tempfile().map_err(|error| temporary(&error))?,
            references: 0,
            writes: 0,
            left_out: 0,
        })
    }

    /// Appends a reference.
    ///
    /// # Errors
    /// What is wrong with it, and what was expected.
    pub(super) fn reference(&mut self, address: u64, bytes: u32) -> Result<(), String> {
        let extent = Extent::new(address, bytes)?;
        let record = match self.numbers.entry(extent) {
            Entry::Occupied(known) => *known.get(),
            Entry::Vacant(new) => {
                let number = self.records.len() as u32;
                if !ReferenceWord::read(number).is_read() {
                    return Err(format!("more than {number} different addresses and sizes, expected fewer"));
                }
                self.records.push(extent);
                *new.insert(number)
            }
        };
        self.part.push(ReferenceWord::read(record).0);
        self.references += 1;
        if self.part.len() == PART_WORDS { self.keep_part() } else { Ok(()) }
    }

    /// # Errors
    /// There are no references, or they are to more than can be addressed.
    pub(super) fn finish(mut self) -> Result<Imported, String> {
        if self.references == 0 {
            return Err("no references, expected at least one".to_owned());
        }
        self.keep_part()?;
        let parts = u32::try_from(self.references.div_ceil(PART_WORDS as u64));
        let parts = parts.map_err(|_| format!("{} references, expected fewer", self.references))?;
        let tile = TracedTile {
            node: NodeId(0),
            epoch: Epoch(0),
            tile: TileId(0),
            attempt: Attempt(0),
            accepted: true,
            parts: 0..parts,
        };
        let mut sizes: Vec<u32> = self.records.iter().map(|record| record.words()).collect();
        sizes.sort_unstable();
        sizes.dedup();
        let kind = |record: &Extent| sizes.partition_point(|&words| words < record.words()) as u32;
        let kinds = self.records.iter().map(kind).collect();
        Ok(Imported {
            tile: [tile],
            words: self.words,
            references: self.references,
            writes: self.writes,
            left_out: self.left_out,
            kinds,
            sizes,
            table: TableLines::new(&self.records, self.unit)?,
        })
    }

    fn keep_part(&mut self) -> Result<(), String> {
        self.words.write_all(bytemuck::cast_slice(&self.part)).map_err(|error| temporary(&error))?;
        self.part.clear();
        Ok(())
    }
}

fn temporary(error: &io::Error) -> String {
    format!("a temporary file for its references: {error}")
}
