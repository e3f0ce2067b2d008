//! How light goes on at a surface; for one ray or several side by side.

use glam::{DVec3, Vec3};

use super::power::power;
use super::ray::{entering, moved_off};
use super::simd::lanes::{Doubles, Singles};
use super::vector::{V3, add, dot, length, mul, normalise_or, scale, select, splat, sub, weighted};
use crate::database::records::Material;

/// Turned to the side that the ray comes from.
#[inline(always)]
pub fn facing<L: Doubles>(normal: V3<L>, incoming: V3<L>) -> V3<L> {
    let away = L::splat(0.0).lt(dot(incoming, normal));
    let minus = L::splat(-1.0);
    select(away, [normal[0].turned(minus), normal[1].turned(minus), normal[2].turned(minus)], normal)
}

/// The normals of round surfaces, turned to the side of the flat ones that the rays come from, and bent where they would reflect
/// through the flat ones: near outlines they may even turn away from the eye.
///
/// A. Keller et al., *The Iray Light Transport Simulation and Rendering System*, 2017, on bump maps.
#[inline(always)]
pub fn facing_round<L: Doubles>(normal: V3<L>, outward: V3<L>, incoming: V3<L>) -> V3<L> {
    let seen = facing(outward, incoming);
    let side = dot(normal, seen);
    let normal = [normal[0].turned(side), normal[1].turned(side), normal[2].turned(side)];
    let reflected = mirrored(incoming, normal);
    let height = dot(reflected, seen);
    let grazing = sub(reflected, scale(normal, height.div(side.abs().max(L::splat(1e-3)))));
    let bent = normalise_or(sub(normalise_or(grazing, seen), incoming), seen);
    select(height.lt(L::splat(0.0)), bent, normal)
}

/// Rays from points of surfaces to a light, moved off to the sides that they leave to.
pub struct ToLight<L> {
    pub origin: V3<L>,
    /// Unit; not a number for a light on the very point.
    pub direction: V3<L>,
    pub distance: L,
    pub cosines: Cosines<L>,
    /// A bit for each that leaves to the side that the shading normal is on. None on the very point of the light.
    pub turned_to: u32,
    /// A bit for each that meets the root before the light: all, but for some that leave from round surfaces. Nothing is in the way
    /// of the others.
    pub meets_root: u32,
}

/// Of the direction to a light.
#[derive(Clone, Copy, Default)]
pub struct Cosines<L> {
    /// With the shading normal.
    pub normal: L,
    /// With the mirrored ray.
    pub mirrored: L,
}

/// `from`: where the rays leave, if the terminator is soft ([`rounded`]): perhaps outside of the root; then they begin where they enter it.
#[inline(always)]
pub fn aim<L: Doubles>(
    light: DVec3,
    point: V3<L>,
    from: Option<V3<L>>,
    outward: V3<L>,
    normal: V3<L>,
    mirrored: V3<L>,
) -> ToLight<L> {
    let (direction, distance) = towards(light, point);
    let cosines = Cosines { normal: dot(normal, direction), mirrored: dot(mirrored, direction) };
    let turned_to = L::splat(0.0).lt(cosines.normal);
    let Some(from) = from else {
        let origin = moved_off(point, outward, direction);
        return ToLight { origin, direction, distance, cosines, turned_to, meets_root: u32::MAX };
    };
    let (direction, distance) = towards(light, from);
    let (origin, before, enters) = entering(moved_off(from, outward, direction), direction);
    let meets_root = enters & before.lt(distance);
    ToLight { origin, direction, distance: distance.sub(before), cosines, turned_to, meets_root }
}

/// Unit directions to a light, and how far it is.
#[inline(always)]
fn towards<L: Doubles>(light: DVec3, point: V3<L>) -> (V3<L>, L) {
    let to_light = sub(splat(light.to_array()), point);
    let distance = length(to_light);
    (scale(to_light, L::splat(1.0).div(distance)), distance)
}

/// What materials make of light that comes straight from a light.
pub struct Finish<'a, F> {
    pub diffuse: V3<F>,
    pub highlight: V3<F>,
    /// A lane each.
    pub shine: &'a [f32],
}

