//! Every kernel that traces rays, behind one face: what holds for one has to hold for all, bit by bit.

use std::fmt;

use serde::Serialize;

use crate::database::verify::Verified;
use crate::tracer::TraceStats;
use crate::tracer::bvh8::{Bvh8, PacketTracer};
use crate::tracer::hit::Hit;
use crate::tracer::octree::hero::Hero;
use crate::tracer::ray::Ray;
use crate::tracer::simd::Simd;
use crate::tracer::slices::Slices;

/// A way to trace rays.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Kernel {
    /// One ray at a time through the octree of the image.
    Hero,
    /// Batches of rays through the octree derived from it.
    Wide(Simd),
}

impl Kernel {
    /// Those that this processor can run; HERO, the reference, first.
    pub fn available() -> Vec<Self> {
        std::iter::once(Self::Hero).chain(Simd::available().map(Self::Wide)).collect()
    }
}

impl fmt::Display for Kernel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Hero => f.write_str("single"),
            Self::Wide(simd) => write!(f, "packets {simd}"),
        }
    }
}

impl Serialize for Kernel {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// A database with all that any kernel needs.
pub struct Subject<'a> {
    database: &'a Verified,
    wide: Bvh8,
}

impl<'a> Subject<'a> {
    pub fn new(database: &'a Verified) -> Self {
        Self { database, wide: Bvh8::build(database) }
    }

    /// Each kernel, ready to trace; HERO first.
    pub fn tracers(&self) -> Vec<KernelTracer<'_>> {
        Kernel::available().into_iter().map(|kernel| self.tracer(kernel)).collect()
    }

    pub fn tracer(&self, kernel: Kernel) -> KernelTracer<'_> {
        let tracer: Box<dyn Trace + '_> = match kernel {
            Kernel::Hero => Box::new(HeroTracer {
                hero: Hero::new(&self.database.database().header, true),
                port: Slices::new(self.database),
                stats: TraceStats::default(),
            }),
            Kernel::Wide(simd) => Box::new(PacketTracer::new(&self.wide, self.database, simd)),
        };
        KernelTracer { kernel, tracer }
    }
}

/// One kernel at work on one database.
pub struct KernelTracer<'a> {
    kernel: Kernel,
    tracer: Box<dyn Trace + 'a>,
}

impl KernelTracer<'_> {
    pub fn kernel(&self) -> Kernel {
        self.kernel
    }

    /// The nearest hit of each ray.
    pub fn nearest(&mut self, rays: &[Ray]) -> Vec<Option<Hit>> {
        self.tracer.nearest(rays)
    }

    /// Whether anything is hit before each ray's `t_max`.
    pub fn occluded(&mut self, rays: &[Ray]) -> Vec<bool> {
        self.tracer.occluded(rays)
    }
}

trait Trace {
    fn nearest(&mut self, rays: &[Ray]) -> Vec<Option<Hit>>;
    fn occluded(&mut self, rays: &[Ray]) -> Vec<bool>;
}

impl Trace for PacketTracer<'_> {
    fn nearest(&mut self, rays: &[Ray]) -> Vec<Option<Hit>> {
        self.nearest(rays)
    }

    fn occluded(&mut self, rays: &[Ray]) -> Vec<bool> {
        self.occluded(rays)
    }
}

/// What [`Hero`] needs to trace by itself.
struct HeroTracer<'a> {
    hero: Hero,
    port: Slices<'a>,
    stats: TraceStats,
}

impl Trace for HeroTracer<'_> {
    fn nearest(&mut self, rays: &[Ray]) -> Vec<Option<Hit>> {
        let nearest = |ray| {
            let Ok(hit) = self.hero.nearest(&mut self.port, ray, &mut self.stats);
            hit
        };
        rays.iter().map(nearest).collect()
    }

    fn occluded(&mut self, rays: &[Ray]) -> Vec<bool> {
        let occluded = |ray| {
            let Ok(hit) = self.hero.occluded(&mut self.port, ray, &mut self.stats);
            hit
        };
        rays.iter().map(occluded).collect()
    }
}
