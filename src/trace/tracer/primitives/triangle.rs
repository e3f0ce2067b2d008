//! Watertight ray and triangle intersection.
//!
//! S. Woop, C. Benthin, I. Wald, *Watertight Ray/Triangle Intersection*, JCGT 2(1), 2013. Two triangles that
//! share an edge compute the very same edge function with opposite sign, so no ray slips through between.
//! Decided in f64 where its rounding cannot matter, exactly where it could; most triangles that are no hit are
//! told by a bound in f32 before.

use glam::Vec4;

use super::exact::{ExactSum, Vector, add_side, volume};
use super::four_triangles::FourTriangles;
use super::whole_numbers::{Volumes, volumes};
use crate::database::records::Triangle;
use crate::tracer::ray::{Ray, Source};
use crate::tracer::simd::lanes::{Doubles, Lanes};
use crate::tracer::vector::{V3, cross, normalise_or, sub, weighted};

/// The shear that takes the ray to the unit ray along its largest axis.
#[derive(Clone, Copy, Debug)]
pub struct Shear {
    /// The two smaller axes, the largest one last.
    axes: [Axis; 3],
    origin: [f32; 3],
    direction: [f32; 3],
    /// Of the two smaller axes, rounded; what decides is [`ExactShear`].
    shear: [f32; 2],
}

/// An index that needs no check.
#[derive(Clone, Copy, Debug)]
enum Axis {
    X,
    Y,
    Z,
}

/// By the largest axis.
const AXES: [[Axis; 3]; 3] = [[Axis::Y, Axis::Z, Axis::X], [Axis::Z, Axis::X, Axis::Y], [Axis::X, Axis::Y, Axis::Z]];

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
        let share = 1.0 / (u + v + w);
        [u * share, v * share, w * share]
    }

    /// [`Self::barycentrics`] of rays and the triangles that they hit, side by side, and for which of them f64
    /// decides so: the others are left to [`Shear::decide`]. Corners are by axis, then vertex.
    #[inline(always)]
    pub fn weigh<L: Doubles>(corners: [[L; 3]; 3], origin: V3<L>, direction: V3<L>) -> ([L; 3], u32) {
        let [x, y, z] = direction;
        // The first of the largest axes.
        let second = x.abs().lt(y.abs());
        let third = y.select(second, x).abs().lt(z.abs());
        let second = second & !third;
        let [dx, dy, dz] = turn(direction, second, third);
        let [ox, oy, oz] = turn(origin, second, third);
        let shear = [dx.div(dz), dy.div(dz)];
        let [px, py, pz] = turn_rows(corners, second, third);
        let (mut a, mut b, mut c) = ([ox; 3], [ox; 3], [ox; 3]);
        for (vertex, to) in [(0, &mut a), (1, &mut b), (2, &mut c)] {
            let along = pz[vertex].sub(oz);
            *to = [px[vertex].sub(ox).sub(shear[0].mul(along)), py[vertex].sub(oy).sub(shear[1].mul(along)), along];
        }
        let u = c[0].mul(b[1]).sub(c[1].mul(b[0]));
        let v = a[0].mul(c[1]).sub(a[1].mul(c[0]));
        let w = b[0].mul(a[1]).sub(b[1].mul(a[0]));
        let magnitude = a[0].abs().add(a[1].abs()).add(b[0].abs().add(b[1].abs())).add(c[0].abs().add(c[1].abs()));
        let error =
            L::splat(2.0 * Shear::COORDINATE_ERROR_F64).mul(magnitude.add(L::splat(8.0 * Shear::COORDINATE_ERROR_F64)));
        let (least, most) = (u.min(v).min(w), u.max(v).max(w));
        let determinant = u.add(v).add(w);
        let along = u.mul(a[2]).add(v.mul(b[2])).add(w.mul(c[2]));
        let farthest = a[2].abs().max(b[2].abs()).max(c[2].abs());
        let spread = a[2].max(b[2]).max(c[2]).sub(a[2].min(b[2]).min(c[2]));
        let along_error = L::splat(3.0)
            .mul(error)
            .mul(spread)
            .add(L::splat(Shear::DISTANCE_ERROR).mul(farthest).mul(determinant.abs()));
        let one_side = error.lt(least) | most.lt(L::splat(0.0).sub(error));
        let decided = one_side & L::splat(Shear::PRECISION).mul(along_error).lt(along.abs());
        let share = L::splat(1.0).div(determinant);
        ([u.mul(share), v.mul(share), w.mul(share)], decided)
    }
}

