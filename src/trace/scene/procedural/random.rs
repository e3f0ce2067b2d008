//! Numbers for scenes that are strewn: the same for a seed, everywhere.

use std::f64::consts::TAU;

use glam::DVec3;
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;

pub(super) struct Random(Pcg32);

impl Random {
    pub(super) fn new(seed: u64) -> Self {
        Self(Pcg32::seed_from_u64(seed))
    }

    /// From 0, below 1.
    pub(super) fn unit(&mut self) -> f64 {
        f64::from(self.0.next_u32()) / 2f64.powi(32)
    }

    pub(super) fn between(&mut self, from: f64, to: f64) -> f64 {
        from + (to - from) * self.unit()
    }

    /// Below `count`.
    pub(super) fn index(&mut self, count: usize) -> usize {
        ((u64::from(self.0.next_u32()) * count as u64) >> 32) as usize
    }

    /// A unit vector, evenly spread over the sphere.
    pub(super) fn direction(&mut self) -> DVec3 {
        let (z, angle) = (self.between(-1.0, 1.0), self.between(0.0, TAU));
        let aside = (1.0 - z * z).max(0.0).sqrt();
        DVec3::new(aside * libm::cos(angle), aside * libm::sin(angle), z)
    }
}
