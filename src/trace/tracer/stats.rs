//! What the tracer counts of its own work.

use serde::{Deserialize, Serialize};

use super::memory_port::RayKind;
use crate::database::records::LEVELS;

/// Counts of one tile, or summed.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TraceStats {
    /// Rays cast, by [`RayKind`].
    pub rays: [u64; RayKind::COUNT],
    /// Octree nodes visited, by level.
    pub octree_accesses: [u64; LEVELS],
    /// Ray and primitive intersection tests.
    pub primitive_tests: u64,
    /// Tests of triangles within polygons that are objects: each polygon is one primitive test.
    pub polygon_triangles: u64,
    /// Tests that the mailbox saved.
    pub mailbox_skips: u64,
    /// Pixels whose radiance was not finite and was written as 0.
    pub non_finite_pixels: u64,
}

impl TraceStats {
    /// No sum wraps, whatever the counts.
    pub fn add(&mut self, other: &Self) {
        let sum = |a: &mut [u64], b: &[u64]| a.iter_mut().zip(b).for_each(|(a, b)| *a = a.saturating_add(*b));
        sum(&mut self.rays, &other.rays);
        sum(&mut self.octree_accesses, &other.octree_accesses);
        self.primitive_tests = self.primitive_tests.saturating_add(other.primitive_tests);
        self.polygon_triangles = self.polygon_triangles.saturating_add(other.polygon_triangles);
        self.mailbox_skips = self.mailbox_skips.saturating_add(other.mailbox_skips);
        self.non_finite_pixels = self.non_finite_pixels.saturating_add(other.non_finite_pixels);
    }

    pub fn all_rays(&self) -> u64 {
        self.rays.iter().fold(0, |sum, rays| sum.saturating_add(*rays))
    }
}
