//! Static re-reference interval prediction with hit priority (Jaleel et al., *High Performance Cache Replacement Using
//! Re-Reference Interval Prediction (RRIP)*, ISCA 2010, section 4).

use super::Replacement;

/// A line's re-reference prediction value, of two bits, is 2 when it is filled and 0 when it is hit. The victim is the lowest way
/// whose value is 3; while there is none, all values of the set grow by one.
///
/// The ways of a set are in four bitmaps by value. All values grow at once when the bitmaps change their meanings: the one of
/// value 3 is empty then, and is that of value 0 next. Nothing is ever added to the bitmap of value 3, so that the search for its
/// lowest way goes on where the last one ended.
#[derive(Debug)]
pub struct Srrip {
    sets: u32,
    ways: u32,
    /// By slot, the bitmap that its way is in; [`EMPTY`] if none.
    bitmap: Vec<u8>,
    /// By set, the bitmap of value 0. The bitmap of value `v` is `v` places after it, modulo 4.
    zero: Vec<u8>,
    /// By set, the word of [`Self::summaries`] before which the bitmap of value 3 has no way.
    first: Vec<u32>,
    /// By set and bitmap, its ways, 64 a word.
    members: Bits,
    /// By set and bitmap, which of its words are not zero.
    summaries: Bits,
}

/// Words of bitmaps that are equally long.
#[derive(Debug)]
struct Bits {
    words: Vec<u64>,
    /// Of a bitmap.
    length: usize,
}

/// A bitmap for each value of two bits.
const VALUES: u8 = 4;
/// An empty slot is in no bitmap.
const EMPTY: u8 = VALUES;
const INSERTED: u8 = 2;
const EVICTED: u8 = VALUES - 1;

impl Replacement for Srrip {
    fn new(sets: u32, ways: u32, _seed: u64) -> Self {
        let bitmaps = sets as usize * usize::from(VALUES);
        let words = ways.div_ceil(u64::BITS);
        Self {
            sets,
            ways,
            bitmap: vec![EMPTY; (sets * ways) as usize],
            zero: vec![0; sets as usize],
            first: vec![0; sets as usize],
            members: Bits::new(bitmaps, words),
            summaries: Bits::new(bitmaps, words.div_ceil(u64::BITS)),
        }
    }

    #[inline(always)]
    fn hit(&mut self, slot: u32) {
        let set = self.set(slot);
        if self.bitmap[slot as usize] != self.zero[set as usize] {
            self.give(slot, set, 0);
        }
    }

    fn victim(&mut self, set: u32) -> u32 {
        for _ in 0..VALUES {
            if let Some(way) = self.lowest(set) {
                return set * self.ways + way;
            }
            let zero = &mut self.zero[set as usize];
            *zero = (*zero + VALUES - 1) % VALUES;
            self.first[set as usize] = 0;
        }
        // Not reached: all ways of a full set are in bitmaps.
        set * self.ways
    }

    fn fill(&mut self, slot: u32, _line: u32) {
        let set = self.set(slot);
        self.give(slot, set, INSERTED);
    }
}

impl Srrip {
    #[inline(always)]
    fn set(&self, slot: u32) -> u32 {
        if self.sets == 1 { 0 } else { slot / self.ways }
    }

    #[inline]
    fn of_value(&self, set: u32, value: u8) -> u8 {
        (self.zero[set as usize] + value) % VALUES
    }

    /// Gives the line in a slot of this set a value.
    fn give(&mut self, slot: u32, set: u32, value: u8) {
        let way = slot - set * self.ways;
        let to = self.of_value(set, value);
        let from = std::mem::replace(&mut self.bitmap[slot as usize], to);
        if from != EMPTY && self.members.clear(place(set, from), way) {
            self.summaries.clear(place(set, from), way / u64::BITS);
        }
        self.members.set(place(set, to), way);
        self.summaries.set(place(set, to), way / u64::BITS);
    }

