//! Where the records of an imported trace lie: only what is referenced has a place.

use std::sync::Arc;

use crate::replay::Lines;

/// A reference's bytes are at most so many.
pub(super) const EXTENT_BYTES_MAX: u32 = 1 << 20;

/// A trace has at most so many different lines, or objects.
pub(super) const LINES_MAX: u64 = 1 << 28;

/// Lines whose run is looked up together.
const BLOCK_SHIFT: u32 = 6;

/// No line is shorter.
const LINE_BYTES_MIN: u64 = 16;

/// Bytes that are referenced together. What lies within a line of the shortest size begins where that does: it is in the same
/// lines, and there are fewer different ones.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(super) struct Extent {
    address: u64,
    bytes: u32,
}

impl Extent {
    /// # Errors
    /// What is wrong, and what was expected.
    pub(super) fn new(address: u64, bytes: u32) -> Result<Self, String> {
        if !(1..=EXTENT_BYTES_MAX).contains(&bytes) {
            return Err(format!("{bytes} bytes, expected 1 to {EXTENT_BYTES_MAX}"));
        }
        let Some(last) = address.checked_add(u64::from(bytes) - 1) else {
            return Err(format!("address {address:#x} and {bytes} bytes, expected an end within 64 bits"));
        };
        let first = address - address % LINE_BYTES_MIN;
        Ok(Self { address: if last - first < LINE_BYTES_MIN { first } else { address }, bytes })
    }

    pub(super) fn address(self) -> u64 {
        self.address
    }

    pub(super) fn bytes(self) -> u32 {
        self.bytes
    }

    /// 32-bit words, a begun one too.
    pub(super) fn words(self) -> u32 {
        self.bytes.div_ceil(4)
    }

    /// The first line and the last, of so many bytes each.
    fn lines(self, line_shift: u32) -> (u64, u64) {
        (self.address >> line_shift, (self.address + (u64::from(self.bytes) - 1)) >> line_shift)
    }
}

/// The lines of an imported trace, or its objects, which are a line each.
///
/// Of all memory only lines that are referenced are there. They are numbered in ascending order of their addresses, so that
/// the lines of a record follow one another; objects are numbered as they first appear. Sets are those of the true numbers.
#[derive(Clone, Debug)]
pub struct TableLines {
    /// By record, its first line, and how many lines it lies in.
    records: Arc<[(u32, u32)]>,
    numbers: Numbers,
    count: u32,
}

/// The true numbers of lines.
#[derive(Clone, Debug)]
enum Numbers {
    Runs {
        runs: Arc<[Run]>,
        /// By 64 lines, the run of the first of these.
        blocks: Arc<[u32]>,
    },
    /// By object.
    Objects(Arc<[u64]>),
}

/// Lines that follow one another in memory.
#[derive(Clone, Copy, Debug)]
struct Run {
    /// The first line, as it is numbered here.
    first: u32,
    /// Its true number.
    number: u64,
}

impl TableLines {
    /// Lines of so many bytes, a power of two.
    ///
    /// # Errors
    /// There are too many.
    pub(super) fn of_extents(extents: &[Extent], line_bytes: u32) -> Result<Self, String> {
        let line_shift = line_bytes.trailing_zeros();
        let mut ranges: Vec<(u64, u64)> = extents.iter().map(|extent| extent.lines(line_shift)).collect();
        ranges.sort_unstable();
        ranges.dedup();
        let mut runs: Vec<Run> = Vec::new();
        // How many lines there are, and the last one's true number.
        let (mut count, mut end) = (0u64, None::<u64>);
        for (first, last) in ranges {
            // Ranges are in ascending order: what is there already is their beginning.
            let first = match end {
                Some(end) if first <= end.saturating_add(1) => end.saturating_add(1),
                _ => {
                    runs.push(Run { first: count as u32, number: first });
                    first
                }
            };
            if end.is_some_and(|end| last <= end) {
                continue;
            }
            count += last - first + 1;
            end = Some(last);
            if count > LINES_MAX {
                return Err(format!(
                    "references to more than {LINES_MAX} different lines of {line_bytes} bytes, expected fewer or longer ones"
                ));
            }
        }
        let place = |extent: &Extent| {
            let (first, last) = extent.lines(line_shift);
            // Each extent's lines are within one run.
            let run = runs[runs.partition_point(|run| run.number <= first) - 1];
            (run.first + (first - run.number) as u32, (last - first + 1) as u32)
        };
        let records = extents.iter().map(place).collect();
        let mut blocks = Vec::new();
        for (i, run) in (0u32..).zip(&runs) {
            // Blocks that begin before this run begin in the one before it.
            blocks.resize(blocks.len().max(run.first.div_ceil(1 << BLOCK_SHIFT) as usize), i.saturating_sub(1));
        }
        blocks.resize((count as usize).div_ceil(1 << BLOCK_SHIFT), runs.len().saturating_sub(1) as u32);
        Ok(Self { records, numbers: Numbers::Runs { runs: runs.into(), blocks: blocks.into() }, count: count as u32 })
    }

