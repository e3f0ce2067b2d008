//! When a line is referenced again, which only the future shows: from the end of a trace back to its beginning.
//!
//! A first pass goes back over the parts and writes down, for each, the lines that it uses, and when each of these is
//! used next after the part. That is a small fraction of the references, and goes to an unnamed temporary file. A
//! second pass goes forward, and back within a part at a time. So memory depends on lines and parts, not on how much
//! is referenced.

use std::fs::File;
use std::os::unix::fs::FileExt;

use crate::replay::stream::reads;
use crate::replay::{Lines, Trace, TraceError};

/// A reference to a line, but for those that follow another one to the same line at once: these hit in any memory.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Use {
    pub line: u32,
    /// Of the part, the record that it belongs to.
    pub record: u32,
    /// How many uses are left when the line is used next, that one included; 0: never again. The smaller, the later.
    pub next: u64,
}

/// The references of a part, as [`NextUses::for_each_part`] tells them.
#[derive(Clone, Copy, Debug)]
pub struct Uses<'a> {
    /// Whether the part's tile was.
    pub accepted: bool,
    pub uses: &'a [Use],
    /// How many uses are left before the first of these, all these included.
    pub left: u64,
    pub record_accesses: u64,
    /// With those that are no uses.
    pub line_accesses: u64,
}

/// The references of one process, each with the next one to its line.
pub struct NextUses<'a, T: ?Sized, L> {
    trace: &'a T,
    lines: &'a L,
    parts: Vec<PartSummary>,
    /// By part, from the last to the first: what is used after it, [`Next`].
    file: File,
    uses: u64,
}

/// A part of the trace, and where its lines are in the file.
#[derive(Clone, Copy, Debug)]
struct PartSummary {
    part: u32,
    accepted: bool,
    /// In entries.
    start: u64,
    lines: u32,
}

/// When a line is used after a part: the line, and [`Use::next`], low half first.
type Next = [u32; 3];

impl<'a, T: Trace + ?Sized, L: Lines> NextUses<'a, T, L> {
    /// Goes back over `tiles`, those that one process traced, in order, as indices into those of the trace.
    ///
    /// # Errors
    /// The trace's; a word of a kind that this version does not know, or a record that does not exist; the temporary
    /// file cannot be written.
    pub fn new(trace: &'a T, tiles: &[u32], lines: &'a L) -> Result<Self, TraceError> {
        let file = tempfile::tempfile().map_err(|error| trouble(&error))?;
        let tiles = tiles.iter().map(|&tile| &trace.tiles()[tile as usize]);
        let parts = tiles.flat_map(|tile| tile.parts.clone().map(|part| (part, tile.accepted)));
        let summary = |(part, accepted)| PartSummary { part, accepted, start: 0, lines: 0 };
        let mut this = Self { trace, lines, parts: parts.map(summary).collect(), file, uses: 0 };
        this.summarise()?;
        Ok(this)
    }

    /// Gives the parts to `each` in order.
    ///
    /// # Errors
    /// As [`Self::new`]'s.
    pub fn for_each_part(&self, mut each: impl FnMut(Uses<'_>)) -> Result<(), TraceError> {
        let mut next = vec![0u64; self.lines.count() as usize];
        let (mut part, mut entries) = (Part::default(), Vec::<Next>::new());
        let mut left = self.uses;
        for summary in &self.parts {
            part.read(self.trace, self.lines, summary.part)?;
            entries.resize(summary.lines as usize, [0; 3]);
            self.file
                .read_exact_at(bytemuck::cast_slice_mut(&mut entries), summary.start * size_of::<Next>() as u64)
                .map_err(|error| trouble(&error))?;
            for &[line, low, high] in &entries {
                next[line as usize] = u64::from(high) << 32 | u64::from(low);
            }
            let after = left - part.uses.len() as u64;
            for (now, used) in (after + 1..).zip(part.uses.iter_mut().rev()) {
                used.next = std::mem::replace(&mut next[used.line as usize], now);
            }
            let Part { uses, record_accesses, line_accesses, .. } = &part;
            let (record_accesses, line_accesses) = (*record_accesses, *line_accesses);
            each(Uses { accepted: summary.accepted, uses, left, record_accesses, line_accesses });
            left = after;
        }
        Ok(())
    }

    fn summarise(&mut self) -> Result<(), TraceError> {
        let mut next = vec![0u64; self.lines.count() as usize];
        let (mut part, mut entries) = (Part::default(), Vec::<Next>::new());
        let mut start = 0;
        for summary in self.parts.iter_mut().rev() {
            part.read(self.trace, self.lines, summary.part)?;
            entries.clear();
            let after = self.uses;
            for used in part.uses.iter().rev() {
                self.uses += 1;
                let known = std::mem::replace(&mut next[used.line as usize], self.uses);
                if known <= after {
                    entries.push([used.line, known as u32, (known >> 32) as u32]);
                }
            }
            self.file
                .write_all_at(bytemuck::cast_slice(&entries), start * size_of::<Next>() as u64)
                .map_err(|error| trouble(&error))?;
            (summary.start, summary.lines) = (start, entries.len() as u32);
            start += entries.len() as u64;
        }
        Ok(())
    }
}

/// A part's uses, without their next ones.
#[derive(Debug, Default)]
struct Part {
    words: Vec<u32>,
    uses: Vec<Use>,
    record_accesses: u64,
    line_accesses: u64,
}

impl Part {
    fn read(&mut self, trace: &(impl Trace + ?Sized), lines: &impl Lines, part: u32) -> Result<(), TraceError> {
        trace.read(part, &mut self.words)?;
        self.uses.clear();
        let uses = &mut self.uses;
        let (mut records, mut references, mut before) = (0, 0, None);
        reads::for_each(&self.words, lines, |first, count| {
            for line in first..first + count {
                if before != Some(line) {
                    uses.push(Use { line, record: records, next: 0 });
                    before = Some(line);
                }
            }
            records += 1;
            references += u64::from(count);
        })?;
        (self.record_accesses, self.line_accesses) = (u64::from(records), references);
        Ok(())
    }
}

fn trouble(error: &std::io::Error) -> TraceError {
    TraceError(format!("a temporary file for next uses: {error}"))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::replay::stream::reads::tests::{Overlapping, captured};

    proptest! {
        #[test]
        fn next_uses_are_found_by_looking_ahead(
            records in prop::collection::vec(0u32..60, 1..200), part in 1usize..40,
        ) {
            let lines = Overlapping { lines: 32 };
            let (one, two) = records.split_at(records.len() / 2);
            let trace = captured(&[one, two], part);
            let mut told = Vec::new();
            let (mut record_accesses, mut line_accesses) = (0, 0);
            let uses = NextUses::new(&trace, &[0, 1], &lines).expect("sound");
            uses.for_each_part(|part| {
                assert_eq!(part.left, uses.uses - told.len() as u64);
                record_accesses += part.record_accesses;
                line_accesses += part.line_accesses;
                told.extend(part.uses.iter().map(|used| (used.line, used.next)));
            }).expect("sound");
            prop_assert_eq!(record_accesses, records.len() as u64);
            prop_assert_eq!(line_accesses, records.iter().map(|&record| u64::from(lines.of(record).1)).sum::<u64>());
            for (i, &(line, next)) in told.iter().enumerate() {
                let ahead = told[i + 1..].iter().position(|&(l, _)| l == line);
                prop_assert_eq!(next, ahead.map_or(0, |ahead| (told.len() - (i + 1 + ahead)) as u64));
            }
        }
    }
}
