//! Triangles against rays in f32 lanes: what is surely missed, what is surely hit, and where between.
//!
//! T. Möller, B. Trumbore, *Fast, Minimum Storage Ray/Triangle Intersection*, 1997, with a bound on every rounding, so
//! that a sign or an order which is told is that of the exact numbers; what is not told is decided by
//! [`Shear`](crate::tracer::primitives::triangle::Shear). Either side may be the one that is many: a triangle of 16
//! rays, a ray of 16 triangles.
//!
//! With u = 2⁻²⁴, coordinates within ±1 and directions no longer than 1 (by 2⁻⁶ at most): an edge function is off by at most
//! 27·u·s + 9·u·l, where s is the sum of the lengths (in the 1-norm) of the two edges and l ≤ s²/4 their product; the
//! distance, times the determinant, by 20·u·l; the determinant by 7·u·l. What is computed from them adds 4·u·l.

use super::tree::Block;
use crate::tracer::simd::lanes::{Lanes, Singles};
use crate::tracer::vector::{cross, dot, sub};

/// Half of the spacing of f32 below 1.
const ROUNDING: f32 = 1.0 / (1 << 24) as f32;

/// Triangles, or one many times.
#[derive(Clone, Copy)]
pub(super) struct Triangles<L> {
    corner: [L; 3],
    /// From the second corner to the first, and from the first to the third.
    edges: [[L; 3]; 2],
    normal: [L; 3],
    /// Bounds of edge functions, and of the distance times the determinant; that of the determinant is half of it.
    edge_error: L,
    distance_error: L,
}

/// [`Triangles`] in memory, to be taken out one by one.
#[repr(C, align(64))]
pub(super) struct Rows([[f32; 16]; 14]);

impl Rows {
    pub(super) const ZERO: Self = Self([[0.0; 16]; 14]);

    #[inline(always)]
    fn number<L: Singles>(&self, row: usize, at: usize) -> L {
        L::splat(self.0[row][at & 15])
    }

    #[inline(always)]
    fn vector<L: Singles>(&self, first: usize, at: usize) -> [L; 3] {
        [self.number(first, at), self.number(first + 1, at), self.number(first + 2, at)]
    }
}

/// Rays, or one many times.
#[derive(Clone, Copy)]
pub(super) struct Rays<L> {
    pub origin: [L; 3],
    pub direction: [L; 3],
}

/// What is known of a test; a bit a lane.
pub(super) struct Tested<L> {
    /// Not surely missed, nor surely behind the origin or beyond `far`.
    pub possible: u32,
    /// Surely hit, at or after the origin.
    pub certain: u32,
    /// Times the determinant's magnitude.
    distance: L,
    determinant: L,
    distance_error: L,
}

impl<L: Singles> Triangles<L> {
    #[inline(always)]
    pub(super) fn of_block(block: &Block<'_>) -> Self {
        let (a, b, c): ([L; 3], [L; 3], [L; 3]) = (vertex(block, 0), vertex(block, 1), vertex(block, 2));
        let edges = [sub(a, b), sub(c, a)];
        let lengths = [one_norm(edges[0]), one_norm(edges[1])];
        let sum = lengths[0].add(lengths[1]);
        let edge_error = sum.mul(L::splat(40.0 * ROUNDING).add(sum.mul(L::splat(4.0 * ROUNDING))));
        let distance_error = lengths[0].mul(lengths[1]).mul(L::splat(24.0 * ROUNDING));
        Self { corner: a, edges, normal: cross(edges[1], edges[0]), edge_error, distance_error }
    }

    #[inline(always)]
    pub(super) fn store(&self, rows: &mut Rows) {
        let ([e0, e1], rows) = (self.edges, &mut rows.0);
        for axis in 0..3 {
            self.corner[axis].store(&mut rows[axis]);
            e0[axis].store(&mut rows[3 + axis]);
            e1[axis].store(&mut rows[6 + axis]);
            self.normal[axis].store(&mut rows[9 + axis]);
        }
        self.edge_error.store(&mut rows[12]);
        self.distance_error.store(&mut rows[13]);
    }

    /// Triangle `at` of the rows, in all lanes.
    #[inline(always)]
    pub(super) fn one_of(rows: &Rows, at: usize) -> Self {
        Self {
            corner: rows.vector(0, at),
            edges: [rows.vector(3, at), rows.vector(6, at)],
            normal: rows.vector(9, at),
            edge_error: rows.number(12, at),
            distance_error: rows.number(13, at),
        }
    }

    /// Tests the lanes of `mask`.
    #[inline(always)]
    pub(super) fn test(&self, rays: &Rays<L>, mask: u32, far: L) -> Option<Tested<L>> {
        let to_corner = sub(self.corner, rays.origin);
        let moment = cross(to_corner, rays.direction);
        let determinant = dot(self.normal, rays.direction);
        let (u, v) = (dot(moment, self.edges[1]), dot(moment, self.edges[0]));
        let w = determinant.sub(u).sub(v);
        let (least, most) = (u.min(v).min(w), u.max(v).max(w));
        let error = self.edge_error;
        let below = L::splat(0.0).sub(error);
        let possible = mask & !(least.lt(below) & error.lt(most));
        if possible == 0 {
            return None;
        }
        let distance = dot(self.normal, to_corner).turned(determinant);
        let (determinant, distance_error) = (determinant.abs(), self.distance_error);
        let determinant_error = distance_error.mul(L::splat(0.5));
        let behind = distance.lt(L::splat(0.0).sub(distance_error));
        let beyond = far.mul(determinant.add(determinant_error)).lt(distance.sub(distance_error));
        let possible = possible & !((behind | beyond) & determinant_error.lt(determinant));
        if possible == 0 {
            return None;
        }
        let certain = possible & (error.lt(least) | most.lt(below)) & distance_error.lt(distance);
        Some(Tested { possible, certain, distance, determinant, distance_error })
    }
}

impl<L: Singles> Tested<L> {
    /// Lanes, of the certain ones, that are surely hit before `far`.
    #[inline(always)]
    pub(super) fn before(&self, far: L) -> u32 {
        let determinant = self.determinant.sub(self.distance_error.mul(L::splat(0.5)));
        self.certain & self.distance.add(self.distance_error).lt(far.mul(determinant))
    }

    /// Between what the ray parameters of the certain lanes are.
    #[inline(always)]
    pub(super) fn between(&self) -> (L, L) {
        let determinant_error = self.distance_error.mul(L::splat(0.5));
        let least = self.distance.sub(self.distance_error).div(self.determinant.add(determinant_error));
        let most = self.distance.add(self.distance_error).div(self.determinant.sub(determinant_error));
        (least.mul(L::splat(1.0 - 8.0 * ROUNDING)), most.mul(L::splat(1.0 + 8.0 * ROUNDING)))
    }
}

#[inline(always)]
pub(super) fn vertex<L: Singles>(block: &Block<'_>, v: usize) -> [L; 3] {
    [L::load(block.coordinates(0, v)), L::load(block.coordinates(1, v)), L::load(block.coordinates(2, v))]
}

#[inline(always)]
fn one_norm<L: Lanes>(v: [L; 3]) -> L {
    v[0].abs().add(v[1].abs()).add(v[2].abs())
}
