//! The clock algorithm, or second chance (Corbató 1968), in its two forms.

use super::Replacement;

/// A hand goes round the slots of a set: a line referenced since the hand last passed is spared once, the
/// first that was not is the victim. Filling a line counts as a reference if `REFERENCED`, as it does in Corbató's paging, where
/// the reference that faulted is repeated. Otherwise a line has to be hit to be spared.
///
/// One search passes at most `ways + 1` slots, and a slot is passed at most once for each reference to it.
#[derive(Debug)]
pub struct Clock<const REFERENCED: bool = true> {
    ways: u32,
    referenced: Vec<bool>,
    /// The way under the hand, by set.
    hands: Vec<u32>,
}

/// Clock with lines that begin unreferenced, as in libCacheSim (its Clock.c with `init-freq=0` and one bit, the defaults).
pub type Clock0 = Clock<false>;

impl<const REFERENCED: bool> Replacement for Clock<REFERENCED> {
    fn new(sets: u32, ways: u32, _seed: u64) -> Self {
        Self { ways, referenced: vec![false; sets as usize * ways as usize], hands: vec![0; sets as usize] }
    }

    #[inline(always)]
    fn hit(&mut self, slot: u32) {
        self.referenced[slot as usize] = true;
    }

    fn victim(&mut self, set: u32) -> u32 {
        let hand = &mut self.hands[set as usize];
        loop {
            let slot = set * self.ways + *hand;
            *hand = if *hand + 1 == self.ways { 0 } else { *hand + 1 };
            if !std::mem::take(&mut self.referenced[slot as usize]) {
                return slot;
            }
        }
    }

    fn fill(&mut self, slot: u32, _line: u32) {
        self.referenced[slot as usize] = REFERENCED;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::tests::misses;
    use super::*;

    /// The textbook's queue form: a referenced line at the front goes to the end and loses its mark.
    fn second_chance(sets: u32, ways: u32, references: &[u32], filled: bool) -> Vec<bool> {
        let mut queues = vec![Vec::<(u32, bool)>::new(); sets as usize];
        let miss = |&line: &u32| {
            let queue = &mut queues[(line % sets) as usize];
            if let Some(entry) = queue.iter_mut().find(|(l, _)| *l == line) {
                entry.1 = true;
                return false;
            }
            while queue.len() == ways as usize {
                let (first, referenced) = queue.remove(0);
                if referenced {
                    queue.push((first, false));
                }
            }
            queue.push((line, filled));
            true
        };
        references.iter().map(miss).collect()
    }

    #[test]
    fn a_referenced_line_is_spared_once() {
        // Three frames. 4 clears all marks and replaces 1; 2 is marked again, so 5 spares it and replaces 3.
        let references = [1, 2, 3, 4, 2, 5, 2, 3];
        let expected = [true, true, true, true, false, true, false, true];
        assert_eq!(misses::<Clock>(1, 3, &references), expected);
    }

    #[test]
    fn a_line_that_is_not_hit_is_not_spared_where_lines_begin_unreferenced() {
        // Three frames. 1 is hit, so that 4 spares it and replaces 2; 5 replaces 3, and the hand is at 1, whose mark is gone.
        let references = [1, 2, 3, 1, 4, 5, 6, 4];
        let expected = [true, true, true, false, true, true, true, false];
        assert_eq!(misses::<Clock0>(1, 3, &references), expected);
    }

    proptest! {
        #[test]
        fn agrees_with_second_chance(
            references in prop::collection::vec(0u32..64, 0..600), sets in 1u32..6, ways in 1u32..9,
        ) {
            let expected = |filled| second_chance(sets, ways, &references, filled);
            prop_assert_eq!(misses::<Clock>(sets, ways, &references), expected(true));
            prop_assert_eq!(misses::<Clock0>(sets, ways, &references), expected(false));
        }
    }
}
