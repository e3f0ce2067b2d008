//! A ray in the root cube's coordinates, and what is computed once for it.

use glam::DVec3;

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
        let side = if direction.dot(normal) < 0.0 { -OFFSET } else { OFFSET };
        Self {
            origin: (point + normal * side).as_vec3().to_array(),
            direction: direction.as_vec3().to_array(),
            t_max,
            source,
        }
    }

    /// A ray from anywhere, in f64: moved to where it enters the root, so that `t` cannot outgrow the
    /// octree's padding. With it, the distance moved; `None` if it misses the root or is not finite.
    pub fn from_eye(origin: DVec3, direction: DVec3) -> Option<(Self, f64)> {
        let (mut enter, mut leave) = (0.0f64, f64::INFINITY);
        for axis in 0..3 {
            let (o, d) = (origin[axis], direction[axis]);
            if d == 0.0 {
                if !(o.abs() <= 1.0) {
                    return None;
                }
                continue;
            }
            let (a, b) = ((-1.0 - o) / d, (1.0 - o) / d);
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        if !(enter <= leave && enter.is_finite() && direction.is_finite()) {
            return None;
        }
        let inside = (origin + direction * enter).clamp(DVec3::NEG_ONE, DVec3::ONE);
        let ray = Self {
            origin: inside.as_vec3().to_array(),
            direction: direction.as_vec3().to_array(),
            t_max: f32::INFINITY,
            source: Source::Eye,
        };
        Some((ray, enter))
    }

    pub fn origin_f64(&self) -> DVec3 {
        DVec3::from(self.origin.map(f64::from))
    }

    pub fn direction_f64(&self) -> DVec3 {
        DVec3::from(self.direction.map(f64::from))
    }
}
