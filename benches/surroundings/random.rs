//! What a seed decides.

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64;

pub(crate) struct Random(Pcg64);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        Self(Pcg64::seed_from_u64(seed))
    }

    /// Exclusive; at least 1.
    pub(crate) fn below(&mut self, limit: u32) -> u32 {
        ((u64::from(self.0.next_u32()) * u64::from(limit)) >> 32) as u32
    }

    /// Once in so many times.
    pub(crate) fn once_in(&mut self, times: u32) -> bool {
        self.below(times) == 0
    }

    pub(crate) fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.below(from.len() as u32) as usize]
    }

    /// Each order of magnitude is as likely as the others.
    pub(crate) fn between(&mut self, low: u64, high: u64) -> u64 {
        let share = f64::from(self.0.next_u32()) / f64::from(u32::MAX);
        (low as f64 * (high as f64 / low as f64).powf(share)) as u64
    }
}
