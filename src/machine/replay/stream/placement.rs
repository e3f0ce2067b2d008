//! Where lines are placed in a memory: its sets, as far as any line lies in them.

use crate::hardware::local_memory::{Geometry, GeometryError, Slots};

/// The slots of a simulated memory, and the set of each line among them.
///
/// A memory may be larger than all that is referenced, and its sets more than the lines. What no line can fill is left out, which
/// changes no hit and no victim.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Placement {
    slots: Slots,
    sets: Sets,
}

#[derive(Clone, PartialEq, Eq, Debug)]
enum Sets {
    /// There is one.
    One,
    /// The line's own set of so many.
    Own(u64),
    /// By line.
    Numbered(Vec<u32>),
}

impl Placement {
    /// For lines that are numbered without gaps, line `n` in set `n mod sets`.
    pub fn without_gaps(geometry: &Geometry) -> Self {
        let slots = geometry.slots();
        let sets = if slots.sets == 1 { Sets::One } else { Sets::Own(slots.sets.into()) };
        Self { slots, sets }
    }

    /// For lines of any numbers.
    ///
    /// # Errors
    /// More slots than can be simulated.
    ///
    /// `set` is that of a line among so many sets.
    pub(super) fn of_any(geometry: &Geometry, set: impl Fn(u32, u64) -> u64) -> Result<Self, GeometryError> {
        if geometry.sets == 1 {
            return Ok(Self::without_gaps(geometry));
        }
        let count = geometry.database_lines;
        let sets: Vec<u64> = (0..count).map(|line| set(line, geometry.sets)).collect();
        let mut numbers = sets.clone();
        numbers.sort_unstable();
        let fullest = numbers.chunk_by(|a, b| a == b).map(<[u64]>::len).max().unwrap_or(1) as u64;
        if fullest <= geometry.ways {
            // Nothing is ever evicted: one set does as well.
            return Ok(Self { slots: Slots { sets: 1, ways: count }, sets: Sets::One });
        }
        numbers.dedup();
        let is_sparse = geometry.sets > u64::from(count);
        let used = if is_sparse { numbers.len() as u64 } else { geometry.sets };
        if used.saturating_mul(geometry.ways) > Slots::COUNT_MAX {
            return Err(GeometryError::TooManySlots { sets: used, ways: geometry.ways });
        }
        let number = |set: &u64| numbers.partition_point(|number| number < set) as u32;
        Ok(Self {
            slots: Slots { sets: used as u32, ways: geometry.ways as u32 },
            sets: if is_sparse { Sets::Numbered(sets.iter().map(number).collect()) } else { Sets::Own(geometry.sets) },
        })
    }

    pub fn slots(&self) -> Slots {
        self.slots
    }

