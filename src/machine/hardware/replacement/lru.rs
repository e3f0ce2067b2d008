//! Least recently used.

use super::Replacement;

/// The victim is the line that was not referenced for the longest time.
///
/// A reference only writes down when it was. The slots of a full set are put in the order of their times at the first
/// victim, and again when all have had their turn: whatever was referenced since is newer than all of these, and is
/// passed over. Each slot in that order is one reference at least, to it or that filled it, so that ordering
/// costs O(log ways) a reference, and much less where lines are referenced often.
#[derive(Debug)]
pub struct Lru {
    ways: u32,
    now: u64,
    /// By slot, when its line was referenced last.
    referenced: Vec<u64>,
    /// By set, its slots from the oldest to the newest as they were when they were ordered.
    order: Vec<u32>,
    sets: Vec<Turn>,
}

/// The place of a set in its order.
#[derive(Clone, Copy, Debug)]
struct Turn {
    /// The next way of the order to be looked at; the number of ways if none is left.
    next: u32,
    /// When the order was made.
    ordered: u64,
}

impl Replacement for Lru {
    fn new(sets: u32, ways: u32, _seed: u64) -> Self {
        let slots = sets * ways;
        Self {
            ways,
            now: 0,
            referenced: vec![0; slots as usize],
            order: (0..slots).collect(),
            sets: vec![Turn { next: ways, ordered: 0 }; sets as usize],
        }
    }

    #[inline(always)]
    fn hit(&mut self, slot: u32) {
        self.now += 1;
        self.referenced[slot as usize] = self.now;
    }

    fn victim(&mut self, set: u32) -> u32 {
        let first = set as usize * self.ways as usize;
        let order = &mut self.order[first..first + self.ways as usize];
        let turn = &mut self.sets[set as usize];
        loop {
            if turn.next == self.ways {
                order.sort_unstable_by_key(|&slot| self.referenced[slot as usize]);
                *turn = Turn { next: 0, ordered: self.now };
            }
            let slot = order[turn.next as usize];
            turn.next += 1;
            if self.referenced[slot as usize] <= turn.ordered {
                return slot;
            }
        }
    }

    fn fill(&mut self, slot: u32, _line: u32) {
        self.hit(slot);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::tests::{misses, model};
    use super::*;

    proptest! {
        #[test]
        fn agrees_with_a_list_in_order_of_use(
            references in prop::collection::vec(0u32..64, 0..600), sets in 1u32..6, ways in 1u32..9,
        ) {
            prop_assert_eq!(misses::<Lru>(sets, ways, &references), model(sets, ways, &references, true));
        }
    }
}