    /// The lowest way of value 3.
    fn lowest(&mut self, set: u32) -> Option<u32> {
        let bitmap = place(set, self.of_value(set, EVICTED));
        let first = self.first[set as usize];
        let word = self.summaries.lowest(bitmap, first)?;
        self.first[set as usize] = word / u64::BITS;
        self.members.lowest(bitmap, word)
    }
}

fn place(set: u32, bitmap: u8) -> usize {
    set as usize * usize::from(VALUES) + usize::from(bitmap)
}

impl Bits {
    fn new(bitmaps: usize, words: u32) -> Self {
        Self { words: vec![0; bitmaps * words as usize], length: words as usize }
    }

    #[inline]
    fn word(&mut self, bitmap: usize, bit: u32) -> &mut u64 {
        &mut self.words[bitmap * self.length + (bit / u64::BITS) as usize]
    }

    #[inline]
    fn set(&mut self, bitmap: usize, bit: u32) {
        *self.word(bitmap, bit) |= 1 << (bit % u64::BITS);
    }

    /// Returns whether the word is zero now.
    #[inline]
    fn clear(&mut self, bitmap: usize, bit: u32) -> bool {
        let word = self.word(bitmap, bit);
        *word &= !(1 << (bit % u64::BITS));
        *word == 0
    }

    /// The lowest bit that is set in this word or after it.
    fn lowest(&self, bitmap: usize, first: u32) -> Option<u32> {
        let words = &self.words[bitmap * self.length..(bitmap + 1) * self.length];
        let (i, word) = (first..).zip(&words[first as usize..]).find(|(_, word)| **word != 0)?;
        Some(i * u64::BITS + word.trailing_zeros())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::tests::misses;
    use super::*;

    /// Sets as arrays of ways, with values that are counted one by one.
    fn arrays(sets: u32, ways: u32, references: &[u32]) -> Vec<bool> {
        let mut arrays = vec![Vec::<(u32, u8)>::new(); sets as usize];
        let miss = |&line: &u32| {
            let set = &mut arrays[(line % sets) as usize];
            if let Some(entry) = set.iter_mut().find(|(l, _)| *l == line) {
                entry.1 = 0;
                return false;
            }
            if set.len() < ways as usize {
                set.push((line, 2));
                return true;
            }
            loop {
                if let Some(victim) = set.iter_mut().find(|(_, value)| *value == 3) {
                    *victim = (line, 2);
                    return true;
                }
                set.iter_mut().for_each(|(_, value)| *value += 1);
            }
        };
        references.iter().map(miss).collect()
    }

    #[test]
    fn a_scan_does_not_evict_what_was_hit() {
        // The paper's mixed access pattern on four ways: a1, a2, a2, a1, a scan of b1 to b4, a1, a2. All are aged for b3,
        // which evicts b1; b4 evicts b2; a1 and a2 are hit, where LRU misses both.
        let references = [1, 2, 2, 1, 11, 12, 13, 14, 1, 2];
        let expected = [true, true, false, false, true, true, true, true, false, false];
        assert_eq!(misses::<Srrip>(1, 4, &references), expected);
    }

    proptest! {
        #[test]
        fn agrees_with_arrays(
            references in prop::collection::vec(0u32..64, 0..600), sets in 1u32..6, ways in 1u32..17,
        ) {
            prop_assert_eq!(misses::<Srrip>(sets, ways, &references), arrays(sets, ways, &references));
        }

        /// Several words a bitmap, and several words a summary.
        #[test]
        fn agrees_with_arrays_of_many_ways(
            steps in prop::collection::vec((0u32..5000, 1u32..2500), 1..12), ways in prop_oneof![60u32..200, 4000u32..4400],
        ) {
            let references: Vec<u32> = steps.iter().flat_map(|&(first, count)| first..first + count).collect();
            prop_assert_eq!(misses::<Srrip>(1, ways, &references), arrays(1, ways, &references));
        }
    }
}
