//! LRU stack distances (Mattson, Gecsei, Slutz, Traiger 1970).
//!
//! Each reference takes the next time. A bit by time says whether it is the latest reference to its line; the set bits
//! after a line's own are the lines referenced since. Tracing is very local: most lines were referenced within the
//! newest two words of that bitmap, and their distances are found there without a branch. The others are looked up
//! behind these in a tree of counts of fan-out 64. When times run out, the set bits are numbered anew.

use trace::tracer::simd::{Registers, Simd, Task};

/// Fan-out, as a shift and as a mask.
const SHIFT: u32 = 6;
const MASK: u32 = 63;
/// Levels of counts above those of words. Times are below 2³⁰: the topmost has no more than one full node.
const LEVELS: usize = 3;
const TIMES_MIN: usize = 4096;
/// The first time, so that a line that was never referenced seems older than the newest two words.
const BEGINNING: u32 = 2 << SHIFT;

/// The lines of a memory in the order of their latest reference.
#[derive(Clone, Debug)]
pub struct LruStack {
    simd: Simd,
    /// By line, when it was referenced last; 0 for never. Zeroed pages cost nothing until they are touched.
    last: Vec<u32>,
    /// By time, the line that was referenced.
    lines: Vec<u32>,
    /// By time, a bit: whether that was its line's latest reference.
    latest: Vec<u64>,
    /// By word of these, how many bits are set, in groups; the newest two words are not counted yet.
    words: Vec<[u8; 1 << SHIFT]>,
    /// By level, the sums of 64, 64², 64³ words.
    sums: [Vec<u32>; LEVELS],
    /// Of the next reference.
    now: u32,
    distinct: u32,
}

impl LruStack {
    /// The distance of a line that was not referenced before.
    pub const FIRST: u32 = u32::MAX;

    /// An empty stack for lines below `lines`, at most 2²⁸.
    pub fn new(lines: u32) -> Self {
        assert!(lines <= 1 << 28, "an image of 2³² bytes has no more lines of 16");
        Self::with_times(vec![0; lines as usize], TIMES_MIN)
    }

    /// References lines in this order. For each, how many others were referenced since it was, or [`Self::FIRST`]: it
    /// is in a memory of as many lines as are more than that, and of no fewer.
    ///
    /// # Panics
    /// A line is not below the number of lines, or there are not as many distances.
    pub fn references(&mut self, lines: &[u32], distances: &mut [u32]) {
        assert_eq!(lines.len(), distances.len());
        self.simd.run(References { stack: self, lines, distances });
    }

    /// How many lines were referenced so far.
    pub fn distinct(&self) -> u32 {
        self.distinct
    }

    /// References lines at times that lie in one word.
    #[inline(always)]
    fn word(&mut self, lines: &[u32], distances: &mut [u32]) {
        let now = self.now;
        let word = now >> SHIFT;
        if now & MASK == 0 {
            self.count(word - 2);
        }
        self.lines[now as usize..][..lines.len()].copy_from_slice(lines);
        let (mut newest, mut second) = (self.latest[word as usize], self.latest[word as usize - 1]);
        let (mut newest_bits, mut second_bits) = (newest.count_ones(), second.count_ones());
        let mut far = [Far::default(); 1 << SHIFT];
        let mut fars = 0;
        for (at, (&line, distance)) in (0..).zip(lines.iter().zip(distances.iter_mut())) {
            let last = std::mem::replace(&mut self.last[line as usize], now + at);
            let bit = last & MASK;
            let (in_newest, in_second) = (last >> SHIFT == word, last >> SHIFT == word - 1);
            let after = if in_newest { newest } else { second } >> bit >> 1;
            *distance = after.count_ones() + if in_newest { 0 } else { newest_bits };
            far[fars & MASK as usize] = Far { at, last, distance: newest_bits + second_bits };
            fars += usize::from(!(in_newest | in_second));
            newest &= !(u64::from(in_newest) << bit);
            second &= !(u64::from(in_second) << bit);
            newest |= 1 << ((now + at) & MASK);
            newest_bits += u32::from(!in_newest);
            second_bits -= u32::from(in_second);
        }
        (self.latest[word as usize], self.latest[word as usize - 1]) = (newest, second);
        self.now += lines.len() as u32;
        // These change nothing in the newest two words.
        for far in &far[..fars] {
            distances[far.at as usize] = if far.last == 0 {
                self.distinct += 1;
                Self::FIRST
            } else {
                far.distance + self.take(far.last, word - 2)
            };
        }
    }

    /// Takes the bit of a time out of the counted words, the newest of which is given, and counts those after it.
    #[inline(always)]
    fn take(&mut self, time: u32, newest: u32) -> u32 {
        let (mut old, mut new) = (time >> SHIFT, newest);
        let word = &mut self.latest[old as usize];
        let mut after = (*word >> (time & MASK) >> 1).count_ones();
        *word &= !(1 << (time & MASK));
        let group = &mut self.words[(old >> SHIFT) as usize];
        after += sum_after(group, old & MASK);
        group[(old & MASK) as usize] -= 1;
        for sums in &mut self.sums {
            (old, new) = (old >> SHIFT, new >> SHIFT);
            sums[old as usize] -= 1;
            if old != new {
                // The rest of this node; what is after it, the levels above tell.
                after += sums[old as usize + 1..=new.min(old | MASK) as usize].iter().sum::<u32>();
            }
        }
        after
    }