    /// The set of a line among those of [`Self::slots`]; `own` is its set among so many.
    #[inline(always)]
    pub fn set(&self, line: u32, own: impl Fn(u64) -> u64) -> u32 {
        match &self.sets {
            Sets::One => 0,
            Sets::Own(sets) => own(*sets) as u32,
            Sets::Numbered(sets) => sets[line as usize],
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::hardware::local_memory::{Directory, Reference};
    use crate::hardware::replacement::{Clock, Fifo, Lru, Replacement};

    /// Line `i` has the number `self.0[i]`.
    struct Numbered(Vec<u64>);

    impl Numbered {
        fn count(&self) -> u32 {
            self.0.len() as u32
        }

        fn set(&self, line: u32, sets: u64) -> u64 {
            self.0[line as usize] % sets
        }

        fn placement(&self, sets: u64, ways: u64) -> Result<Placement, GeometryError> {
            Placement::of_any(&geometry(self, sets, ways), |line, sets| self.set(line, sets))
        }
    }

    fn geometry(lines: &Numbered, sets: u64, ways: u64) -> Geometry {
        Geometry { line_bytes: 64, database_lines: lines.count(), sets, ways }
    }

    #[test]
    fn what_never_overflows_is_one_set() {
        // Dinero, 64 KiB direct-mapped in lines of 64 bytes: 0 and 0x400 are lines 0 and 16 of 1,024 sets.
        let lines = Numbered(vec![0, 16]);
        let placement = lines.placement(1024, 1).expect("few");
        assert_eq!(placement.slots(), Slots { sets: 1, ways: 2 });
        // In sixteen sets they meet in set 0.
        let placement = lines.placement(16, 1).expect("few");
        assert_eq!(placement.slots(), Slots { sets: 1, ways: 1 });
        assert_eq!([0, 1].map(|line| placement.set(line, |sets| lines.set(line, sets))), [0, 0]);
    }

    #[test]
    fn absurd_memories_are_refused_or_cost_nothing() {
        let lines = Numbered((0..1000).map(|i| i << 40).collect());
        let placement = lines.placement(1 << 20, 1 << 16).expect("all fits");
        assert_eq!(placement.slots().count(), 1000);
        let many = Numbered((0..1 << 17).map(|i| if i < 1 << 16 { i } else { i << 40 }).collect());
        let refused = many.placement(1 << 36, (1 << 16) - 1).expect_err("too many");
        assert_eq!(
            refused.to_string(),
            "65536 sets of 65535 ways that are referenced: expected at most 536870912 lines in all"
        );
    }

    /// The misses of a memory that has all of its sets.
    fn with_all_sets<R: Replacement>(lines: &Numbered, sets: u32, ways: u32, references: &[u32]) -> Vec<bool> {
        let mut directory = Directory::<R>::new(Slots { sets, ways }, lines.count(), 3);
        let missed = |&line: &u32| match directory.slot(line) {
            Some(slot) => {
                directory.hit(slot);
                false
            }
            None => {
                directory.place(line, lines.set(line, sets.into()) as u32);
                true
            }
        };
        references.iter().map(missed).collect()
    }

    fn placed<R: Replacement>(lines: &Numbered, sets: u32, ways: u32, references: &[u32]) -> Vec<bool> {
        let placement = lines.placement(sets.into(), ways.into()).expect("few");
        let mut directory = Directory::<R>::new(placement.slots(), lines.count(), 3);
        let missed = |&line: &u32| match directory.slot(line) {
            Some(slot) => {
                directory.hit(slot);
                false
            }
            None => {
                directory.place(line, placement.set(line, |sets| lines.set(line, sets)));
                true
            }
        };
        references.iter().map(missed).collect()
    }

    proptest! {
        #[test]
        fn leaving_sets_out_changes_no_hit(
            numbers in prop::collection::btree_set(0u64..5000, 1..40), sets in 1u32..900, ways in 1u32..5,
            references in prop::collection::vec(0u32..1000, 0..400),
        ) {
            let lines = Numbered(numbers.into_iter().collect());
            let references: Vec<u32> = references.into_iter().map(|line| line % lines.count()).collect();
            prop_assert_eq!(placed::<Lru>(&lines, sets, ways, &references), with_all_sets::<Lru>(&lines, sets, ways, &references));
            prop_assert_eq!(placed::<Fifo>(&lines, sets, ways, &references), with_all_sets::<Fifo>(&lines, sets, ways, &references));
            prop_assert_eq!(placed::<Clock>(&lines, sets, ways, &references), with_all_sets::<Clock>(&lines, sets, ways, &references));
        }

        #[test]
        fn a_database_without_gaps_loses_no_hit(
            count in 1u64..60, sets in 1u32..90, ways in 1u32..9, references in prop::collection::vec(0u32..1000, 0..400),
        ) {
            let lines = Numbered((0..count).collect());
            let references: Vec<u32> = references.into_iter().map(|line| line % lines.count()).collect();
            let slots = geometry(&lines, sets.into(), ways.into()).slots();
            let mut directory = Directory::<Lru>::new(slots, lines.count(), 0);
            let missed = |&line: &u32| matches!(directory.reference(line), Reference::Miss { .. });
            let counted: Vec<bool> = references.iter().map(missed).collect();
            prop_assert_eq!(counted, with_all_sets::<Lru>(&lines, sets, ways, &references));
        }
    }
}
