//! First in, first out.

use super::Replacement;

/// The victim is the line that was filled first. Hits change nothing, so it suffices to go round the slots.
#[derive(Debug)]
pub struct Fifo {
    ways: u32,
    /// The way filled first, by set.
    oldest: Vec<u32>,
}

impl Replacement for Fifo {
    fn new(sets: u32, ways: u32, _seed: u64) -> Self {
        Self { ways, oldest: vec![0; sets as usize] }
    }

    #[inline(always)]
    fn hit(&mut self, _slot: u32) {}

    fn victim(&mut self, set: u32) -> u32 {
        let oldest = &mut self.oldest[set as usize];
        let way = *oldest;
        *oldest = if way + 1 == self.ways { 0 } else { way + 1 };
        set * self.ways + way
    }

    fn fill(&mut self, _slot: u32, _line: u32) {}
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::tests::{misses, model};
    use super::*;

    proptest! {
        #[test]
        fn agrees_with_a_list_in_order_of_fill(
            references in prop::collection::vec(0u32..64, 0..600), sets in 1u32..6, ways in 1u32..9,
        ) {
            prop_assert_eq!(misses::<Fifo>(sets, ways, &references), model(sets, ways, &references, false));
        }
    }
}
