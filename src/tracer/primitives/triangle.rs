//! Watertight ray and triangle intersection.
//!
//! S. Woop, C. Benthin, I. Wald, *Watertight Ray/Triangle Intersection*, JCGT 2(1), 2013. Two triangles that
//! share an edge compute the very same edge function with opposite sign, so no ray slips through between.
//! Decided in f64; most triangles that are no hit are told by a bound in f32 before.

use crate::database::records::Triangle;
use crate::tracer::ray::Ray;

/// The shear that takes the ray to the unit ray along its largest axis.
#[derive(Clone, Copy, Debug)]
pub struct Shear {
    /// The two smaller axes, the largest one last.
    axes: [usize; 3],
    origin: [f64; 3],
    shear: [f64; 3],
    origin_f32: [f32; 3],
    shear_f32: [f32; 2],
}

/// Where a triangle is hit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriangleHit {
    pub t: f64,
    /// Weights of the vertices, not normalised: divide by their sum.
    edge_functions: [f64; 3],
}

impl TriangleHit {
    pub fn barycentrics(&self) -> [f64; 3] {
        let [u, v, w] = self.edge_functions;
        let sum = u + v + w;
        [u / sum, v / sum, w / sum]
    }
}

impl Shear {
    /// Most that a sheared f32 coordinate can be off: coordinates and origin are within ±1, shears too, so
    /// that no intermediate exceeds 4; there are five roundings of 2⁻²⁴ of it or less, the shear's among them.
    const COORDINATE_ERROR: f32 = 20.0 / (1 << 24) as f32;

    #[inline(always)]
    pub fn new(ray: &Ray) -> Self {
        let d = ray.direction;
        let larger = |a: usize, b: usize| if d[b].abs() > d[a].abs() { b } else { a };
        let z = larger(larger(0, 1), 2);
        let (x, y) = ([1, 2, 0][z], [2, 0, 1][z]);
        let along = f64::from(d[z]);
        let shear = [f64::from(d[x]) / along, f64::from(d[y]) / along, 1.0 / along];
        let origin = [ray.origin[x], ray.origin[y], ray.origin[z]];
        Self {
            axes: [x, y, z],
            origin: [f64::from(origin[0]), f64::from(origin[1]), f64::from(origin[2])],
            shear,
            origin_f32: origin,
            shear_f32: [shear[0] as f32, shear[1] as f32],
        }
    }

    /// The hit with `t` at or after the ray's origin. A triangle without area is never hit; a ray through an
    /// edge or a vertex hits all triangles that share it.
    #[inline(always)]
    pub fn intersect(&self, triangle: &Triangle) -> Option<TriangleHit> {
        if self.surely_misses(triangle) { None } else { self.decide(triangle) }
    }

    /// True only if [`Self::decide`] would find two edge functions of opposite sign.
    ///
    /// Each product of an edge function is off by the error of one factor times the other, and by its own
    /// rounding, which is smaller: the sum of all magnitudes, doubled, bounds that for all three.
    #[inline(always)]
    fn surely_misses(&self, triangle: &Triangle) -> bool {
        let [x, y, z] = self.axes;
        let [px, py, pz] = [triangle.coordinates[x], triangle.coordinates[y], triangle.coordinates[z]];
        let ([ox, oy, oz], [sx, sy]) = (self.origin_f32, self.shear_f32);
        let vertex = |v: usize| {
            let along = pz[v] - oz;
            [px[v] - ox - sx * along, py[v] - oy - sy * along]
        };
        let (a, b, c) = (vertex(0), vertex(1), vertex(2));
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        let magnitude = (a[0].abs() + a[1].abs()) + (b[0].abs() + b[1].abs()) + (c[0].abs() + c[1].abs());
        let error = 2.0 * Self::COORDINATE_ERROR * (magnitude + 8.0 * Self::COORDINATE_ERROR);
        let (least, most) = (minimum(u, minimum(v, w)), maximum(u, maximum(v, w)));
        least < -error && most > error
    }

    #[inline(never)]
    fn decide(&self, triangle: &Triangle) -> Option<TriangleHit> {
        let (a, b, c) = (self.vertex(triangle, 0), self.vertex(triangle, 1), self.vertex(triangle, 2));
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        // Either orientation; written so that NaN is no hit.
        if !((u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0)) {
            return None;
        }
        let determinant = u + v + w;
        let t = (u * a[2] + v * b[2] + w * c[2]) * self.shear[2] / determinant;
        (determinant != 0.0 && t >= 0.0).then_some(TriangleHit { t, edge_functions: [u, v, w] })
    }

    /// A vertex relative to the origin, sheared; the third component is its unscaled distance.
    #[inline(always)]
    fn vertex(&self, triangle: &Triangle, v: usize) -> [f64; 3] {
        let [x, y, z] = self.axes;
        let along = f64::from(triangle.coordinates[z][v]) - self.origin[2];
        [
            f64::from(triangle.coordinates[x][v]) - self.origin[0] - self.shear[0] * along,
            f64::from(triangle.coordinates[y][v]) - self.origin[1] - self.shear[1] * along,
            along,
        ]
    }
}

/// One instruction each, unlike `f32::min`, which minds NaN.
#[inline(always)]
fn minimum(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn maximum(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg32;

    use super::*;
    use crate::tracer::ray::Source;

    #[test]
    fn the_f32_bound_never_rejects_what_f64_accepts() {
        let mut random = Pcg32::seed_from_u64(3);
        let mut unit = || f64::from(random.next_u32()) as f32 / u32::MAX as f32 * 2.0 - 1.0;
        let (mut accepted, mut spared) = (0, 0);
        for i in 0..300_000 {
            let size = 10f32.powf(-7.0 * (i % 8) as f32 / 8.0);
            let mut point = || Vec3::new(unit(), unit(), unit());
            let (origin, centre) = (point(), point() * 0.9);
            // Aimed at an edge or a little beside it, so that many are near zero.
            let (a, b) = (centre + point() * size * 0.1, centre + point() * size * 0.1);
            let c = centre + point() * size;
            let target = a + (b - a) * 0.5 + point() * size * [0.0, 1e-6, 1e-3][i % 3];
            let ray = Ray {
                origin: origin.to_array(),
                direction: (target - origin).normalize().to_array(),
                t_max: f32::INFINITY,
                source: Source::Eye,
            };
            let triangle = Triangle::new([a, b, c].map(|v| v.to_array()), 0, 0);
            let shear = Shear::new(&ray);
            let hit = shear.decide(&triangle).is_some();
            assert!(!(hit && shear.surely_misses(&triangle)), "{ray:?} {triangle:?}");
            accepted += usize::from(hit);
            spared += usize::from(shear.surely_misses(&triangle));
        }
        assert!(accepted > 50_000 && spared > 5_000, "{accepted} accepted, {spared} spared");
    }
}
