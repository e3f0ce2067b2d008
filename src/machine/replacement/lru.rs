//! Least recently used.

use super::Replacement;

/// No slot.
const NONE: u32 = u32::MAX;

/// The victim is the line that was not referenced for the longest time: a list of slots a set, from the
/// newest to the oldest, linked within one array.
#[derive(Debug)]
pub struct Lru {
    ways: u32,
    links: Vec<Link>,
    sets: Vec<Ends>,
}

/// The neighbours of a slot in its set's list.
#[derive(Clone, Copy, Debug)]
struct Link {
    newer: u32,
    older: u32,
}

#[derive(Clone, Copy, Debug)]
struct Ends {
    newest: u32,
    oldest: u32,
}

impl Replacement for Lru {
    fn new(sets: u32, ways: u32, _seed: u64) -> Self {
        Self {
            ways,
            links: vec![Link { newer: NONE, older: NONE }; sets as usize * ways as usize],
            sets: vec![Ends { newest: NONE, oldest: NONE }; sets as usize],
        }
    }

    #[inline(always)]
    fn hit(&mut self, slot: u32) {
        // A ray reads neighbouring records: most hits are of the newest line, and change nothing.
        if self.links[slot as usize].newer != NONE {
            let set = slot / self.ways;
            self.unlink(slot, set);
            self.push(slot, set);
        }
    }

    fn victim(&mut self, set: u32) -> u32 {
        let oldest = self.sets[set as usize].oldest;
        self.unlink(oldest, set);
        oldest
    }

    fn fill(&mut self, slot: u32) {
        self.push(slot, slot / self.ways);
    }
}

impl Lru {
    fn unlink(&mut self, slot: u32, set: u32) {
        let Link { newer, older } = self.links[slot as usize];
        let ends = &mut self.sets[set as usize];
        match newer {
            NONE => ends.newest = older,
            newer => self.links[newer as usize].older = older,
        }
        match older {
            NONE => ends.oldest = newer,
            older => self.links[older as usize].newer = newer,
        }
    }

    /// Makes an unlinked slot the newest of its set.
    fn push(&mut self, slot: u32, set: u32) {
        let ends = &mut self.sets[set as usize];
        let older = std::mem::replace(&mut ends.newest, slot);
        match older {
            NONE => ends.oldest = slot,
            older => self.links[older as usize].newer = slot,
        }
        self.links[slot as usize] = Link { newer: NONE, older };
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
