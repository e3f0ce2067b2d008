//! What a memory writes, and how: of traces that came from elsewhere.
//!
//! The policies and what they count are those of Dinero IV (its `ref.c` and `misc.c`): a line is dirty as a whole; a write that
//! fills all of a line that is missing does not fetch it; a write that allocates nothing goes through, whatever the policy.

use serde::Serialize;

use crate::hardware::local_memory::{Directory, Geometry};
use crate::hardware::references::{Event, ReferenceWord};
use crate::hardware::replacement::{Lru, Replacement, with_policy};
use crate::hardware::specification;
use crate::hardware::stats::Counters;
use crate::replay::importers::{Imported, TableLines};
use crate::replay::stream::placement::Placement;
use crate::replay::{Lines, Trace, TraceError};

/// When what was written leaves the memory.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug, Serialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum WritePolicy {
    /// When its line is evicted
    #[default]
    Back,
    /// At once
    Through,
}

/// How a memory writes.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Writing {
    pub policy: WritePolicy,
    /// Whether a line that is missing is brought in to be written.
    pub allocate: bool,
}

impl Default for Writing {
    fn default() -> Self {
        Self { policy: WritePolicy::Back, allocate: true }
    }
}

/// Of one memory.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct WriteCounts {
    /// Of the line accesses, those that write.
    pub write_accesses: u64,
    /// Of the line misses, those of writes.
    pub write_misses: u64,
    /// Lines that were fetched: not those that are written without being brought in, or as a whole.
    pub lines_fetched: u64,
    /// Of dirty lines that were evicted or copied back.
    pub bytes_written_back: u64,
    /// Of lines that are dirty at the end.
    pub bytes_dirty_at_end: u64,
    /// Of writes that went to the cluster memory at once.
    pub bytes_written_through: u64,
}

/// The same in a row, empty where writes are not counted apart: with optimal replacement they count as reads.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug, Serialize)]
pub struct WriteColumns {
    pub write_policy: Option<WritePolicy>,
    pub write_allocate: Option<bool>,
    pub write_accesses: Option<u64>,
    pub write_misses: Option<u64>,
    pub bytes_written_back: Option<u64>,
    pub bytes_dirty_at_end: Option<u64>,
    pub bytes_written_through: Option<u64>,
}

impl WriteColumns {
    /// Of memories that write so.
    pub fn new(counts: WriteCounts, writing: Writing) -> Self {
        Self {
            write_policy: Some(writing.policy),
            write_allocate: Some(writing.allocate),
            write_accesses: Some(counts.write_accesses),
            write_misses: Some(counts.write_misses),
            bytes_written_back: Some(counts.bytes_written_back),
            bytes_dirty_at_end: Some(counts.bytes_dirty_at_end),
            bytes_written_through: Some(counts.bytes_written_through),
        }
    }
}

/// Counts what a memory with this policy makes of a trace.
///
/// # Errors
/// The trace's; a memory of more slots than can be simulated; SIEVE or S3-FIFO, and a trace with invalidations.
///
/// # Panics
/// `geometry` is that of other lines.
pub fn count_writes(
    trace: &Imported,
    geometry: Geometry,
    replacement: specification::Replacement,
    writing: Writing,
) -> Result<(Counters, WriteCounts), TraceError> {
    // Their queues have each slot once, and no place for one that is emptied.
    let has_queues = matches!(replacement, specification::Replacement::Sieve | specification::Replacement::S3Fifo);
    if has_queues && trace.notes().invalidations > 0 {
        return Err(TraceError(format!("{replacement} and a trace with invalidations: expected another policy")));
    }
    if replacement == specification::Replacement::Fifo {
        // First in, first out is least recently used without uses, also where lines are invalidated.
        return Memory::<Lru>::new(trace, geometry, writing, false)?.replay(trace);
    }
    with_policy!(replacement, R => Memory::<R>::new(trace, geometry, writing, true)?.replay(trace))
}

struct Memory<R> {
    lines: TableLines,
    placement: Placement,
    directory: Directory<R>,
    line_bytes: u64,
    writing: Writing,
    /// Whether hits concern the policy.
    renews: bool,
    dirty: DirtyLines,
    counters: Counters,
    counts: WriteCounts,
}

