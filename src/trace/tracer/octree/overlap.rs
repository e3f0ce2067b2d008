//! Which of a cell's eight children a primitive reaches into.
//!
//! In f64, with closed comparisons and cells padded outward, so that a primitive in a face is listed on both
//! sides of it, and so that whatever cell HERO thinks a hit lies in, the primitive is listed there.

use glam::DVec3;

use crate::database::records::{Cone, Sphere, Triangle};

/// How far a cell is padded, in normalised units. HERO's planes are off by at most 2·(3 + depth)·2⁻²⁴: three
/// roundings of a root plane, one more a level, each relative to a distance of at most 2. For depth 20 that is
/// 2.8e-6; this is 3.8e-6.
pub const PADDING: f64 = 1.0 / (1 << 18) as f64;

/// A cubic cell of the octree.
#[derive(Clone, Copy, Debug)]
pub struct Cell {
    pub centre: DVec3,
    /// Half the length of an edge, without padding.
    pub half: f64,
}

impl Cell {
    pub const ROOT: Self = Self { centre: DVec3::ZERO, half: 1.0 };

    pub fn child(self, octant: usize) -> Self {
        let half = self.half / 2.0;
        let side = |axis: usize| if octant >> axis & 1 == 1 { half } else { -half };
        Self { centre: self.centre + DVec3::new(side(0), side(1), side(2)), half }
    }
}

/// A box around a primitive.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    pub(in crate::tracer) lo: [f64; 3],
    pub(in crate::tracer) hi: [f64; 3],
}

impl Bounds {
    #[inline(always)]
    pub fn of_triangle(triangle: &Triangle) -> Self {
        let (mut lo, mut hi) = ([0.0; 3], [0.0; 3]);
        for axis in 0..3 {
            let [a, b, c] = triangle.coordinates[axis];
            lo[axis] = f64::from(lesser(lesser(a, b), c));
            hi[axis] = f64::from(greater(greater(a, b), c));
        }
        Self { lo, hi }
    }

    pub fn of_sphere(sphere: &Sphere) -> Self {
        let centre = DVec3::from(sphere.centre.map(f64::from));
        let radius = f64::from(sphere.radius.abs());
        Self { lo: (centre - radius).into(), hi: (centre + radius).into() }
    }

    pub fn of_cone(cone: &Cone) -> Self {
        let (base, apex) = (DVec3::from(cone.base.map(f64::from)), DVec3::from(cone.apex.map(f64::from)));
        let axis = (apex - base).normalize_or_zero();
        let reach = (DVec3::ONE - axis * axis).max(DVec3::ZERO).map(f64::sqrt);
        let (r0, r1) = (reach * f64::from(cone.base_radius.abs()), reach * f64::from(cone.apex_radius.abs()));
        Self { lo: (base - r0).min(apex - r1).into(), hi: (base + r0).max(apex + r1).into() }
    }

    /// Bit o: the box reaches into octant o of the cell. The parent is taken to be reached.
    #[inline(always)]
    pub fn octants(&self, cell: Cell) -> u8 {
        // Octants with bit `axis` clear; the others have it set.
        const LOWER: [u8; 3] = [0b0101_0101, 0b0011_0011, 0b0000_1111];
        let mut mask = 0xff;
        for (axis, lower) in LOWER.into_iter().enumerate() {
            let below = u8::from(self.lo[axis] <= cell.centre[axis] + PADDING);
            let above = u8::from(self.hi[axis] >= cell.centre[axis] - PADDING);
            mask &= (lower * below) | (!lower * above);
        }
        mask
    }

    /// Whether the box lies within the cell.
    #[inline(always)]
    pub fn is_within(&self, cell: Cell) -> bool {
        let reach = cell.half + PADDING;
        (0..3).all(|axis| self.lo[axis] >= cell.centre[axis] - reach && self.hi[axis] <= cell.centre[axis] + reach)
    }
}

