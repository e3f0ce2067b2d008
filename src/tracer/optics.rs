//! How light goes on at a surface; for one ray or several side by side.

use glam::{DVec3, Vec3};

use super::simd::lanes::Doubles;
use super::vector::{V3, dot, length, normalise_or, scale, select, splat, sub, weighted};
use crate::database::records::Material;

/// Turned to the side that the ray comes from.
#[inline(always)]
pub fn facing<L: Doubles>(normal: V3<L>, incoming: V3<L>) -> V3<L> {
    let away = L::splat(0.0).lt(dot(incoming, normal));
    let minus = L::splat(-1.0);
    select(away, [normal[0].turned(minus), normal[1].turned(minus), normal[2].turned(minus)], normal)
}

/// Unit directions from points to a light, and how far it is: not a number for a light on the very point.
#[inline(always)]
pub fn towards<L: Doubles>(light: [f64; 3], point: V3<L>) -> (V3<L>, L) {
    let to_light = sub(splat(light), point);
    let distance = length(to_light);
    (scale(to_light, L::splat(1.0).div(distance)), distance)
}

/// The normals of smooth triangles between those of their corners; the triangles' own where these cancel out.
#[inline(always)]
pub fn smooth<L: Doubles>(corners: [V3<L>; 3], barycentrics: [L; 3], own: V3<L>) -> V3<L> {
    normalise_or(weighted(corners, barycentrics), own)
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

/// The rays that a surface sends on: a reflected one, along the mirrored direction, and a refracted one with its
/// direction, not of unit length. `weight` is that of the ray along `incoming`; one that does not exceed `cutoff` is
/// not sent.
#[inline(always)]
pub fn scatter(
    material: &Material,
    outward: DVec3,
    normal: DVec3,
    incoming: DVec3,
    weight: f32,
    cutoff: f32,
) -> (Option<Share>, Option<(Share, DVec3)>) {
    let share = |by_channel: Vec3| {
        let share = Share { by_channel, weight: weight * by_channel.max_element() };
        (share.weight > cutoff).then_some(share)
    };
    let reflection = Vec3::from(material.reflection);
    if !(material.transmittance > 0.0) {
        return (share(reflection), None);
    }
    match refract(material, outward, normal, incoming) {
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
fn refract(material: &Material, outward: DVec3, normal: DVec3, incoming: DVec3) -> Option<DVec3> {
    let ior = f64::from(material.ior);
    let eta = if incoming.dot(outward) < 0.0 { 1.0 / ior } else { ior };
    let cosine = -incoming.dot(normal);
    let k = 1.0 - eta * eta * (1.0 - cosine * cosine);
    (k >= 0.0).then(|| incoming * eta + normal * (eta * cosine - k.sqrt()))
}