impl<R: Replacement> Memory<R> {
    fn new(trace: &Imported, geometry: Geometry, writing: Writing, renews: bool) -> Result<Self, TraceError> {
        const SEED: u64 = 1;
        let lines = trace.lines(geometry.line_bytes);
        assert_eq!(geometry.database_lines, lines.count(), "a memory's geometry is resolved for its lines");
        let placement = lines.placement(&geometry)?;
        Ok(Self {
            directory: Directory::new(placement.slots(), lines.count(), SEED),
            dirty: DirtyLines::new(lines.count()),
            lines,
            placement,
            line_bytes: geometry.line_bytes.into(),
            writing,
            renews,
            counters: Counters::default(),
            counts: WriteCounts::default(),
        })
    }

    fn replay(mut self, trace: &Imported) -> Result<(Counters, WriteCounts), TraceError> {
        let mut words = Vec::new();
        for part in trace.tiles().iter().flat_map(|tile| tile.parts.clone()) {
            trace.read(part, &mut words)?;
            for &word in &words {
                let event = ReferenceWord(word).decode();
                let event =
                    event.ok_or_else(|| TraceError(format!("{word:#010x} is no word that this version knows")))?;
                self.event(event, trace);
            }
        }
        self.counts.bytes_dirty_at_end = u64::from(self.dirty.count) * self.line_bytes;
        Ok((self.counters, self.counts))
    }

    fn event(&mut self, event: Event, trace: &Imported) {
        match event {
            Event::Read(record) => {
                let missing = self.lines_of(record).map(|line| self.read(line)).sum();
                self.count(record, missing);
            }
            Event::Write(record) => {
                let (address, bytes) = trace.extent(record);
                let (mut at, mut left) = (address % self.line_bytes, u64::from(bytes));
                let mut missing = 0;
                for line in self.lines_of(record) {
                    let bytes = left.min(self.line_bytes - at);
                    missing += self.write(line, bytes);
                    (at, left) = (0, left - bytes);
                }
                self.count(record, missing);
            }
            Event::CopyBack(record) => self.lines_of(record).for_each(|line| self.write_back(line)),
            Event::Invalidate(record) => self.lines_of(record).for_each(|line| {
                self.directory.invalidate(line);
                self.dirty.remove(line);
            }),
            Event::CopyBackAll => {
                self.counts.bytes_written_back += u64::from(self.dirty.count) * self.line_bytes;
                self.dirty.clear();
            }
            Event::InvalidateAll => {
                self.directory.clear();
                self.dirty.clear();
            }
            Event::Ray(_) => {}
        }
    }

    fn lines_of(&self, record: u32) -> std::ops::Range<u32> {
        let (first, count) = self.lines.of(record);
        first..first + count
    }

    fn count(&mut self, record: u32, missing: u64) {
        self.counters.record_accesses += 1;
        self.counters.record_misses += u64::from(missing > 0);
        self.counters.line_accesses += u64::from(self.lines.of(record).1);
        self.counters.line_misses += missing;
    }

    /// 1 if the line was missing, else 0.
    fn read(&mut self, line: u32) -> u64 {
        if self.hit(line) {
            return 0;
        }
        self.counts.lines_fetched += 1;
        self.place(line);
        1
    }

    /// Writes so many bytes of a line: 1 if it was missing, else 0.
    fn write(&mut self, line: u32, bytes: u64) -> u64 {
        self.counts.write_accesses += 1;
        let is_hit = self.hit(line);
        if !is_hit {
            self.counts.write_misses += 1;
            if self.writing.allocate {
                self.counts.lines_fetched += u64::from(bytes < self.line_bytes);
                self.place(line);
            }
        }
        let is_there = is_hit || self.writing.allocate;
        match self.writing.policy {
            WritePolicy::Back if is_there => self.dirty.insert(line),
            WritePolicy::Back | WritePolicy::Through => self.counts.bytes_written_through += bytes,
        }
        u64::from(!is_hit)
    }

    /// References a line if it is there, and whether it is.
    fn hit(&mut self, line: u32) -> bool {
        let slot = self.directory.slot(line);
        if let Some(slot) = slot.filter(|_| self.renews) {
            self.directory.hit(slot);
        }
        slot.is_some()
    }

    fn place(&mut self, line: u32) {
        if let Some(evicted) = self.directory.place(line, self.placement.set(line, |sets| self.lines.set(line, sets))) {
            self.write_back(evicted);
        }
    }

    fn write_back(&mut self, line: u32) {
        if self.dirty.remove(line) {
            self.counts.bytes_written_back += self.line_bytes;
        }
    }
}

