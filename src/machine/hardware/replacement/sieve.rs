//! SIEVE (Zhang et al., *SIEVE is Simpler than LRU*, NSDI 2024).

use super::Replacement;
use super::queues::Queues;

/// A hand goes over the lines of a set from the oldest to the newest, and from there to the oldest again: a line that was hit
/// since the hand last passed is spared once, the first that was not is the victim. Unlike with clock, a line that is spared keeps
/// its place, and a new one is placed behind all others, where the hand comes to it last.
///
/// The hand passes a line at most once for each hit on it. The same victims as libCacheSim's Sieve.c.
#[derive(Debug)]
pub struct Sieve {
    ways: u32,
    /// By slot, whether its line was hit since the hand last passed.
    visited: Vec<bool>,
    /// By set, its slots in the order in which they were filled.
    queues: Queues,
    /// By set, the slot under the hand; `None`: the oldest one.
    hands: Vec<Option<u32>>,
}

impl Replacement for Sieve {
    fn new(sets: u32, ways: u32, _seed: u64) -> Self {
        let slots = sets * ways;
        Self {
            ways,
            visited: vec![false; slots as usize],
            queues: Queues::new(sets, slots),
            hands: vec![None; sets as usize],
        }
    }

    #[inline(always)]
    fn hit(&mut self, slot: u32) {
        self.visited[slot as usize] = true;
    }

    fn victim(&mut self, set: u32) -> u32 {
        let oldest = self.queues.oldest(set).unwrap_or(set * self.ways);
        let mut slot = self.hands[set as usize].unwrap_or(oldest);
        while std::mem::take(&mut self.visited[slot as usize]) {
            slot = self.queues.newer(slot).unwrap_or(oldest);
        }
        self.hands[set as usize] = self.queues.newer(slot);
        self.queues.remove(set, slot);
        slot
    }

    fn fill(&mut self, slot: u32, _line: u32) {
        self.visited[slot as usize] = false;
        self.queues.push(slot / self.ways, slot);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::tests::misses;
    use super::*;

    /// Sets as lists of lines, the oldest first, with the place of the hand.
    fn lists(sets: u32, ways: u32, references: &[u32]) -> Vec<bool> {
        let mut lists = vec![(Vec::<(u32, bool)>::new(), 0); sets as usize];
        let miss = |&line: &u32| {
            let (list, hand) = &mut lists[(line % sets) as usize];
            if let Some(entry) = list.iter_mut().find(|(l, _)| *l == line) {
                entry.1 = true;
                return false;
            }
            if list.len() == ways as usize {
                *hand %= list.len();
                while list[*hand].1 {
                    list[*hand].1 = false;
                    *hand = (*hand + 1) % list.len();
                }
                list.remove(*hand);
                // At the end of the list the hand begins anew: it does not wait for the line that is added there.
                *hand = if *hand == list.len() { 0 } else { *hand };
            }
            list.push((line, false));
            true
        };
        references.iter().map(miss).collect()
    }

    #[test]
    fn by_hand() {
        // Seven frames with 1 to 7, of which 1, 2 and 7 are hit. 8: the hand spares 1 and 2 and evicts 3. 1 and 4 are hit.
        // 9: the hand spares 4 and evicts 5. 2 is hit. 10: the hand evicts 6; 3, 5 and 6 are gone.
        let references = [1, 2, 3, 4, 5, 6, 7, 1, 2, 7, 8, 1, 4, 9, 2, 10, 7, 8, 9, 10, 1, 2, 4, 3];
        let missing: Vec<u32> = references
            .into_iter()
            .zip(misses::<Sieve>(1, 7, &references))
            .filter(|(_, miss)| *miss)
            .map(|(l, _)| l)
            .collect();
        assert_eq!(missing, [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 3]);
    }

    proptest! {
        #[test]
        fn agrees_with_lists(
            references in prop::collection::vec(0u32..64, 0..600), sets in 1u32..6, ways in 1u32..17,
        ) {
            prop_assert_eq!(misses::<Sieve>(sets, ways, &references), lists(sets, ways, &references));
        }
    }
}
