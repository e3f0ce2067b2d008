//! Every kernel that traces rays, behind one face: what holds for one has to hold for all, bit by bit.

use std::fmt;

use serde::Serialize;

use crate::database::verify::Verified;
use crate::tracer::TraceStats;
use crate::tracer::hit::Hit;
use crate::tracer::octree::hero::Hero;
use crate::tracer::ray::Ray;
use crate::tracer::simd::Simd;
use crate::tracer::slices::Slices;
use crate::tracer::wide::{WideOctree, WideTracer};

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
            Self::Hero => f.write_str("hero"),
            Self::Wide(simd) => write!(f, "wide {simd}"),
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
    wide: WideOctree,
}

impl<'a> Subject<'a> {
    pub fn new(database: &'a Verified) -> Self {
        Self { database, wide: WideOctree::derive(database) }
    }

    /// Each kernel, ready to trace; HERO first.
    pub fn tracers(&self) -> Vec<KernelTracer<'_>> {
        Kernel::available().into_iter().map(|kernel| self.tracer(kernel)).collect()
    }

    pub fn tracer(&self, kernel: Kernel) -> KernelTracer<'_> {
        let tracer = match kernel {
            Kernel::Hero => Tracer::Hero {
                hero: Hero::new(&self.database.database().header, true),
                port: Slices::new(self.database),
                stats: TraceStats::default(),
            },
            Kernel::Wide(simd) => Tracer::Wide(WideTracer::new(&self.wide, self.database, simd)),
        };
        KernelTracer { kernel, tracer }
    }
}

/// One kernel at work on one database.
pub struct KernelTracer<'a> {
    kernel: Kernel,
    tracer: Tracer<'a>,
}

#[expect(clippy::large_enum_variant, reason = "there are as many of them as kernels")]
enum Tracer<'a> {
    Hero { hero: Hero, port: Slices<'a>, stats: TraceStats },
    Wide(WideTracer<'a>),
}

impl KernelTracer<'_> {
    pub fn kernel(&self) -> Kernel {
        self.kernel
    }

    /// The nearest hit of each ray.
    pub fn nearest(&mut self, rays: &[Ray]) -> Vec<Option<Hit>> {
        match &mut self.tracer {
            Tracer::Wide(wide) => wide.nearest(rays),
            Tracer::Hero { hero, port, stats } => {
                let nearest = |ray| {
                    let Ok(hit) = hero.nearest(port, ray, stats);
                    hit
                };
                rays.iter().map(nearest).collect()
            }
        }
    }

    /// Whether anything is hit before each ray's `t_max`.
    pub fn occluded(&mut self, rays: &[Ray]) -> Vec<bool> {
        match &mut self.tracer {
            Tracer::Wide(wide) => wide.occluded(rays),
            Tracer::Hero { hero, port, stats } => {
                let occluded = |ray| {
                    let Ok(hit) = hero.occluded(port, ray, stats);
                    hit
                };
                rays.iter().map(occluded).collect()
            }
        }
    }
}