/// Which lines are dirty.
struct DirtyLines {
    /// By line, a bit.
    bits: Vec<u64>,
    count: u32,
}

impl DirtyLines {
    fn new(lines: u32) -> Self {
        Self { bits: vec![0; lines.div_ceil(64) as usize], count: 0 }
    }

    fn insert(&mut self, line: u32) {
        let (bits, mask) = (&mut self.bits[line as usize / 64], 1 << (line % 64));
        if *bits & mask == 0 {
            *bits |= mask;
            self.count += 1;
        }
    }

    /// Whether it was dirty.
    fn remove(&mut self, line: u32) -> bool {
        let (bits, mask) = (&mut self.bits[line as usize / 64], 1 << (line % 64));
        let was_dirty = *bits & mask != 0;
        if was_dirty {
            *bits &= !mask;
            self.count -= 1;
        }
        was_dirty
    }

    fn clear(&mut self) {
        if self.count > 0 {
            self.bits.fill(0);
            self.count = 0;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fmt::Write;
    use std::path::Path;

    use super::*;
    use crate::hardware::specification::Replacement::{Clock, Fifo, Lru as LeastRecent, Random};
    use crate::replay::importers::din;

    fn trace(text: &str) -> Imported {
        din::read(Path::new("x.din"), text.as_bytes(), 16).expect("a trace")
    }

    fn geometry(trace: &Imported, (line_bytes, sets, ways): (u32, u64, u64)) -> Geometry {
        Geometry { line_bytes, database_lines: trace.lines(line_bytes).count(), sets, ways }
    }

    /// 3,000 lines of extended din: reads, writes, fetches and others of 1 to 64 bytes, which cross lines; copy backs and
    /// invalidations, of lines and of all. From a linear congruential generator (Knuth's MMIX).
    fn mixed() -> String {
        let mut state = 12_345u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            state >> 33
        };
        let mut text = String::new();
        for i in 0..3000 {
            let r = next();
            let mut address = next() % 96 * 16;
            address += next() % 16;
            let mut kind = char::from(b"rrrrwwwim"[(r % 9) as usize]);
            let mut size = [1, 2, 4, 8, 24, 64][(next() % 6) as usize];
            if r % 97 == 0 {
                kind = 'c';
            } else if r % 101 == 0 {
                kind = 'v';
            }
            if r % 907 == 0 && i > 0 {
                (kind, address, size) = ('c', 0, 0);
            }
            if r % 1511 == 0 && i > 0 {
                (kind, address, size) = ('v', 0, 0);
            }
            writeln!(text, "{kind} {address:x} {size:x}").expect("into memory");
        }
        text
    }

    /// What Dinero IV version 8 prints of [`mixed`] (atos-tools/dineroIV, cb3724c), each by `dineroIV -informat D -l1-usize
    /// SIZE -l1-ubsize LINE -l1-uassoc WAYS -l1-urepl l|f -l1-uwback a|n -l1-uwalloc a|n`: demand fetches and misses, those of
    /// writes, bytes from memory and to memory.
    #[test]
    fn dinero_counts_the_same() {
        let trace = trace(&mixed());
        // Line, sets, ways.
        let geometries = [(16, 32, 1), (32, 4, 4), (64, 1, 16)];
        let fetches = [(5857, 1878), (4413, 1413), (3693, 1196)];
        // By policy, write policy, allocation and geometry: misses, write misses, bytes from memory, bytes to memory.
        #[rustfmt::skip]
        let expected = [
            (LeastRecent, WritePolicy::Back, true, [(3931, 1281, 57_008, 25_840), (2991, 972, 92_448, 38_976), (1321, 440, 84_480, 48_128)]),
            (LeastRecent, WritePolicy::Back, false, [(4028, 1298, 43_680, 18_473), (3002, 969, 65_056, 22_286), (1329, 424, 57_920, 32_035)]),
            (LeastRecent, WritePolicy::Through, true, [(3931, 1281, 57_008, 15_838), (2991, 972, 92_448, 15_838), (1321, 440, 84_480, 15_838)]),
            (LeastRecent, WritePolicy::Through, false, [(4028, 1298, 43_680, 15_838), (3002, 969, 65_056, 15_838), (1329, 424, 57_920, 15_838)]),
            (Fifo, WritePolicy::Back, true, [(3931, 1281, 57_008, 25_840), (2997, 971, 92_640, 39_456), (1302, 422, 83_328, 51_456)]),
            (Fifo, WritePolicy::Back, false, [(4028, 1298, 43_680, 18_473), (2994, 979, 64_480, 22_960), (1292, 425, 55_488, 37_606)]),
            (Fifo, WritePolicy::Through, true, [(3931, 1281, 57_008, 15_838), (2997, 971, 92_640, 15_838), (1302, 422, 83_328, 15_838)]),
            (Fifo, WritePolicy::Through, false, [(4028, 1298, 43_680, 15_838), (2994, 979, 64_480, 15_838), (1292, 425, 55_488, 15_838)]),
        ];
        for (replacement, policy, allocate, rows) in expected {
            for ((shape, fetches), row) in geometries.into_iter().zip(fetches).zip(rows) {
                let writing = Writing { policy, allocate };
                let counted = count_writes(&trace, geometry(&trace, shape), replacement, writing).expect("few");
                let (counters, counts) = counted;
                assert_eq!((counters.line_accesses, counts.write_accesses), fetches, "{shape:?}");
                let to_memory = counts.bytes_written_back + counts.bytes_dirty_at_end + counts.bytes_written_through;
                let from_memory = counts.lines_fetched * u64::from(shape.0);
                assert_eq!(
                    (counters.line_misses, counts.write_misses, from_memory, to_memory),
                    row,
                    "{replacement:?} {writing:?} {shape:?}"
                );
            }
        }
    }

    #[test]
    fn a_line_is_written_back_once() {
        // By hand, two lines of 16 bytes in one set. 0 and 16 are dirty, 32 evicts 0; 16 is copied back, 32 is not dirty;
        // 16 is written again and dropped; at the end 48 is dirty.
        let trace = trace("w 0 4\nw 10 4\nr 20 4\nc 10 1\nc 20 1\nw 10 4\nv 10 1\nr 20 4\nw 30 10\n");
        for replacement in [LeastRecent, Fifo, Clock, Random] {
            let counted = count_writes(&trace, geometry(&trace, (16, 1, 2)), replacement, Writing::default());
            let (counters, counts) = counted.expect("few");
            if replacement == Random {
                // Which line 32 evicts is random, but something dirty is.
                assert_eq!((counters.line_accesses, counts.write_accesses), (6, 4));
                continue;
            }
            let expected = WriteCounts {
                write_accesses: 4,
                write_misses: 3,
                // All but 48, which is written whole.
                lines_fetched: 3,
                bytes_written_back: 32,
                bytes_dirty_at_end: 16,
                bytes_written_through: 0,
            };
            assert_eq!((counts, counters.line_misses), (expected, 4), "{replacement:?}");
        }
    }

    #[test]
    fn what_has_queues_knows_no_invalidations() {
        use crate::hardware::specification::Replacement::{S3Fifo, Sieve};
        let invalidated = trace("r 0 4\nv 0 4\nr 0 4\n");
        let written = trace("w 0 4\nr 10 4\nr 20 4\nr 0 4\n");
        for replacement in [Sieve, S3Fifo] {
            let count = |trace| count_writes(trace, geometry(trace, (16, 1, 2)), replacement, Writing::default());
            let error = count(&invalidated).expect_err("no place").to_string();
            assert!(error.ends_with("and a trace with invalidations: expected another policy"), "{error}");
            assert_eq!(count(&written).expect("few").1.write_accesses, 1);
        }
    }

    #[test]
    fn without_invalidations_writes_that_allocate_miss_as_reads_do() {
        use crate::replay::model::replayer::{Replayer, Sum, Tally};
        use crate::replay::stream::reads::writes_as_reads;
        let text: String =
            mixed().lines().filter(|line| !line.starts_with('v')).flat_map(|line| [line, "\n"]).collect();
        let trace = trace(&text);
        for shape in [(16, 32, 1), (32, 5, 3), (64, 1, 16), (128, 1, 3)] {
            let lines = trace.lines(shape.0);
            let mut replayer = Replayer::<Lru, _>::new(&lines, geometry(&trace, shape), 1).expect("few");
            let mut sum = Sum::new(&trace);
            let mut words = Vec::new();
            sum.tile(0);
            for part in trace.tiles()[0].parts.clone() {
                trace.read(part, &mut words).expect("a sound trace");
                writes_as_reads(&mut words);
                replayer.words(&words, &mut sum).expect("reads");
            }
            let counted = count_writes(&trace, geometry(&trace, shape), LeastRecent, Writing::default());
            assert_eq!(counted.expect("few").0, sum.finish(), "{shape:?}");
        }
    }
}