    /// Objects, at most [`LINES_MAX`], with these numbers.
    pub(super) fn of_objects(numbers: Vec<u64>) -> Self {
        let count = numbers.len() as u32;
        Self { records: (0..count).map(|i| (i, 1)).collect(), numbers: Numbers::Objects(numbers.into()), count }
    }

    /// The number that a line has among all lines of the address space.
    fn number(&self, line: u32) -> u64 {
        match &self.numbers {
            Numbers::Objects(numbers) => numbers[line as usize],
            Numbers::Runs { runs, blocks } => {
                let block = (line >> BLOCK_SHIFT) as usize;
                let first = blocks[block] as usize;
                // A block has no more runs than lines.
                let last = blocks.get(block + 1).map_or(runs.len() - 1, |&last| last as usize);
                let after = runs[first..=last].partition_point(|run| run.first <= line);
                let run = runs[first + after - 1];
                run.number + u64::from(line - run.first)
            }
        }
    }
}

impl Lines for TableLines {
    #[inline(always)]
    fn of(&self, record: u32) -> (u32, u32) {
        self.records[record as usize]
    }

    fn count(&self) -> u32 {
        self.count
    }

    #[inline(always)]
    fn set(&self, line: u32, sets: u64) -> u64 {
        if sets == 1 { 0 } else { self.number(line) % sets }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// Brute force: every line of every extent in a set of true numbers.
        #[test]
        fn lines_are_those_of_the_addresses(
            extents in prop::collection::vec((0u64..40_000, 1u32..3000, any::<bool>()), 1..80),
            line_shift in 4u32..17,
        ) {
            let far = |(address, bytes, far)| (address + if far { 1u64 << 50 } else { 0 }, bytes);
            let extents: Vec<(u64, u32)> = extents.into_iter().map(far).collect();
            let possible = |&(address, bytes): &(u64, u32)| Extent::new(address, bytes).expect("possible");
            let lines = TableLines::of_extents(&extents.iter().map(possible).collect::<Vec<_>>(), 1 << line_shift);
            let lines = lines.expect("few");
            let line = |byte: u64| byte >> line_shift;
            let of = |&(address, bytes): &(u64, u32)| line(address)..=line(address + u64::from(bytes) - 1);
            let all: Vec<u64> = extents.iter().flat_map(of).collect::<BTreeSet<u64>>().into_iter().collect();
            prop_assert_eq!(lines.count() as usize, all.len());
            for (line, &number) in (0..).zip(&all) {
                prop_assert_eq!(lines.number(line), number);
                prop_assert_eq!(lines.set(line, 7), number % 7);
            }
            for (record, extent) in (0..).zip(&extents) {
                let (first, count) = lines.of(record);
                prop_assert!(all[first as usize..][..count as usize].iter().copied().eq(of(extent)));
            }
        }
    }

    #[test]
    fn the_last_line_of_all_can_be_referenced() {
        let extents = [(u64::MAX, 1), (u64::MAX - 20, 21), (0, 1)];
        let extents = extents.map(|(address, bytes)| Extent::new(address, bytes).expect("possible"));
        let lines = TableLines::of_extents(&extents, 16).expect("few");
        assert_eq!(([0, 1, 2].map(|record| lines.of(record)), lines.count()), ([(2, 1), (1, 2), (0, 1)], 3));
        assert_eq!([0, 1, 2].map(|line| lines.number(line)), [0, (1 << 60) - 2, (1 << 60) - 1]);
        assert!(Extent::new(u64::MAX, 2).is_err());
    }

    #[test]
    fn too_many_lines_are_refused_and_longer_ones_are_not() {
        // 4097 times 2¹⁶ lines of 16 bytes, with room between them.
        let extents: Vec<Extent> = (0..4097).map(|i| Extent::new(i << 21, 1 << 20).expect("possible")).collect();
        assert_eq!(
            TableLines::of_extents(&extents, 16).expect_err("too many"),
            "references to more than 268435456 different lines of 16 bytes, expected fewer or longer ones"
        );
        let lines = TableLines::of_extents(&extents, 1 << 16).expect("fewer");
        assert_eq!((lines.count(), lines.of(4096), lines.number(16)), (4097 * 16, (4096 * 16, 16), 32));
    }
}
