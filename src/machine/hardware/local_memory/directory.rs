//! Which line is in which slot: tags and replacement, without data.

use std::collections::BTreeSet;

use super::Slots;
use crate::hardware::replacement::Replacement;

/// The tags of a local memory. Given the same references it decides the same hits and victims, with data or
/// without.
#[derive(Debug)]
pub struct Directory<R> {
    extent: Slots,
    seed: u64,
    /// By line of the image: its slot plus one, or 0 where it is absent. Fresh zeroed pages cost nothing until
    /// they are touched, so that a large image costs a node only the part it reads.
    slots: Vec<u32>,
    /// By slot: the line in it, if it is filled.
    lines: Vec<u32>,
    /// By set: how many of its slots are filled; these are its first ones.
    filled: Vec<u32>,
    /// Slots that are empty again, although they were filled.
    emptied: BTreeSet<u32>,
    replacement: R,
}

/// What became of a reference to a line.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Reference {
    Hit {
        slot: u32,
    },
    /// The line has its slot now; the line that was there, if any, is gone.
    Miss {
        slot: u32,
        evicted: Option<u32>,
    },
}

impl<R: Replacement> Directory<R> {
    /// An empty memory with these slots, for lines below `lines`; `seed` decides random replacement.
    pub fn new(extent: Slots, lines: u32, seed: u64) -> Self {
        Self {
            extent,
            seed,
            slots: vec![0; lines as usize],
            lines: vec![0; extent.count() as usize],
            filled: vec![0; extent.sets as usize],
            emptied: BTreeSet::new(),
            replacement: R::new(extent.sets, extent.ways, seed),
        }
    }

    /// References a line, and gives it a slot if it has none.
    ///
    /// # Panics
    /// `line` is not below the number of lines, or the policy's victim is not a slot of its set.
    #[inline(always)]
    pub fn reference(&mut self, line: u32) -> Reference {
        let Some(slot) = self.slot(line) else { return self.fill(line, line % self.extent.sets) };
        self.hit(slot);
        Reference::Hit { slot }
    }

    /// The slot of a line that is in the memory. What is read there is a reference: [`Self::hit`] is to follow.
    ///
    /// # Panics
    /// `line` is not below the number of lines.
    #[inline(always)]
    pub fn slot(&self, line: u32) -> Option<u32> {
        self.slots[line as usize].checked_sub(1)
    }

    /// References the line that is in this slot.
    #[inline(always)]
    pub fn hit(&mut self, slot: u32) {
        self.replacement.hit(slot);
    }

    /// Gives a line that is not in the memory a slot of this set, which is the line's own. Returns the line that is evicted for it.
    ///
    /// # Panics
    /// `line` is not below the number of lines, `set` is not below that of sets, or the policy's victim is not a slot
    /// of the set.
    #[inline(always)]
    pub fn place(&mut self, line: u32, set: u32) -> Option<u32> {
        match self.fill(line, set) {
            Reference::Miss { evicted, .. } => evicted,
            Reference::Hit { .. } => None,
        }
    }

    /// Drops a line, and whether it was there. Its slot is filled again before a line of its set is evicted.
    ///
    /// # Panics
    /// `line` is not below the number of lines.
    pub fn invalidate(&mut self, line: u32) -> bool {
        let Some(slot) = self.slot(line) else { return false };
        self.slots[line as usize] = 0;
        self.emptied.insert(slot);
        true
    }

    /// Whether this slot holds this line.
    pub fn holds(&self, slot: u32, line: u32) -> bool {
        self.slots[line as usize] == slot + 1
    }

    /// Empties the memory; it is as new.
    pub fn clear(&mut self) {
        *self = Self::new(self.extent, self.slots.len() as u32, self.seed);
    }

    #[inline(never)]
    fn fill(&mut self, line: u32, set: u32) -> Reference {
        let filled = &mut self.filled[set as usize];
        let (slot, evicted) = if *filled < self.extent.ways {
            *filled += 1;
            (set * self.extent.ways + *filled - 1, None)
        } else if let Some(slot) = self.take_emptied(set) {
            (slot, None)
        } else {
            let slot = self.replacement.victim(set);
            let first = set * self.extent.ways;
            assert!(
                (first..first + self.extent.ways).contains(&slot),
                "the replacement policy evicts from slot {slot}, expected one of set {set}, {first} to {}",
                first + self.extent.ways - 1
            );
            let evicted = self.lines[slot as usize];
            self.slots[evicted as usize] = 0;
            (slot, Some(evicted))
        };
        self.lines[slot as usize] = line;
        self.slots[line as usize] = slot + 1;
        self.replacement.fill(slot, line);
        Reference::Miss { slot, evicted }
    }
}