    /// Counts a word that is no longer one of the newest two.
    #[inline(never)]
    fn count(&mut self, word: u32) {
        let bits = self.latest[word as usize].count_ones();
        self.words[(word >> SHIFT) as usize][(word & MASK) as usize] = bits as u8;
        for (level, sums) in (1..).zip(&mut self.sums) {
            sums[(word >> (level * SHIFT)) as usize] += bits;
        }
    }

    /// Gives the latest references of all lines the first times, in the same order. At least twice as many times are
    /// left as there are lines, so that this costs less than a step a reference.
    #[cold]
    #[inline(never)]
    fn number_anew(&mut self) {
        let times = TIMES_MIN.max((self.distinct as usize * 3 + BEGINNING as usize).next_power_of_two());
        let last = std::mem::take(&mut self.last);
        let old = std::mem::replace(self, Self::with_times(last, times));
        (self.simd, self.distinct) = (old.simd, old.distinct);
        for (word, mut bits) in old.latest.into_iter().enumerate() {
            while bits != 0 {
                let line = old.lines[word << SHIFT | bits.trailing_zeros() as usize];
                bits &= bits - 1;
                if self.now & MASK == 0 {
                    self.count((self.now >> SHIFT) - 2);
                }
                self.lines[self.now as usize] = line;
                self.last[line as usize] = self.now;
                self.latest[(self.now >> SHIFT) as usize] |= 1 << (self.now & MASK);
                self.now += 1;
            }
        }
    }

    /// With so many times, a power of two, and none taken.
    fn with_times(last: Vec<u32>, times: usize) -> Self {
        Self {
            simd: Simd::best(),
            last,
            lines: vec![0; times],
            latest: vec![0; times >> SHIFT],
            words: vec![[0; 1 << SHIFT]; (times >> (2 * SHIFT)) + 1],
            sums: [2, 3, 4].map(|level| vec![0; (times >> (level * SHIFT)) + 1]),
            now: BEGINNING,
            distinct: 0,
        }
    }
}

/// A reference to a line that is not in the newest two words.
#[derive(Clone, Copy, Default)]
struct Far {
    at: u32,
    last: u32,
    /// As far as the newest two words tell.
    distance: u32,
}

/// With vector instructions come those that count bits.
struct References<'a> {
    stack: &'a mut LruStack,
    lines: &'a [u32],
    distances: &'a mut [u32],
}

impl Task for References<'_> {
    type Output = ();

    #[inline(always)]
    fn run<R: Registers>(self) {
        let Self { stack, lines, distances } = self;
        let mut done = 0;
        while done < lines.len() {
            if stack.now as usize == stack.lines.len() {
                stack.number_anew();
            }
            let end = lines.len().min(done + ((1 << SHIFT) - (stack.now & MASK)) as usize);
            stack.word(&lines[done..end], &mut distances[done..end]);
            done = end;
        }
    }
}

/// The sum of the counts after one of them.
#[inline(always)]
fn sum_after(counts: &[u8; 1 << SHIFT], place: u32) -> u32 {
    /// What is cut out of these is zero up to a place, and has all bits set after it.
    const MASKS: [u8; 2 << SHIFT] = {
        let mut masks = [0; 2 << SHIFT];
        let mut i = 1 << SHIFT;
        while i < masks.len() {
            masks[i] = u8::MAX;
            i += 1;
        }
        masks
    };
    let masks = &MASKS[(MASK - place) as usize..][..1 << SHIFT];
    counts.iter().zip(masks).map(|(count, mask)| u32::from(count & mask)).sum()
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

    /// In batches of several sizes.
    fn distances(stack: &mut LruStack, references: &[u32]) -> Vec<u32> {
        let mut distances = vec![0; references.len()];
        let (mut from, mut batch) = (0, 1);
        while from < references.len() {
            let end = references.len().min(from + batch);
            stack.references(&references[from..end], &mut distances[from..end]);
            (from, batch) = (end, batch * 7 % 1009);
        }
        distances
    }

    fn by_stack(lines: u32, references: &[u32]) -> Vec<u32> {
        distances(&mut LruStack::new(lines), references)
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
        // All of 300 000 lines, twice: the distance is always that of all others. Times reach the third level of sums.
        let lines = 300_000;
        let mut stack = LruStack::new(lines);
        let all: Vec<u32> = (0..lines).collect();
        assert!(distances(&mut stack, &all).iter().all(|&distance| distance == LruStack::FIRST));
        for _ in 0..5 {
            assert!(distances(&mut stack, &all).iter().all(|&distance| distance == lines - 1));
        }
        // And backwards: 0, 1, 2, ….
        let back: Vec<u32> = (0..lines).rev().collect();
        assert_eq!(distances(&mut stack, &back), all);
        assert_eq!(stack.distinct(), lines);
        assert_eq!(stack.lines.len(), 1 << 20, "at most six times for a line");
    }

    #[test]
    fn all_instructions_count_the_same() {
        let references: Vec<u32> =
            (0..20_000u32).map(|i| i.wrapping_mul(0x9E37_79B1) >> 20).map(|i| i * i / 9000).collect();
        let expected = by_list(&references);
        for simd in Simd::available() {
            let mut stack = LruStack { simd, ..LruStack::new(2000) };
            assert!(distances(&mut stack, &references) == expected, "{simd}");
        }
    }

    proptest! {
        #[test]
        fn agrees_with_a_list(references in prop::collection::vec(prop_oneof![0u32..8, 0u32..300], 0..9000)) {
            prop_assert_eq!(by_stack(300, &references), by_list(&references));
        }
    }
}