/// The points of triangles at these weights of their vertices, and their unit normals: outward by the winding, zero
/// where there is no area.
#[inline(always)]
pub fn point_and_normal<L: Doubles>(vertices: [V3<L>; 3], weights: [L; 3]) -> (V3<L>, V3<L>) {
    let across = cross(sub(vertices[1], vertices[0]), sub(vertices[2], vertices[0]));
    (weighted(vertices, weights), normalise_or(across, [L::splat(0.0); 3]))
}

/// The axes in the order of [`Shear`], where the second is the largest and where the third.
#[inline(always)]
fn turn<L: Lanes>([x, y, z]: V3<L>, second: u32, third: u32) -> V3<L> {
    [z.select(second, x.select(third, y)), x.select(second, y.select(third, z)), y.select(second, z.select(third, x))]
}

#[inline(always)]
fn turn_rows<L: Lanes>([x, y, z]: [[L; 3]; 3], second: u32, third: u32) -> [[L; 3]; 3] {
    let a = turn([x[0], y[0], z[0]], second, third);
    let b = turn([x[1], y[1], z[1]], second, third);
    let c = turn([x[2], y[2], z[2]], second, third);
    [[a[0], b[0], c[0]], [a[1], b[1], c[1]], [a[2], b[2], c[2]]]
}

impl Shear {
    /// Most that a sheared f32 coordinate can be off: coordinates and origin are within ±1, shears too, so
    /// that no intermediate exceeds 4; there are five roundings of 2⁻²⁴ of it or less, the shear's among them.
    const COORDINATE_ERROR: f32 = 20.0 / (1 << 24) as f32;

    /// The same in f64.
    const COORDINATE_ERROR_F64: f64 = 20.0 / (1u64 << 53) as f64;

    /// Relative error of a sum of three products of weights and distances.
    const DISTANCE_ERROR: f64 = 16.0 / (1u64 << 53) as f64;

    /// `t` is taken from f64 only if it is known to so many parts, the precision of f32.
    const PRECISION: f64 = (1 << 24) as f64;

    #[inline(always)]
    pub fn new(ray: &Ray) -> Self {
        let d = ray.direction;
        let (ax, ay, az) = (d[0].abs(), d[1].abs(), d[2].abs());
        let axes = AXES[if az > maximum(ay, ax) { 2 } else { usize::from(ay > ax) }];
        let [x, y, z] = axes;
        let of = |vector: [f32; 3]| [vector[x as usize], vector[y as usize], vector[z as usize]];
        let (origin, direction) = (of(ray.origin), of(d));
        Self { axes, origin, direction, shear: [direction[0] / direction[2], direction[1] / direction[2]] }
    }

    /// Bit i: [`Self::decide`] would not surely find two edge functions of opposite sign for triangle i.
    ///
    /// Each product of an edge function is off by the error of one factor times the other, and by its own
    /// rounding, which is smaller: the sum of all magnitudes, doubled, bounds that for all three.
    #[inline(always)]
    pub fn candidates(&self, four: &FourTriangles) -> u32 {
        let coordinates = four.coordinates();
        let [x, y, z] = self.axes;
        let (px, py, pz) = (&coordinates[x as usize], &coordinates[y as usize], &coordinates[z as usize]);
        let [ox, oy, oz] = self.origin.map(Vec4::splat);
        let [sx, sy] = self.shear.map(Vec4::splat);
        let vertex = |v: usize| {
            let along = pz[v] - oz;
            [px[v] - ox - sx * along, py[v] - oy - sy * along]
        };
        let (a, b, c) = (vertex(0), vertex(1), vertex(2));
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        let magnitude = (a[0].abs() + a[1].abs()) + (b[0].abs() + b[1].abs()) + (c[0].abs() + c[1].abs());
        let slack = Vec4::splat(8.0 * Self::COORDINATE_ERROR);
        let error = Vec4::splat(2.0 * Self::COORDINATE_ERROR) * (magnitude + slack);
        let (least, most) = (u.min(v.min(w)), u.max(v.max(w)));
        let surely_missed = (least + error).cmplt(Vec4::ZERO) & error.cmplt(most);
        !surely_missed.bitmask() & 0b1111
    }

    /// [`Self::decide`] for the ray that this is of: no triangle of the polygon that it starts on is hit.
    #[inline(always)]
    pub fn hit(&self, ray: &Ray, triangle: &Triangle) -> Option<TriangleHit> {
        // Asked first: a ray that starts on the triangle is what f64 cannot decide.
        if ray.source == Source::Polygon(triangle.polygon()) { None } else { self.decide(triangle) }
    }

