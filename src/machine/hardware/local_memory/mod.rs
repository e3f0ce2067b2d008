//! The local memory of a processing node: a cache of lines that the tracer reads through.
//!
//! Its [`Geometry`] gives its size, its [`Directory`] the lines that are in it; what is missing comes from a
//! [`LineSource`]. Each read of a record references its lines in ascending order. The missing ones are
//! fetched as one transaction; a line may be driven out again by a later line of the same record, and
//! the record is right all the same.

mod directory;
mod geometry;
mod missing;
mod padded;
mod source;

pub use directory::{Directory, Reference};
pub use geometry::{Geometry, GeometryError, LINE_BYTES_MAX, LINES_MIN, MemoryShape, Slots};
pub use source::LineSource;

use bytemuck::Pod;
use missing::{Missing, copy_overlap};
use padded::PaddedSections;

use super::replacement::Replacement;
use super::stats::{CLASSES, Counters, MemoryStats, octree_class, section_class};
use trace::database::records::{MAX_DEPTH, Material, OctreeWord};
use trace::database::{Layout, Section};
use trace::tracer::memory_port::plain_reads;
use trace::tracer::{MemoryPort, RayKind};

/// Most lines that a record without padding touches: a material on lines of 16 bytes, from the last word of the first one.
const RECORD_LINES_MAX: usize = 4;
/// Bytes of a word: all records are made of whole ones.
const WORD: usize = size_of::<u32>();
/// Words of the largest record without padding, a material.
const RECORD_WORDS_MAX: u32 = (size_of::<Material>() / WORD) as u32;

