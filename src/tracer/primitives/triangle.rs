//! Watertight ray and triangle intersection.
//!
//! S. Woop, C. Benthin, I. Wald, *Watertight Ray/Triangle Intersection*, JCGT 2(1), 2013. Two triangles that
//! share an edge compute the very same edge function with opposite sign, so no ray slips through between.

use crate::database::records::Triangle;
use crate::tracer::ray::Ray;

/// The shear that takes the ray to the unit ray along its largest axis.
#[derive(Clone, Copy, Debug)]
pub struct Shear {
    axes: [usize; 3],
    origin: [f64; 3],
    shear: [f64; 3],
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
    pub fn new(ray: &Ray) -> Self {
        let d = ray.direction.map(f64::from);
        let largest = |a: usize, b: usize| if d[b].abs() > d[a].abs() { b } else { a };
        let z = largest(largest(0, 1), 2);
        let (x, y) = ((z + 1) % 3, (z + 2) % 3);
        Self {
            axes: [x, y, z],
            origin: [x, y, z].map(|a| f64::from(ray.origin[a])),
            shear: [d[x] / d[z], d[y] / d[z], 1.0 / d[z]],
        }
    }

    /// The hit with `t` at or after the ray's origin. A triangle without area is never hit; a ray through an
    /// edge or a vertex hits all triangles that share it.
    #[inline(always)]
    pub fn intersect(&self, triangle: &Triangle) -> Option<TriangleHit> {
        let [a, b, c] = triangle.vertices.map(|v| self.vertex(v));
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
    fn vertex(&self, v: [f32; 3]) -> [f64; 3] {
        let [x, y, z] = self.axes;
        let along = f64::from(v[z]) - self.origin[2];
        [
            f64::from(v[x]) - self.origin[0] - self.shear[0] * along,
            f64::from(v[y]) - self.origin[1] - self.shear[1] * along,
            along,
        ]
    }
}
