//! Light on a wave's surfaces, sixteen at a time: for each light a packet of shadow rays, and what comes through.

use glam::{DVec3, Vec3};

use super::Bvh8;
use super::packet::{LANES, Packet};
use super::surfaces::{DOUBLES, Surfaces};
use super::walk::{Scratch, walk};
use crate::tracer::optics::towards;
use crate::tracer::power::power;
use crate::tracer::ray::moved_off;
use crate::tracer::simd::Registers;
use crate::tracer::simd::lanes::{Doubles, Lanes};
use crate::tracer::slices::Slices;
use crate::tracer::vector::{add, dot, load, mul, scale, select, splat, store};

/// What a packet of shadow rays would bring if nothing were in their way.
#[derive(Default)]
struct Cosines {
    /// Of the direction to the light with the normal.
    normal: [f32; LANES],
    /// And with the mirrored ray.
    mirrored: [f32; LANES],
}

/// Casts rays to every light from each surface that is turned to it, and adds what comes through. How many rays.
#[inline(always)]
pub(super) fn light<R: Registers>(
    surfaces: &mut Surfaces,
    lights: &[(DVec3, Vec3)],
    bvh: &Bvh8,
    slices: &Slices<'_>,
    packet: &mut Packet,
    scratch: &mut Scratch,
) -> u64 {
    let mut cosines = Cosines::default();
    let mut rays = 0;
    for first in (0..surfaces.count).step_by(LANES) {
        for lane in 0..LANES {
            packet.leave(lane, surfaces.source[first + lane]);
        }
        for &(position, colour) in lights {
            let lanes = (1u32 << LANES.min(surfaces.count - first)) - 1;
            let turned_to = aim::<R>(surfaces, first, position, packet, &mut cosines) & lanes;
            rays += u64::from(turned_to.count_ones());
            let mut lit = 0;
            let mut left = turned_to;
            while left != 0 {
                let active = packet.start::<R>(left);
                walk::<R, true>(bvh, slices, packet, scratch);
                lit |= packet.active;
                left &= !active;
            }
            brighten::<R>(surfaces, first, colour, &cosines, lit);
        }
    }
    rays
}

/// Makes rays to the light; a bit for each that leaves to the side that the normal is on.
#[inline(always)]
fn aim<R: Registers>(
    surfaces: &Surfaces,
    first: usize,
    light: DVec3,
    packet: &mut Packet,
    cosines: &mut Cosines,
) -> u32 {
    let mut turned_to = 0;
    for half in [0, DOUBLES] {
        let position = load::<R::D8, _>(&surfaces.position, first + half);
        let (direction, distance) = towards(light.to_array(), position);
        let cosine = dot(load::<R::D8, _>(&surfaces.normal, first + half), direction);
        turned_to |= R::D8::splat(0.0).lt(cosine) << half;
        cosine.narrow(&mut cosines.normal[half..]);
        dot(load::<R::D8, _>(&surfaces.mirrored, first + half), direction).narrow(&mut cosines.mirrored[half..]);
        let origin = moved_off(position, load::<R::D8, _>(&surfaces.outward, first + half), direction);
        for axis in 0..3 {
            origin[axis].narrow(&mut packet.origin[axis][half..]);
            direction[axis].narrow(&mut packet.direction[axis][half..]);
        }
        distance.narrow(&mut packet.t_max[half..]);
    }
    turned_to
}

/// Adds what a light of this colour brings to the surfaces of the `lit` lanes.
#[inline(always)]
fn brighten<R: Registers>(surfaces: &mut Surfaces, first: usize, colour: Vec3, cosines: &Cosines, lit: u32) {
    let colour = splat::<R::F8>(colour.to_array());
    let nothing = R::F8::splat(0.0);
    for half in [0, DOUBLES] {
        let lit = lit >> half & 0xff;
        if lit == 0 {
            continue;
        }
        let at = first + half;
        let mirrored = &cosines.mirrored[half..];
        let diffuse = scale(load::<R::F8, _>(&surfaces.diffuse, at), R::F8::load(&cosines.normal[half..]));
        let strength = load::<R::F8, _>(&surfaces.highlight, at);
        let shining = nothing.lt(strength[0].abs().max(strength[1].abs()).max(strength[2].abs()))
            & nothing.lt(R::F8::load(mirrored));
        let mut highlight = [nothing; 3];
        if shining & lit != 0 {
            let mut powers = [0.0; DOUBLES];
            power(R::D8::widen(mirrored), R::D8::widen(&surfaces.shine[at..])).narrow(&mut powers);
            highlight = select(shining, scale(strength, R::F8::load(&powers)), highlight);
        }
        let radiance = load::<R::F8, _>(&surfaces.radiance, at);
        let brighter = add(radiance, mul(colour, add(diffuse, highlight)));
        store(select(lit, brighter, radiance), &mut surfaces.radiance, at);
    }
}
