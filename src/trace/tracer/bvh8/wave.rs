//! Rays of one generation, and what they add to.

use glam::Vec3;

use super::Queues;
use crate::tracer::optics::Share;
use crate::tracer::ray::Ray;

/// Rays of one generation.
#[derive(Debug, Default)]
pub(super) struct Wave {
    pub rays: Vec<Ray>,
    /// By ray.
    pub origins: Vec<Origin>,
    pub radiance: Vec<Vec3>,
    pub queues: Queues,
}

/// What a ray adds to.
#[derive(Clone, Copy, Debug)]
pub(super) struct Origin {
    /// Of the first wave a pixel of the tile, else a ray of the wave before.
    pub parent: u32,
    pub share: Share,
    /// Reflections and refractions so far, and sheets that were passed.
    pub bounces: u32,
    pub sheets: u32,
}

impl Wave {
    pub(super) fn clear(&mut self) {
        self.rays.clear();
        self.origins.clear();
        self.queues.clear();
    }

    /// Makes room, so that [`Self::push`] need not.
    pub(super) fn reserve(&mut self, rays: usize) {
        self.rays.reserve(rays);
        self.origins.reserve(rays);
    }

    #[inline(always)]
    pub(super) fn push(&mut self, ray: Ray, origin: Origin) {
        self.queues.push(&ray, self.rays.len() as u32);
        self.rays.push(ray);
        self.origins.push(origin);
    }
}