/// Adds to the radiance of the `lit` lanes what a light of this colour brings: diffuse, and Phong's highlight.
#[inline(always)]
pub fn brighten<F: Singles, D: Doubles>(
    radiance: V3<F>,
    colour: Vec3,
    finish: &Finish<'_, F>,
    cosines: Cosines<&[f32]>,
    lit: u32,
) -> V3<F> {
    let nothing = F::splat(0.0);
    let strength = finish.highlight;
    // Where there is no highlight; not where it is not a number.
    let dull = strength[0].abs().add(strength[1].abs()).add(strength[2].abs()).le(nothing);
    let shining = nothing.lt(F::load(cosines.mirrored)) & !dull;
    let mut highlight = [nothing; 3];
    if shining & lit != 0 {
        let mut powers = [0.0; 8];
        power(D::widen(cosines.mirrored), D::widen(finish.shine)).narrow(&mut powers);
        highlight = select(shining, scale(strength, F::load(&powers)), highlight);
    }
    let diffuse = scale(finish.diffuse, F::load(cosines.normal));
    let brighter = add(radiance, mul(splat(colour.to_array()), add(diffuse, highlight)));
    select(lit, brighter, radiance)
}

/// The normals of smooth triangles between those of their corners; the triangles' own where these cancel out.
#[inline(always)]
pub fn smooth<L: Doubles>(corners: [V3<L>; 3], barycentrics: [L; 3], own: V3<L>) -> V3<L> {
    normalise_or(weighted(corners, barycentrics), own)
}

/// The colours of triangles between those of their corners.
#[inline(always)]
pub fn tint<L: Doubles>(corners: [V3<L>; 3], barycentrics: [L; 3]) -> V3<L> {
    weighted(corners, barycentrics)
}

/// Where rays to lights leave from triangles with a soft terminator: points of flat triangles, moved out to the round surface that
/// the corners' normals describe. A point is moved by what it lies below the planes through the corners, on the side that
/// is `seen`, by the flat triangles' normals; not where the surface is hollow.
///
/// J. Hanika, *Hacking the Shadow Terminator*, Ray Tracing Gems II, 2021.
#[inline(always)]
pub fn rounded<L: Doubles>(
    point: V3<L>,
    vertices: [V3<L>; 3],
    normals: [V3<L>; 3],
    barycentrics: [L; 3],
    seen: V3<L>,
) -> V3<L> {
    let zero = L::splat(0.0);
    let out = |k: usize| {
        let normal: V3<L> = normals[k];
        let side = dot(normal, seen);
        let normal = [normal[0].turned(side), normal[1].turned(side), normal[2].turned(side)];
        let above = dot(sub(point, vertices[k]), normal).min(zero);
        scale(normal, zero.sub(above))
    };
    add(point, weighted([out(0), out(1), out(2)], barycentrics))
}

/// A ray's direction, reflected: of unit length but for rounding.
#[inline(always)]
pub fn mirrored<L: Doubles>(incoming: V3<L>, normal: V3<L>) -> V3<L> {
    sub(incoming, scale(normal, L::splat(2.0).mul(dot(incoming, normal))))
}

/// What a ray that a surface sends on adds to the surface's radiance.
#[derive(Clone, Copy, Debug)]
pub struct Share {
    /// Of the radiance that the ray brings, by channel.
    pub by_channel: Vec3,
    /// Share of the pixel that the ray decides, in the strongest channel.
    pub weight: f32,
}

impl Share {
    /// All of a pixel.
    pub const WHOLE: Self = Self { by_channel: Vec3::ONE, weight: 1.0 };
}

/// The rays that a surface sends on: a reflected one, and a refracted one along what `refracted` says, which is asked
/// only if the material transmits. `weight` is that of the ray that comes in; one that does not exceed `cutoff` is not
/// sent.
#[inline(always)]
pub fn scatter(
    material: &Material,
    weight: f32,
    cutoff: f32,
    refracted: impl FnOnce() -> Option<DVec3>,
) -> (Option<Share>, Option<(Share, DVec3)>) {
    let share = |by_channel: Vec3| {
        let share = Share { by_channel, weight: weight * by_channel.max_element() };
        (share.weight > cutoff).then_some(share)
    };
    let reflection = Vec3::from(material.reflection);
    if !(material.transmittance > 0.0) {
        return (share(reflection), None);
    }
    match refracted() {
        Some(direction) => {
            let refraction = share(Vec3::splat(material.transmittance));
            (share(reflection), refraction.map(|share| (share, direction)))
        }
        // Total internal reflection: what cannot leave is reflected.
        None => (share(reflection + material.transmittance), None),
    }
}

/// Snell's direction through the surface; `None` if it reflects totally. The side is told by the geometric normal, which
/// points outward.
pub fn refract(material: &Material, outward: DVec3, normal: DVec3, incoming: DVec3) -> Option<DVec3> {
    let ior = f64::from(material.ior());
    let eta = if incoming.dot(outward) < 0.0 { 1.0 / ior } else { ior };
    let cosine = -incoming.dot(normal);
    let k = 1.0 - eta * eta * (1.0 - cosine * cosine);
    (k >= 0.0).then(|| incoming * eta + normal * (eta * cosine - k.sqrt()))
}