/// Keeps of `candidates` the octants that the triangle itself reaches into: separating axes are the triangle's
/// normal and the cross products of its edges with the cell's, the latter as edge functions of the three
/// projections (M. Schwarz, H.-P. Seidel, *Fast Parallel Surface and Solid Voxelization*, 2010). An axis that
/// is zero never separates.
///
/// All octants at once and without a branch: which of them an axis separates is as good as random.
#[inline(always)]
pub fn triangle_octants(triangle: &Triangle, cell: Cell, candidates: u8) -> u8 {
    let half = cell.half / 2.0;
    let reach = half + PADDING;
    let vertices = triangle.vertices().map(|v| v - cell.centre);
    let edges = [vertices[1] - vertices[0], vertices[2] - vertices[1], vertices[0] - vertices[2]];
    let normal = edges[0].cross(edges[1]);
    let plane = normal.dot(vertices[0]);
    let plane_reach = reach * (normal.x.abs() + normal.y.abs() + normal.z.abs());
    let (layer, z) = (at_quadrants(normal.x * half, normal.y * half), normal.z * half);
    let mut separated = 0;
    for (quadrant, at) in layer.into_iter().enumerate() {
        separated |= u8::from((at - z - plane).abs() > plane_reach) << quadrant;
        separated |= u8::from((at + z - plane).abs() > plane_reach) << (quadrant + 4);
    }
    for (z, quadrants) in QUADRANTS.iter().enumerate() {
        let (x, y) = ((z + 1) % 3, (z + 2) % 3);
        // Inward edge normals of the projection along z.
        let sign = if normal[z] < 0.0 { -1.0 } else { 1.0 };
        let mut gaps = [0.0; 4];
        for i in 0..3 {
            let (nx, ny) = (-edges[i][y] * sign, edges[i][x] * sign);
            let offset = nx * vertices[i][x] + ny * vertices[i][y];
            let third = &vertices[(i + 2) % 3];
            let inner = nx * third[x] + ny * third[y];
            let edge_reach = reach * (nx.abs() + ny.abs());
            let (lo, hi) = if inner < offset { (inner, offset) } else { (offset, inner) };
            let at = at_quadrants(nx * half, ny * half);
            for quadrant in 0..4 {
                let (below, above) = (lo - (at[quadrant] + edge_reach), at[quadrant] - edge_reach - hi);
                gaps[quadrant] = greater(gaps[quadrant], greater(below, above));
            }
        }
        let mut set = 0;
        for (quadrant, gap) in gaps.into_iter().enumerate() {
            set |= usize::from(gap > 0.0) << quadrant;
        }
        separated |= quadrants[set];
    }
    candidates & !separated
}

/// Σ ±coefficient, as a linear function takes it at the centres of the quadrants: bit 0 for the upper half
/// of the first axis, bit 1 of the second.
#[inline(always)]
fn at_quadrants(first: f64, second: f64) -> [f64; 4] {
    [-first - second, first - second, -first + second, first + second]
}

/// The processor's own minimum: unlike `min`, it leaves NaNs alone, which there are none of.
#[inline(always)]
fn lesser<T: PartialOrd>(a: T, b: T) -> T {
    if a < b { a } else { b }
}

#[inline(always)]
fn greater<T: PartialOrd>(a: T, b: T) -> T {
    if a > b { a } else { b }
}

/// For a projection along each axis z, to the axes z + 1 and z + 2: the octants that a set of quadrants is of.
const QUADRANTS: [[u8; 16]; 3] = {
    let mut octants = [[0; 16]; 3];
    let mut i = 0;
    while i < 3 * 16 * 8 {
        let (z, set, octant) = (i / 128, i / 8 % 16, i % 8);
        let quadrant = octant >> ((z + 1) % 3) & 1 | (octant >> ((z + 2) % 3) & 1) << 1;
        if set >> quadrant & 1 == 1 {
            octants[z][set] |= 1 << octant;
        }
        i += 1;
    }
    octants
};

/// Keeps the octants that the sphere's surface passes through: not those wholly outside or inside.
pub fn sphere_octants(sphere: &Sphere, cell: Cell, candidates: u8) -> u8 {
    let centre = DVec3::from(sphere.centre.map(f64::from));
    let radius = f64::from(sphere.radius.abs());
    keep(candidates, |octant| {
        let child = cell.child(octant);
        let distance = (centre - child.centre).abs();
        let nearest = (distance - child.half - PADDING).max(DVec3::ZERO);
        let farthest = distance + child.half + PADDING;
        nearest.length() <= radius + PADDING && farthest.length() >= radius - PADDING
    })
}

/// Keeps the octants near the cone: by its height along the axis and by the capsule around it.
pub fn cone_octants(cone: &Cone, cell: Cell, candidates: u8) -> u8 {
    let (base, apex) = (DVec3::from(cone.base.map(f64::from)), DVec3::from(cone.apex.map(f64::from)));
    let height = (apex - base).length();
    let axis = (apex - base).normalize_or_zero();
    let radius = f64::from(cone.base_radius.abs().max(cone.apex_radius.abs()));
    keep(candidates, |octant| {
        let child = cell.child(octant);
        let reach = child.half + PADDING;
        let from_base = child.centre - base;
        let along = from_base.dot(axis);
        let reach_along = reach * axis.abs().element_sum();
        let from_axis = (from_base - axis * along.clamp(0.0, height)).length();
        along + reach_along >= 0.0
            && along - reach_along <= height
            && from_axis <= radius + reach * 3f64.sqrt() + PADDING
    })
}

fn keep(candidates: u8, reaches: impl Fn(usize) -> bool) -> u8 {
    (0..8).filter(|&o| candidates >> o & 1 == 1 && reaches(o)).fold(0, |mask, o| mask | 1 << o)
}
