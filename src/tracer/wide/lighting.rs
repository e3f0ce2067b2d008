//! Light on a wave's surfaces, one light after the other: shadow rays, then what comes through, side by side.

use glam::{DVec3, Vec3};

use super::surfaces::{DOUBLES, Surfaces};
use crate::tracer::power::power;
use crate::tracer::ray::{Ray, moved_off};
use crate::tracer::simd::Registers;
use crate::tracer::simd::lanes::{Doubles, Lanes};
use crate::tracer::vector::{add, div, dot, length, load, mul, scale, select, splat, store, sub};

/// One light's rays, and what they would bring.
#[derive(Debug, Default)]
pub(super) struct Lighting {
    pub shadow_rays: Vec<Ray>,
    /// By shadow ray.
    pub occluded: Vec<bool>,
    /// The surface of each shadow ray.
    surface: Vec<u32>,
    /// By surface: the cosines of the direction to the light with the normal and with the mirrored ray.
    cosine: Vec<f32>,
    mirrored_cosine: Vec<f32>,
    /// Whether the light shines on it.
    lit: Vec<bool>,
}

/// What leaves a chunk of surfaces, side by side.
#[derive(Default)]
struct Leaving {
    origin: [[f32; DOUBLES]; 3],
    direction: [[f32; DOUBLES]; 3],
    distance: [f32; DOUBLES],
}

impl Leaving {
    #[inline(always)]
    fn ray(&self, lane: usize, t_max: f32, source: crate::tracer::ray::Source) -> Ray {
        Ray {
            origin: [self.origin[0][lane], self.origin[1][lane], self.origin[2][lane]],
            direction: [self.direction[0][lane], self.direction[1][lane], self.direction[2][lane]],
            t_max,
            source,
        }
    }
}

impl Lighting {
    /// Casts a ray to the light from every surface that is turned to it.
    #[inline(always)]
    pub(super) fn cast<R: Registers>(&mut self, surfaces: &Surfaces, light: DVec3) {
        self.shadow_rays.clear();
        self.surface.clear();
        let padded = surfaces.count.next_multiple_of(DOUBLES);
        self.cosine.resize(padded, 0.0);
        self.mirrored_cosine.resize(padded, 0.0);
        self.lit.clear();
        self.lit.resize(padded, false);
        let mut leaving = Leaving::default();
        for first in (0..surfaces.count).step_by(DOUBLES) {
            let position = load::<R::D8, _>(&surfaces.position, first);
            let to_light = sub(splat(light.to_array()), position);
            let distance = length(to_light);
            let direction = div(to_light, distance);
            let cosine = dot(load::<R::D8, _>(&surfaces.normal, first), direction);
            let lanes = (1u32 << DOUBLES.min(surfaces.count - first)) - 1;
            let mut turned_to = R::D8::splat(0.0).lt(cosine) & lanes;
            if turned_to == 0 {
                continue;
            }
            cosine.narrow(&mut self.cosine[first..]);
            dot(load::<R::D8, _>(&surfaces.mirrored, first), direction).narrow(&mut self.mirrored_cosine[first..]);
            let origin = moved_off(position, load::<R::D8, _>(&surfaces.outward, first), direction);
            for axis in 0..3 {
                origin[axis].narrow(&mut leaving.origin[axis]);
                direction[axis].narrow(&mut leaving.direction[axis]);
            }
            distance.narrow(&mut leaving.distance);
            while turned_to != 0 {
                let lane = turned_to.trailing_zeros() as usize & (DOUBLES - 1);
                turned_to &= turned_to - 1;
                self.shadow_rays.push(leaving.ray(lane, leaving.distance[lane], surfaces.source[first + lane]));
                self.surface.push((first + lane) as u32);
            }
        }
        self.occluded.clear();
        self.occluded.resize(self.shadow_rays.len(), true);
    }

    /// Adds what comes from a light of this colour through the shadow rays that are not occluded.
    #[inline(always)]
    pub(super) fn add<R: Registers>(&mut self, surfaces: &mut Surfaces, colour: Vec3) {
        for (&surface, &occluded) in self.surface.iter().zip(&self.occluded) {
            self.lit[surface as usize] = !occluded;
        }
        let colour = splat::<R::F8>(colour.to_array());
        for first in (0..surfaces.count).step_by(DOUBLES) {
            let lit = bits(&self.lit[first..first + DOUBLES]);
            if lit == 0 {
                continue;
            }
            let diffuse = load::<R::F8, _>(&surfaces.diffuse, first);
            let diffuse = scale(diffuse, R::F8::load(&self.cosine[first..]));
            let strength = load::<R::F8, _>(&surfaces.highlight, first);
            let nothing = R::F8::splat(0.0);
            let shining = nothing.lt(strength[0].abs().max(strength[1].abs()).max(strength[2].abs()))
                & nothing.lt(R::F8::load(&self.mirrored_cosine[first..]));
            let mut highlight = [nothing; 3];
            if shining & lit != 0 {
                let base = R::D8::widen(&self.mirrored_cosine[first..]);
                let mut powers = [0.0; DOUBLES];
                power(base, R::D8::widen(&surfaces.shine[first..])).narrow(&mut powers);
                highlight = select(shining, scale(strength, R::F8::load(&powers)), highlight);
            }
            let radiance = load::<R::F8, _>(&surfaces.radiance, first);
            let brighter = add(radiance, mul(colour, add(diffuse, highlight)));
            store(select(lit, brighter, radiance), &mut surfaces.radiance, first);
        }
    }
}

#[inline(always)]
fn bits(flags: &[bool]) -> u32 {
    flags.iter().enumerate().fold(0, |bits, (lane, &flag)| bits | u32::from(flag) << lane)
}
