//! What surfaces reflect and refract: the next wave.

use super::surfaces::{DOUBLES, Surfaces, row};
use super::wave::{Origin, Wave};
use crate::tracer::TraceStats;
use crate::tracer::memory_port::RayKind;
use crate::tracer::optics::{refract, scatter};
use crate::tracer::ray::{Ray, Source, moved_off};
use crate::tracer::shade::{Onward, is_sheet};
use crate::tracer::simd::lanes::Doubles;
use crate::tracer::simd::{Registers, Task};
use crate::tracer::slices::Slices;
use crate::tracer::vector::{load, normalise};

/// Makes the next wave: what surfaces reflect and refract.
pub(super) struct Branching<'t, 'a> {
    pub surfaces: &'t Surfaces,
    pub wave: &'t Wave,
    pub slices: &'t Slices<'a>,
    pub cutoff: f32,
    pub depth: u32,
    pub next: &'t mut Wave,
    pub stats: &'t mut TraceStats,
}

impl Task for Branching<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<R: Registers>(mut self) {
        let (surfaces, slices) = (self.surfaces, self.slices);
        let mut reflected = Reflected::default();
        self.next.reserve(2 * surfaces.count);
        for first in (0..surfaces.count).step_by(DOUBLES) {
            let lanes = first..surfaces.count.min(first + DOUBLES);
            if lanes.clone().any(|at| surfaces.material(slices, at).is_branching()) {
                reflected.compute::<R::D8>(surfaces, first);
                for at in lanes {
                    self.branch(at, &reflected);
                }
            }
        }
    }
}

/// Origins and directions of reflected rays, side by side.
#[derive(Default)]
struct Reflected {
    origin: [[f32; DOUBLES]; 3],
    direction: [[f32; DOUBLES]; 3],
}

impl Reflected {
    #[inline(always)]
    fn compute<L: Doubles>(&mut self, surfaces: &Surfaces, first: usize) {
        let direction = normalise(load::<L, _>(&surfaces.mirrored, first));
        let origin = moved_off(load(&surfaces.position, first), load(&surfaces.outward, first), direction);
        for axis in 0..3 {
            origin[axis].narrow(&mut self.origin[axis]);
            direction[axis].narrow(&mut self.direction[axis]);
        }
    }

    #[inline(always)]
    fn ray(&self, lane: usize, source: Source) -> Ray {
        Ray {
            origin: [self.origin[0][lane], self.origin[1][lane], self.origin[2][lane]],
            direction: [self.direction[0][lane], self.direction[1][lane], self.direction[2][lane]],
            t_max: f32::INFINITY,
            source,
        }
    }
}

impl Branching<'_, '_> {
    /// Adds to the next wave what a surface reflects and refracts.
    #[inline(always)]
    fn branch(&mut self, at: usize, reflected: &Reflected) {
        let Self { surfaces, wave, .. } = *self;
        let material = surfaces.material(self.slices, at);
        let parent = surfaces.ray[at];
        let Origin { bounces, sheets, .. } = wave.origins[parent as usize];
        let is_sheet = material.has_light_terms()
            && is_sheet(material, &self.slices.materials[surfaces.material[at] as usize + 1].into());
        let onward = Onward::new(bounces, sheets, is_sheet, self.depth);
        let refracted = || {
            let incoming = wave.rays[parent as usize].direction_f64();
            if is_sheet {
                return Some(incoming);
            }
            refract(material, row(&surfaces.outward, at), row(&surfaces.normal, at), incoming)
        };
        let weight = wave.origins[parent as usize].share.weight;
        let (reflection, refraction) = scatter(material, weight, self.cutoff, refracted);
        if let (Some(share), Some((bounces, sheets))) = (reflection, onward.reflected) {
            self.stats.rays[RayKind::Reflection as usize] += 1;
            self.next.push(reflected.ray(at % DOUBLES, surfaces.source[at]), Origin { parent, share, bounces, sheets });
        }
        if let (Some((share, direction)), Some((bounces, sheets))) = (refraction, onward.refracted) {
            self.stats.rays[RayKind::Refraction as usize] += 1;
            let ray = surfaces.point(at).leaving(direction.normalize(), f32::INFINITY);
            self.next.push(ray, Origin { parent, share, bounces, sheets });
        }
    }
}