impl<R> Directory<R> {
    #[inline(always)]
    fn take_emptied(&mut self, set: u32) -> Option<u32> {
        if self.emptied.is_empty() {
            return None;
        }
        let first = set * self.extent.ways;
        let slot = self.emptied.range(first..first + self.extent.ways).next().copied()?;
        self.emptied.remove(&slot);
        Some(slot)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hardware::replacement::{Fifo, Lru};

    #[test]
    fn lines_go_to_the_slots_of_their_set() {
        // Three sets of two ways; lines 1, 4, 7 and 10 belong to set 1, whose slots are 2 and 3.
        let mut directory = Directory::<Fifo>::new(Slots { sets: 3, ways: 2 }, 12, 0);
        assert_eq!(directory.reference(1), Reference::Miss { slot: 2, evicted: None });
        assert_eq!(directory.reference(4), Reference::Miss { slot: 3, evicted: None });
        assert_eq!(directory.reference(1), Reference::Hit { slot: 2 });
        assert_eq!(directory.reference(7), Reference::Miss { slot: 2, evicted: Some(1) });
        assert_eq!(directory.reference(10), Reference::Miss { slot: 3, evicted: Some(4) });
        assert_eq!(directory.reference(11), Reference::Miss { slot: 4, evicted: None });
        assert!(directory.holds(2, 7) && !directory.holds(2, 1) && !directory.holds(3, 7));
    }

    #[test]
    fn an_invalidated_line_makes_room() {
        let mut directory = Directory::<Lru>::new(Slots { sets: 2, ways: 2 }, 12, 0);
        assert_eq!([0, 2, 1].map(|line| directory.place(line, line % 2)), [None; 3]);
        assert!(directory.invalidate(0) && !directory.invalidate(0) && !directory.invalidate(5));
        assert_eq!((directory.slot(0), directory.place(4, 0)), (None, None));
        // Line 2 is older than 4, though 4 has its predecessor's slot.
        assert_eq!((directory.place(6, 0), directory.slot(4)), (Some(2), Some(0)));
        assert_eq!(directory.reference(1), Reference::Hit { slot: 2 });
    }

    #[test]
    fn an_absent_line_is_not_brought_in_by_asking() {
        let mut directory = Directory::<Lru>::new(Slots { sets: 1, ways: 2 }, 4, 0);
        assert_eq!(directory.slot(3), None);
        assert_eq!(directory.reference(3), Reference::Miss { slot: 0, evicted: None });
        assert_eq!(directory.reference(0), Reference::Miss { slot: 1, evicted: None });
        assert_eq!(directory.slot(3), Some(0));
        directory.hit(0);
        assert_eq!(directory.reference(1), Reference::Miss { slot: 1, evicted: Some(0) });
    }

    #[test]
    #[should_panic(expected = "evicts from slot 2, expected one of set 0, 0 to 1")]
    fn a_victim_of_another_set_is_named() {
        struct Astray;
        impl Replacement for Astray {
            fn new(_sets: u32, _ways: u32, _seed: u64) -> Self {
                Self
            }
            fn hit(&mut self, _slot: u32) {}
            fn victim(&mut self, _set: u32) -> u32 {
                2
            }
            fn fill(&mut self, _slot: u32, _line: u32) {}
        }
        let mut directory = Directory::<Astray>::new(Slots { sets: 2, ways: 2 }, 8, 0);
        for line in [0, 2, 4] {
            directory.reference(line);
        }
    }

    #[test]
    fn cleared_it_is_as_new() {
        let mut directory = Directory::<Lru>::new(Slots { sets: 2, ways: 2 }, 8, 0);
        let run = |directory: &mut Directory<Lru>| [0, 2, 4, 1, 0].map(|line| directory.reference(line));
        let first = run(&mut directory);
        directory.clear();
        assert_eq!(run(&mut directory), first);
    }
}
