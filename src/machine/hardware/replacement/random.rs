//! Any line, by a seeded generator.

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;

use super::Replacement;

/// The victim is any line of the set, all equally likely to within `ways` in 2³². The same seed and the
/// same references give the same victims.
#[derive(Debug)]
pub struct Random {
    ways: u32,
    generator: Pcg32,
}

impl Replacement for Random {
    fn new(_sets: u32, ways: u32, seed: u64) -> Self {
        Self { ways, generator: Pcg32::seed_from_u64(seed) }
    }

    #[inline(always)]
    fn hit(&mut self, _slot: u32) {}

    fn victim(&mut self, set: u32) -> u32 {
        let way = (u64::from(self.generator.next_u32()) * u64::from(self.ways)) >> 32;
        set * self.ways + way as u32
    }

    fn fill(&mut self, _slot: u32, _line: u32) {}
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::tests::LINES;
    use super::*;
    use crate::hardware::local_memory::{Directory, Reference, Slots};

    proptest! {
        /// The model keeps the lines of a set in an array and draws its victims from the same generator.
        #[test]
        fn agrees_with_an_array_and_the_same_generator(
            references in prop::collection::vec(0u32..64, 0..600), sets in 1u32..6, ways in 1u32..9, seed: u64,
        ) {
            let mut directory = Directory::<Random>::new(Slots { sets, ways }, LINES, seed);
            let mut generator = Pcg32::seed_from_u64(seed);
            let mut resident = vec![Vec::new(); sets as usize];
            for line in references {
                let set: &mut Vec<u32> = &mut resident[(line % sets) as usize];
                let expected_miss = !set.contains(&line);
                let mut expected_victim = None;
                if expected_miss && set.len() == ways as usize {
                    let way = (f64::from(generator.next_u32()) / 4_294_967_296.0 * f64::from(ways)) as usize;
                    expected_victim = Some(std::mem::replace(&mut set[way], line));
                } else if expected_miss {
                    set.push(line);
                }
                match directory.reference(line) {
                    Reference::Hit { .. } => prop_assert!(!expected_miss),
                    Reference::Miss { evicted, .. } => {
                        prop_assert!(expected_miss);
                        prop_assert_eq!(evicted, expected_victim);
                    }
                }
            }
        }
    }

    #[test]
    fn every_way_is_chosen() {
        let mut random = Random::new(2, 5, 7);
        let mut chosen = [0u32; 10];
        (0..10_000).for_each(|_| chosen[random.victim(1) as usize] += 1);
        assert_eq!(chosen[..5], [0; 5], "the other set's slots");
        // 2000 are expected, with a standard deviation of 40.
        assert!(chosen[5..].iter().all(|&n| (1800..2200).contains(&n)), "{chosen:?}");
    }
}
