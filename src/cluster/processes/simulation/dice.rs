//! Chance: from a seed, or from bytes that somebody else has chosen.

use std::collections::VecDeque;
use std::time::Duration;

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64;

#[derive(Clone, Debug)]
pub(super) enum Dice {
    Seeded(Pcg64),
    /// Zeros after the last one.
    Bytes(VecDeque<u8>),
}

impl Dice {
    pub(super) fn new(seed: u64) -> Self {
        Self::Seeded(Pcg64::seed_from_u64(seed))
    }

    /// Whether there are no bytes left.
    pub(super) fn is_spent(&self) -> bool {
        matches!(self, Self::Bytes(bytes) if bytes.is_empty())
    }

    /// 0 to `count` - 1; 0 where there is nothing to choose from.
    pub(super) fn below(&mut self, count: u64) -> u64 {
        let number = match self {
            Self::Seeded(generator) => generator.next_u64(),
            Self::Bytes(bytes) => {
                // As many as it takes.
                let taken = (count.max(2) - 1).ilog2() as usize / 8 + 1;
                (0..taken).fold(0, |number, _| number << 8 | u64::from(bytes.pop_front().unwrap_or_default()))
            }
        };
        number % count.max(1)
    }

    /// Both ends included.
    pub(super) fn between(&mut self, least: Duration, most: Duration) -> Duration {
        let nanoseconds = most.saturating_sub(least).as_nanos() as u64;
        least + Duration::from_nanos(self.below(nanoseconds + 1))
    }

    /// With a probability of so many in a hundred.
    pub(super) fn chance(&mut self, percent: u64) -> bool {
        self.below(100) < percent
    }

    pub(super) fn choose<'a, T>(&mut self, choices: &'a [T]) -> &'a T {
        &choices[self.below(choices.len() as u64) as usize]
    }
}

/// A number that only these two decide, as if by chance.
pub(super) fn hash(a: u64, b: u64) -> u64 {
    let mut x = a ^ b.wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(31);
    for _ in 0..2 {
        x = (x ^ (x >> 32)).wrapping_mul(0xd6e8_feb8_6659_fd93);
    }
    x ^ (x >> 32)
}
