//! One local memory over the references of one node: hits and misses, without data.

use crate::hardware::local_memory::{Directory, Geometry, GeometryError};
use crate::hardware::references::ReferenceWord;
use crate::hardware::replacement::Replacement;
pub use crate::hardware::stats::Counters;
use crate::replay::stream::lines::{SPANS_MAX, Spans};
use crate::replay::stream::placement::Placement;
use crate::replay::{Lines, Trace, TraceError};
use trace::tracer::RayKind;

/// Gets what a replay counts, as it goes.
pub trait Tally {
    /// A tile begins: its index in the trace.
    fn tile(&mut self, tile: u32);
    /// A ray begins.
    fn ray(&mut self, kind: RayKind);
    /// A record was read that lies in so many lines, and so many of these were missing.
    fn read(&mut self, record: u32, lines: u32, missing: u32);
}

/// A local memory that references go through.
pub struct Replayer<'a, R, L> {
    lines: &'a L,
    placement: Placement,
    directory: Directory<R>,
    /// The line of the last reference, if that was a hit. By the contract of [`Replacement`] hitting it again at once changes
    /// nothing, so that the policy is not called unless it says that repeated hits count.
    hit_last: u32,
    words: Vec<u32>,
}

/// An image has fewer lines.
const NO_LINE: u32 = u32::MAX;

impl<'a, R: Replacement, L: Lines> Replayer<'a, R, L> {
    /// An empty memory. `geometry` is one of the same lines; `seed` decides random replacement.
    ///
    /// # Errors
    /// More slots than can be simulated, which the records of a database never need.
    ///
    /// # Panics
    /// `geometry` has another number of lines than `lines`: it is of another database, or of another line size.
    pub fn new(lines: &'a L, geometry: Geometry, seed: u64) -> Result<Self, GeometryError> {
        assert_eq!(
            geometry.database_lines,
            lines.count(),
            "lines of the memory's geometry beside those of the records, expected the same line size and database"
        );
        let placement = lines.placement(&geometry)?;
        let directory = Directory::new(placement.slots(), geometry.database_lines, seed);
        Ok(Self { lines, placement, directory, hit_last: NO_LINE, words: Vec::new() })
    }

    /// Empties the memory, as a node's next process finds it.
    pub fn clear(&mut self) {
        self.directory.clear();
        self.hit_last = NO_LINE;
    }

    /// Replays a tile of the trace.
    ///
    /// # Errors
    /// The trace's. The memory has seen some of the tile then.
    ///
    /// # Panics
    /// The trace has no such tile.
    pub fn tile(&mut self, trace: &(impl Trace + ?Sized), tile: u32, tally: &mut impl Tally) -> Result<(), TraceError> {
        tally.tile(tile);
        let mut words = std::mem::take(&mut self.words);
        for part in trace.tiles()[tile as usize].parts.clone() {
            trace.read(part, &mut words)?;
            self.words(&words, tally)?;
        }
        self.words = words;
        Ok(())
    }

    /// Replays words of a stream.
    ///
    /// # Errors
    /// A word that no tracer writes.
    pub fn words(&mut self, words: &[u32], tally: &mut impl Tally) -> Result<(), TraceError> {
        let mut spans = Spans::default();
        for words in words.chunks(SPANS_MAX) {
            self.lines.spans(words, &mut spans);
            for (&word, (first, count)) in words.iter().zip(spans.iter()) {
                if count > 0 {
                    let missing = self.reference(first, count);
                    tally.read(word, count, missing);
                } else {
                    mark(word, tally)?;
                }
            }
        }
        Ok(())
    }

    /// Replays words up to and with the first read that misses. Returns how many words that were, and of the read how
    /// many lines were missing; 0 when no read of `words` missed.
    ///
    /// # Errors
    /// As of [`Self::words`].
    pub fn until_miss(&mut self, words: &[u32], tally: &mut impl Tally) -> Result<(usize, u32), TraceError> {
        for (i, &word) in words.iter().enumerate() {
            if ReferenceWord(word).is_read() {
                let (first, count) = self.lines.of(word);
                let missing = self.reference(first, count);
                tally.read(word, count, missing);
                if missing > 0 {
                    return Ok((i + 1, missing));
                }
            } else {
                mark(word, tally)?;
            }
        }
        Ok((words.len(), 0))
    }

    /// References lines in ascending order; returns how many were missing.
    #[inline(always)]
    fn reference(&mut self, first: u32, count: u32) -> u32 {
        if count == 1 {
            return self.misses(first);
        }
        (first..first + count).map(|line| self.misses(line)).sum()
    }

    /// References a line: 1 if it was missing, else 0.
    #[inline(always)]
    fn misses(&mut self, line: u32) -> u32 {
        if !R::REPEATED_HITS_COUNT && line == self.hit_last {
            return 0;
        }
        match self.directory.slot(line) {
            Some(slot) => {
                self.directory.hit(slot);
                self.hit_last = line;
                0
            }
            None => {
                self.miss(line);
                1
            }
        }
    }

    #[cold]
    #[inline(never)]
    fn miss(&mut self, line: u32) {
        self.directory.place(line, self.placement.set(line, |sets| self.lines.set(line, sets)));
        self.hit_last = NO_LINE;
    }
}

/// Counts a word that is no read.
#[inline(always)]
fn mark(word: u32, tally: &mut impl Tally) -> Result<(), TraceError> {
    ReferenceWord(word).ray_kind().map(|kind| tally.ray(kind)).ok_or_else(|| no_mark(word))
}

#[cold]
#[inline(never)]
fn no_mark(word: u32) -> TraceError {
    TraceError(match ReferenceWord(word).decode() {
        Some(_) => format!("{word:#010x}, expected a read or a ray: tracers write nothing"),
        None => format!("{word:#010x} is no word that this version knows"),
    })
}

/// Sums [`Counters`], all kinds and sections together; what belongs to tiles that were not accepted is left out.
pub struct Sum<'a, T: ?Sized> {
    trace: &'a T,
    accepted: bool,
    now: Counters,
    pub totals: Counters,
}

impl<'a, T: Trace + ?Sized> Sum<'a, T> {
    /// Of a replay of this trace.
    pub fn new(trace: &'a T) -> Self {
        Self { trace, accepted: false, now: Counters::default(), totals: Counters::default() }
    }

    /// All that was counted.
    pub fn finish(mut self) -> Counters {
        self.book();
        self.totals
    }

    fn book(&mut self) {
        let now = std::mem::take(&mut self.now);
        if self.accepted {
            self.totals.add(&now);
        }
    }
}

impl<T: Trace + ?Sized> Tally for Sum<'_, T> {
    fn tile(&mut self, tile: u32) {
        self.book();
        self.accepted = self.trace.tiles()[tile as usize].accepted;
    }

    #[inline(always)]
    fn ray(&mut self, _kind: RayKind) {}

    #[inline(always)]
    fn read(&mut self, _record: u32, lines: u32, missing: u32) {
        self.now.record_accesses += 1;
        self.now.line_accesses += u64::from(lines);
        self.now.record_misses += u64::from(missing > 0);
        self.now.line_misses += u64::from(missing);
    }
}
