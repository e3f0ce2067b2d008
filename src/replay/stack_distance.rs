//! LRU stack distances (Mattson, Gecsei, Slutz, Traiger 1970) of one line after the other.
//!
//! Each reference takes the next time. A bit by time tells whether it is the latest reference to its line; the set bits
//! after a line's own are the lines referenced since. Counts of bits stand in a tree of fan-out 64 over the bitmap, and
//! a reference climbs it only as far as its line's last time and now are apart: to a word or two for most, as tracing
//! is very local. When times run out, the set bits are numbered anew.

/// Levels of counts above the bitmap; times are below 64 to the power of one more.
const LEVELS: usize = 4;
/// Fan-out, as a shift and as a mask.
const SHIFT: u32 = 6;
const MASK: u32 = 63;
/// A multiple of 64, so that every level has at least a node.
const TIMES_MIN: usize = 4096;

/// The lines of a memory in the order of their latest reference.
#[derive(Clone, Debug)]
pub struct LruStack {
    /// By line, when it was referenced last; 0 for never. Zeroed pages cost nothing until they are touched.
    last: Vec<u32>,
    /// By time, the line that was referenced.
    lines: Vec<u32>,
    /// By time, a bit: whether that was its line's latest reference.
    latest: Vec<u64>,
    /// By level, how many bits are set in 64, 64², … times.
    counts: [Vec<u32>; LEVELS],
    /// Of the next reference, at least 1.
    now: u32,
    /// The line referenced before, if any.
    newest: Option<u32>,
    distinct: u32,
}

impl LruStack {
    /// The distance of a line that was not referenced before.
    pub const FIRST: u32 = u32::MAX;

    /// An empty stack for lines below `lines`, at most 2²⁸.
    pub fn new(lines: u32) -> Self {
        assert!(lines <= 1 << 28, "an image of 2³² bytes has no more lines of 16");
        Self {
            last: vec![0; lines as usize],
            lines: Vec::new(),
            latest: Vec::new(),
            counts: Default::default(),
            now: 1,
            newest: None,
            distinct: 0,
        }
        .with_times(TIMES_MIN)
    }

    /// How many other lines were referenced since this one was, or [`Self::FIRST`]. It is in a memory of as many lines
    /// as are more than that, and of no fewer.
    ///
    /// # Panics
    /// `line` is not below the number of lines.
    #[inline(always)]
    pub fn reference(&mut self, line: u32) -> u32 {
        if self.newest == Some(line) {
            return 0;
        }
        self.newest = Some(line);
        self.renew(line)
    }

    /// How many lines were referenced so far.
    pub fn distinct(&self) -> u32 {
        self.distinct
    }

    #[inline]
    fn renew(&mut self, line: u32) -> u32 {
        if self.now as usize == self.lines.len() {
            self.number_anew();
        }
        let now = self.now;
        self.now += 1;
        self.lines[now as usize] = line;
        let last = std::mem::replace(&mut self.last[line as usize], now);
        let (mut old, mut new) = (last >> SHIFT, now >> SHIFT);
        let mut distance = Self::FIRST;
        if last == 0 {
            self.distinct += 1;
            for counts in &mut self.counts {
                counts[new as usize] += 1;
                new >>= SHIFT;
            }
        } else {
            let word = &mut self.latest[old as usize];
            // Two shifts, as one by 64 is none.
            distance = (*word >> (last & MASK) >> 1).count_ones();
            *word &= !(1 << (last & MASK));
            for counts in &mut self.counts {
                if old == new {
                    break;
                }
                // Within the node above: what is between, and up to now.
                let end = new.min(old | MASK);
                distance += counts[old as usize + 1..=end as usize].iter().sum::<u32>();
                counts[old as usize] -= 1;
                counts[new as usize] += 1;
                (old, new) = (old >> SHIFT, new >> SHIFT);
            }
        }
        self.latest[(now >> SHIFT) as usize] |= 1 << (now & MASK);
        distance
    }

