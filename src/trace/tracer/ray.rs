//! A ray in the root cube's coordinates, and what is computed once for it.

use glam::DVec3;

use super::simd::lanes::Doubles;
use super::vector::{V3, add, dot, scale};

/// A ray with its origin in the root cube.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Normalised coordinates, each in −1 to 1.
    pub origin: [f32; 3],
    /// Unit length but for rounding.
    pub direction: [f32; 3],
    /// Only hits nearer than this count.
    pub t_max: f32,
    /// What the ray leaves from.
    pub source: Source,
}

/// What a secondary ray leaves from: it never hits that at its own origin.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Source {
    /// A primary ray.
    Eye,
    /// Planar: cannot be hit again at all.
    Polygon(u32),
    /// A sphere's or cone's id: its root nearest to the origin is the origin itself, its other is a real hit.
    Curved(u32),
}

/// How far a secondary ray's origin is moved off its surface, in normalised units: four units in the last
/// place of the root's half extent, above the rounding of the point to f32 (2⁻²⁵ an axis).
const OFFSET: f64 = 1.0 / (1 << 22) as f64;

impl Ray {
    /// A ray from a point of a surface, moved off to the side that `direction` leaves to.
    pub fn leaving(point: DVec3, normal: DVec3, direction: DVec3, t_max: f32, source: Source) -> Self {
        let origin = moved_off(point.to_array(), normal.to_array(), direction.to_array());
        Self {
            origin: DVec3::from(origin).as_vec3().to_array(),
            direction: direction.as_vec3().to_array(),
            t_max,
            source,
        }
    }

    /// A ray from anywhere, in f64: moved to where it enters the root, so that `t` cannot outgrow the
    /// octree's padding. With it, the distance moved; `None` if it misses the root or is not finite.
    pub fn from_eye(origin: DVec3, direction: DVec3) -> Option<(Self, f64)> {
        let (inside, enter, enters) = entering::<f64>(origin.to_array(), direction.to_array());
        let ray = Self {
            origin: DVec3::from(inside).as_vec3().to_array(),
            direction: direction.as_vec3().to_array(),
            t_max: f32::INFINITY,
            source: Source::Eye,
        };
        (enters != 0).then_some((ray, enter))
    }

    pub fn origin_f64(&self) -> DVec3 {
        DVec3::from(self.origin.map(f64::from))
    }

    pub fn direction_f64(&self) -> DVec3 {
        DVec3::from(self.direction.map(f64::from))
    }
}

/// Points of surfaces, moved off to the sides that the directions leave to.
#[inline(always)]
pub fn moved_off<L: Doubles>(point: V3<L>, normal: V3<L>, direction: V3<L>) -> V3<L> {
    let below = dot(direction, normal).lt(L::splat(0.0));
    add(point, scale(normal, L::splat(-OFFSET).select(below, L::splat(OFFSET))))
}

/// Where rays enter the root, how far that is, and which do: a bit each. From within the root that is where they are.
#[inline(always)]
pub fn entering<L: Doubles>(origin: V3<L>, direction: V3<L>) -> (V3<L>, L, u32) {
    let (one, infinity) = (L::splat(1.0), L::splat(f64::INFINITY));
    let (mut enter, mut leave) = (L::splat(0.0), infinity);
    let mut possible = u32::MAX;
    for axis in 0..3 {
        let (o, d) = (origin[axis], direction[axis]);
        let parallel = d.abs().le(L::splat(0.0));
        let inverse = one.div(d);
        let (a, b) = (L::splat(-1.0).sub(o).mul(inverse), one.sub(o).mul(inverse));
        enter = enter.select(parallel, enter.max(a.min(b)));
        leave = leave.select(parallel, leave.min(a.max(b)));
        possible &= d.abs().lt(infinity);
        possible &= o.abs().le(one) | !parallel;
    }
    let inside = add(origin, scale(direction, enter));
    let inside = [
        inside[0].max(L::splat(-1.0)).min(one),
        inside[1].max(L::splat(-1.0)).min(one),
        inside[2].max(L::splat(-1.0)).min(one),
    ];
    (inside, enter, possible & enter.le(leave) & enter.lt(infinity))
}