/// Why a record cannot be read. The record is lost to the tile; the memory can still be used.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum MemoryError<E> {
    #[error("missing lines cannot be fetched")]
    Source(#[source] E),
    #[error("the database has no record {index} in section {}", section.name())]
    OutOfRange { section: Section, index: u32 },
    #[error("the database is corrupt: {0}")]
    Corrupt(&'static str),
}

/// Where a section's records lie, which have no padding.
#[derive(Clone, Copy, Debug, Default)]
struct SectionWords {
    /// Words from the start of the image.
    base: u32,
    /// None of a section whose records are padded.
    records: u32,
}

/// Tags, data and counters of a local memory with replacement policy `R`, filled from `S`.
#[derive(Debug)]
pub struct LocalMemory<R, S> {
    geometry: Geometry,
    directory: Directory<R>,
    /// The lines' words by slot, with a record's before and after them, which may be read but do not count.
    data: Vec<u32>,
    /// The line's words are 2 to this power.
    line_shift: u32,
    /// The bits of a word's address that give the place in a line.
    offset_mask: u32,
    sections: [SectionWords; Section::COUNT],
    padded: Box<PaddedSections>,
    source: S,
    /// Fetched lines, on their way to the record and to their slots.
    fetched: Vec<u32>,
    ray_kind: RayKind,
    /// Records found at once in one line: all that a hit counts. The others are in `stats`.
    hits: [[u64; RayKind::COUNT]; CLASSES],
    stats: MemoryStats,
    /// Record accesses since the memory was made, without the `hits` of now.
    accesses: u64,
}

impl<R: Replacement, S: LineSource> LocalMemory<R, S> {
    /// An empty memory for the image that `geometry` was resolved for; `seed` decides random replacement.
    ///
    /// # Panics
    /// `geometry` is that of another image.
    pub fn new(geometry: Geometry, layout: &Layout, seed: u64, source: S) -> Self {
        assert_eq!(
            u64::from(geometry.database_lines) * u64::from(geometry.line_bytes),
            layout.database_bytes(),
            "a local memory's geometry is resolved for its image"
        );
        let padded = PaddedSections::new(layout);
        let place = |section| {
            if padded.contains(section) {
                return SectionWords::default();
            }
            let span = layout.span(section);
            // An image is of at most 2³² bytes, so that its words can be counted.
            SectionWords { base: (span.base.0 / WORD as u64) as u32, records: span.records as u32 }
        };
        let line_words = geometry.line_bytes / WORD as u32;
        let slots = geometry.slots();
        Self {
            geometry,
            directory: Directory::new(slots, geometry.database_lines, seed),
            data: vec![0; slots.count() as usize * line_words as usize + 2 * RECORD_WORDS_MAX as usize],
            line_shift: line_words.trailing_zeros(),
            offset_mask: line_words - 1,
            sections: Section::ALL.map(place),
            source,
            fetched: vec![0; padded.record_lines_max() * line_words as usize],
            padded: Box::new(padded),
            ray_kind: RayKind::Primary,
            hits: [[0; RayKind::COUNT]; CLASSES],
            stats: MemoryStats::default(),
            accesses: 0,
        }
    }

    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// The counts since the last call: those of one tile, when called between tiles.
    pub fn take_stats(&mut self) -> MemoryStats {
        for (kind, counters) in self.stats.counters.iter_mut().enumerate() {
            for (counters, hits) in counters.iter_mut().zip(&mut self.hits) {
                let hits = std::mem::take(&mut hits[kind]);
                counters.record_accesses += hits;
                counters.line_accesses += hits;
                self.accesses += hits;
            }
        }
        std::mem::take(&mut self.stats)
    }

    /// Forgets all lines, as the first reads of a new epoch of the bus demand. Counts stay.
    pub fn clear(&mut self) {
        self.directory.clear();
    }

    pub fn source_mut(&mut self) -> &mut S {
        &mut self.source
    }

    #[inline(always)]
    fn record<T: Pod>(&mut self, section: Section, index: u32, class: usize) -> Result<T, MemoryError<S::Error>> {
        let place = self.sections[section as usize];
        if index >= place.records {
            // Records of a word have no padding.
            return if const { size_of::<T>() == WORD } {
                Err(MemoryError::OutOfRange { section, index })
            } else {
                self.padded_record(section, index, class)
            };
        }
        let words = const { (size_of::<T>() / WORD) as u32 };
        let start = place.base.wrapping_add(index.wrapping_mul(words));
        let line = start >> self.line_shift;
        let in_line = self.offset_mask + 1 - (start & self.offset_mask);
        // Sections start on lines, and lines are of at least four words: such a record never lies in two.
        let divides_lines = const { (4 * WORD).is_multiple_of(size_of::<T>()) };
        // The data are read before anything is written, so that nothing has to be loaded twice.
        if divides_lines || words <= in_line {
            if let Some(slot) = self.directory.slot(line) {
                let record = bytemuck::pod_read_unaligned(bytemuck::cast_slice(self.read(slot, start, words)));
                self.directory.hit(slot);
                self.hits[class][self.ray_kind as usize] += 1;
                return Ok(record);
            }
        } else if words <= self.offset_mask + 1
            && let (Some(first), Some(second)) = (self.directory.slot(line), self.directory.slot(line + 1))
        {
            let record = join(self.read(first, start, words), self.read_up_to(second, in_line, words), in_line);
            self.directory.hit(first);
            self.directory.hit(second);
            self.count(class, 2);
            return Ok(record);
        }
        let mut record = T::zeroed();
        self.gather::<RECORD_LINES_MAX>(
            section,
            start,
            class,
            bytemuck::cast_slice_mut(std::slice::from_mut(&mut record)),
        )?;
        Ok(record)
    }

    /// So many words from the place of the word `start` in this slot.
    #[inline(always)]
    fn read(&self, slot: u32, start: u32, words: u32) -> &[u32] {
        let from = RECORD_WORDS_MAX + (slot << self.line_shift) + (start & self.offset_mask);
        &self.data[from as usize..from as usize + words as usize]
    }

    /// So many words, of which the slot's first is the one after `before` others.
    #[inline(always)]
    fn read_up_to(&self, slot: u32, before: u32, words: u32) -> &[u32] {
        let from = RECORD_WORDS_MAX + (slot << self.line_shift) - before;
        &self.data[from as usize..from as usize + words as usize]
    }

    #[inline(always)]
    fn count(&mut self, class: usize, lines: u32) -> &mut Counters {
        let counters = &mut self.stats.counters[self.ray_kind as usize][class];
        self.accesses += 1;
        counters.record_accesses += 1;
        counters.line_accesses += u64::from(lines);
        counters
    }

    /// Reads a record that is missing, or that lies in more than two lines.
    #[inline(never)]
    fn gather<const LINES_MAX: usize>(
        &mut self,
        section: Section,
        start: u32,
        class: usize,
        record: &mut [u32],
    ) -> Result<(), MemoryError<S::Error>> {
        let shift = self.line_shift;
        let (first, last) = (start >> shift, (start + record.len() as u32 - 1) >> shift);
        let mut missing = Missing::<LINES_MAX>::new(section, first);
        for line in first..=last {
            match self.directory.reference(line) {
                Reference::Hit { slot } => {
                    // Copied at once: a later line of this record may drive this one out.
                    copy_overlap(self.read(slot, 0, 1 << shift), line << shift, record, start);
                }
                Reference::Miss { slot, .. } => missing.add(line, slot),
            }
        }
        let counters = self.count(class, last - first + 1);
        if missing.is_empty() {
            return Ok(());
        }
        counters.record_misses += 1;
        counters.line_misses += u64::from(missing.count());
        self.fetch(&missing, start, record)
    }

    /// Fetches the missing lines of a record as one transaction.
    #[cold]
    #[inline(never)]
    fn fetch<const LINES_MAX: usize>(
        &mut self,
        missing: &Missing<LINES_MAX>,
        start: u32,
        record: &mut [u32],
    ) -> Result<(), MemoryError<S::Error>> {
        let line_words = 1usize << self.line_shift;
        // This access is counted already, and is not before itself.
        let accesses = self.accesses + self.hits.as_flattened().iter().sum::<u64>();
        let request = missing.request(self.line_shift, accesses - 1);
        let fetched = &mut self.fetched[..request.bytes() as usize / WORD];
        if let Err(error) = self.source.fetch(&request, bytemuck::cast_slice_mut(fetched)) {
            // The directory counts the lines as present already, but their data never came.
            self.directory.clear();
            return Err(MemoryError::Source(error));
        }
        for ((line, slot), words) in missing.lines().zip(fetched.chunks_exact(line_words)) {
            copy_overlap(words, line << self.line_shift, record, start);
            if self.directory.holds(slot, line) {
                let to = (RECORD_WORDS_MAX + (slot << self.line_shift)) as usize;
                self.data[to..to + line_words].copy_from_slice(words);
            }
        }
        Ok(())
    }
}

/// The first `split` words of one record and the rest of another, word by word since that needs no branch.
#[inline(always)]
fn join<T: Pod>(first: &[u32], second: &[u32], split: u32) -> T {
    let mut record = T::zeroed();
    let words: &mut [u32] = bytemuck::cast_slice_mut(std::slice::from_mut(&mut record));
    for i in 0..words.len() {
        words[i] = if (i as u32) < split { first[i] } else { second[i] };
    }
    record
}

macro_rules! counted_read {
    ($($read:ident: $section:ident -> $record:ty,)*) => {$(
        #[inline(always)]
        fn $read(&mut self, index: u32) -> Result<$record, Self::Error> {
            self.record(Section::$section, index, section_class(Section::$section))
        }
    )*};
}

impl<R: Replacement, S: LineSource> MemoryPort for LocalMemory<R, S> {
    type Error = MemoryError<S::Error>;

    #[inline(always)]
    fn set_ray_kind(&mut self, kind: RayKind) {
        self.ray_kind = kind;
    }

    #[inline(always)]
    fn octree_node(&mut self, index: u32, level: u32) -> Result<OctreeWord, Self::Error> {
        self.record(Section::OctreeNodes, index, octree_class(level.min(MAX_DEPTH)))
    }

    plain_reads!(counted_read);

    #[cold]
    fn corrupt(&mut self, what: &'static str) -> Self::Error {
        MemoryError::Corrupt(what)
    }
}

#[cfg(test)]
mod by_hand;
#[cfg(test)]
mod tests;