    /// Gives the latest references of all lines the first times, in the same order. With at least four times as many
    /// as there are lines, that costs less than a step a reference.
    #[cold]
    #[inline(never)]
    fn number_anew(&mut self) {
        let times = TIMES_MIN.max((self.distinct as usize * 4).next_power_of_two());
        let last = std::mem::take(&mut self.last);
        let old = std::mem::replace(self, Self { last, ..Self::new(0) }.with_times(times));
        (self.newest, self.distinct) = (old.newest, old.distinct);
        for (word, mut bits) in old.latest.into_iter().enumerate() {
            while bits != 0 {
                let line = old.lines[word << SHIFT | bits.trailing_zeros() as usize];
                bits &= bits - 1;
                self.lines[self.now as usize] = line;
                self.last[line as usize] = self.now;
                self.latest[(self.now >> SHIFT) as usize] |= 1 << (self.now & MASK);
                for (level, counts) in (1..).zip(&mut self.counts) {
                    counts[(self.now >> (level * SHIFT)) as usize] += 1;
                }
                self.now += 1;
            }
        }
    }

    /// With room for so many times, a power of two, and none taken.
    fn with_times(self, times: usize) -> Self {
        Self {
            lines: vec![0; times],
            latest: vec![0; times >> SHIFT],
            counts: [1, 2, 3, 4].map(|level| vec![0; (times >> (level * SHIFT)) + 1]),
            ..self
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A list with the newest line first.
    pub(in crate::replay) fn by_list(references: &[u32]) -> Vec<u32> {
        let mut list = Vec::new();
        let distance = |&line: &u32| {
            let place = list.iter().position(|&l| l == line);
            place.map(|place| list.remove(place));
            list.insert(0, line);
            place.map_or(LruStack::FIRST, |place| place as u32)
        };
        references.iter().map(distance).collect()
    }

    fn by_stack(lines: u32, references: &[u32]) -> Vec<u32> {
        let mut stack = LruStack::new(lines);
        references.iter().map(|&line| stack.reference(line)).collect()
    }

    #[test]
    fn distances_by_hand() {
        const FIRST: u32 = LruStack::FIRST;
        // a b c b b a d c
        assert_eq!(by_stack(4, &[0, 1, 2, 1, 1, 0, 3, 2]), [FIRST, FIRST, FIRST, 1, 0, 2, FIRST, 3]);
    }

    #[test]
    fn long_strings_agree_with_a_list() {
        // Cyclic sweeps over ever more lines, whose distances reach all levels that are in use, and jumps.
        for lines in [70u32, 1500, 3000] {
            let sweeps = (0..30_000u32).map(|i| if i % 7 == 0 { i.wrapping_mul(0x9E37_79B1) >> 8 } else { i } % lines);
            let references: Vec<u32> = sweeps.collect();
            assert!(by_stack(lines, &references) == by_list(&references), "{lines}");
        }
    }

    #[test]
    fn far_lines_are_counted_across_the_upper_levels() {
        // All of 300 000 lines, twice: the distance is always that of all others. Times reach the third level.
        let lines = 300_000;
        let mut stack = LruStack::new(lines);
        assert!((0..lines).all(|line| stack.reference(line) == LruStack::FIRST));
        for _ in 0..5 {
            assert!((0..lines).all(|line| stack.reference(line) == lines - 1));
        }
        // And backwards: 0, 1, 2, ….
        assert!((0..lines).rev().zip(0..).all(|(line, distance)| stack.reference(line) == distance));
        assert_eq!(stack.distinct(), lines);
        assert_eq!(stack.lines.len(), 1 << 21, "at most eight times for a line");
    }

    proptest! {
        #[test]
        fn agrees_with_a_list(references in prop::collection::vec(prop_oneof![0u32..8, 0u32..300], 0..9000)) {
            prop_assert_eq!(by_stack(300, &references), by_list(&references));
        }
    }
}