    /// The hit with `t` at or after the ray's origin. A triangle without area is never hit; a ray through an
    /// edge or a vertex hits all triangles that share it.
    #[inline(never)]
    pub fn decide(&self, triangle: &Triangle) -> Option<TriangleHit> {
        let exact = ExactShear::new(self);
        let (a, b, c) = (exact.vertex(triangle, 0), exact.vertex(triangle, 1), exact.vertex(triangle, 2));
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        let error = Self::edge_function_error(a, b, c);
        let (least, most) = (u.min(v).min(w), u.max(v).max(w));
        if least < -error && most > error {
            return None;
        }
        let determinant = u + v + w;
        let along = u * a[2] + v * b[2] + w * c[2];
        // The weights' errors move t by how far apart the vertices lie along the ray; those of the distances
        // and of their sum are relative to the largest.
        let farthest = a[2].abs().max(b[2].abs()).max(c[2].abs());
        let spread = a[2].max(b[2]).max(c[2]) - a[2].min(b[2]).min(c[2]);
        let along_error = 3.0 * error * spread + Self::DISTANCE_ERROR * farthest * determinant.abs();
        // Written so that NaN is decided exactly.
        if !((least > error || most < -error) && along.abs() > Self::PRECISION * along_error) {
            return self.decide_exactly(triangle);
        }
        let t = along * exact.shear[2] / determinant;
        (t >= 0.0).then_some(TriangleHit { t, edge_functions: [u, v, w] })
    }

    /// As the bound in f32, of three vertices sheared in f64.
    #[inline(always)]
    fn edge_function_error(a: [f64; 3], b: [f64; 3], c: [f64; 3]) -> f64 {
        let magnitude = (a[0].abs() + a[1].abs()) + (b[0].abs() + b[1].abs()) + (c[0].abs() + c[1].abs());
        2.0 * Self::COORDINATE_ERROR_F64 * (magnitude + 8.0 * Self::COORDINATE_ERROR_F64)
    }

    /// By the signs of the three volumes that direction and edges span, and of that of origin and triangle.
    #[cold]
    #[inline(never)]
    fn decide_exactly(&self, triangle: &Triangle) -> Option<TriangleHit> {
        let [x, y, z] = self.axes.map(|axis| triangle.coordinates[axis as usize]);
        let [a, b, c] = [0, 1, 2].map(|v| [x[v], y[v], z[v]]);
        let volumes = volumes(self.origin, self.direction, [a, b, c])
            .unwrap_or_else(|| summed_volumes(self.origin, self.direction, [a, b, c]));
        let edge_functions = volumes.edges;
        // Either orientation.
        if edge_functions.iter().any(|&e| e < 0.0) && edge_functions.iter().any(|&e| e > 0.0) {
            return None;
        }
        // Zero without area, or in the plane: t is not a number, or infinite.
        let t = volumes.triangle / volumes.determinant;
        (volumes.determinant != 0.0 && t >= 0.0).then_some(TriangleHit { t, edge_functions })
    }
}

/// [`volumes`] of any coordinates.
fn summed_volumes(origin: Vector, direction: Vector, [a, b, c]: [Vector; 3]) -> Volumes {
    let mut all = ExactSum::default();
    let edges = [(b, c), (c, a), (a, b)].map(|(from, to)| {
        let mut sum = ExactSum::default();
        add_side(&mut sum, origin, direction, from, to);
        add_side(&mut all, origin, direction, from, to);
        sum.value()
    });
    Volumes { edges, determinant: all.value(), triangle: volume(origin, [a, b, c]) }
}

/// The shear in f64.
struct ExactShear {
    axes: [Axis; 3],
    origin: [f64; 3],
    shear: [f64; 3],
}

impl ExactShear {
    #[inline(always)]
    fn new(shear: &Shear) -> Self {
        let [x, y, along] = shear.direction.map(f64::from);
        Self { axes: shear.axes, origin: shear.origin.map(f64::from), shear: [x / along, y / along, 1.0 / along] }
    }

    /// A vertex relative to the origin, sheared; the third component is its unscaled distance.
    #[inline(always)]
    fn vertex(&self, triangle: &Triangle, v: usize) -> [f64; 3] {
        let [x, y, z] = self.axes;
        let of = |axis: Axis| f64::from(triangle.coordinates[axis as usize][v]);
        let (x, y, along) = (of(x), of(y), of(z) - self.origin[2]);
        [x - self.origin[0] - self.shear[0] * along, y - self.origin[1] - self.shear[1] * along, along]
    }
}

/// One instruction, unlike `f32::max`, which minds NaN.
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
            let mut four = FourTriangles::default();
            four.put(i % 4, &triangle);
            let surely_misses = shear.candidates(&four) >> (i % 4) & 1 == 0;
            assert!(!(hit && surely_misses), "{ray:?} {triangle:?}");
            accepted += usize::from(hit);
            spared += usize::from(surely_misses);
        }
        assert!(accepted > 50_000 && spared > 5_000, "{accepted} accepted, {spared} spared");
    }
}
