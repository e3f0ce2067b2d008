//! What a record lacks: the lines that one transaction is to bring.

use super::WORD;
use crate::hardware::transaction::FetchRequest;
use ground::ids::Address;
use trace::database::Section;

/// The missing lines of one record, which lies in at most so many: 32, the bits of the mask, or fewer.
pub(super) struct Missing<const LINES_MAX: usize> {
    section: Section,
    /// The record's first line, missing or not.
    first: u32,
    /// Bit i: line `first + i` is missing.
    mask: u32,
    /// By i, the slot that the line was given.
    slots: [u32; LINES_MAX],
}

impl<const LINES_MAX: usize> Missing<LINES_MAX> {
    /// None yet.
    pub(super) fn new(section: Section, first: u32) -> Self {
        Self { section, first, mask: 0, slots: [0; LINES_MAX] }
    }

    pub(super) fn add(&mut self, line: u32, slot: u32) {
        let i = line - self.first;
        self.mask |= 1 << i;
        self.slots[i as usize] = slot;
    }

    /// Each with its slot, in ascending order.
    pub(super) fn lines(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        (self.first..).zip(self.slots).enumerate().filter(|(i, _)| self.mask >> i & 1 == 1).map(|(_, line)| line)
    }

    pub(super) fn is_empty(&self) -> bool {
        self.mask == 0
    }

    pub(super) fn count(&self) -> u32 {
        self.mask.count_ones()
    }

    pub(super) fn request(&self, line_shift: u32, accesses_before: u64) -> FetchRequest {
        let skipped = self.mask.trailing_zeros();
        FetchRequest {
            section: self.section,
            address: Address((u64::from(self.first + skipped) << line_shift) * WORD as u64),
            line_bytes: (WORD as u32) << line_shift,
            lines: self.mask >> skipped,
            accesses_before,
        }
    }
}

/// Copies what a line and a record have in common; both are given with their place in the image.
pub(super) fn copy_overlap(line: &[u32], line_start: u32, record: &mut [u32], record_start: u32) {
    let from = line_start.max(record_start);
    let to = (line_start + line.len() as u32).min(record_start + record.len() as u32);
    let within = |start: u32| (from - start) as usize..(to - start) as usize;
    record[within(record_start)].copy_from_slice(&line[within(line_start)]);
}
