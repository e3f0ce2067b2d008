//! Any object, by a seeded generator.

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;

use super::store::Order;

/// All objects of the cache are equally likely, whatever their size. The same seed and the same requests give the same victims;
/// libCacheSim's are others at each run.
pub(super) struct Random {
    residents: Vec<u32>,
    generator: Pcg32,
}

impl Random {
    pub(super) fn new(_objects: u32, seed: u64) -> Self {
        Self { residents: Vec::new(), generator: Pcg32::seed_from_u64(seed) }
    }
}

impl Order for Random {
    fn hit(&mut self, _object: u32, _next_use: u32) {}

    fn evict(&mut self) -> Option<u32> {
        if self.residents.is_empty() {
            return None;
        }
        let place = (u64::from(self.generator.next_u32()) * self.residents.len() as u64) >> 32;
        Some(self.residents.swap_remove(place as usize))
    }

    fn insert(&mut self, object: u32, _next_use: u32) {
        self.residents.push(object);
    }
}
