//! What is computed once a ray.

use crate::tracer::primitives::triangle::Shear;
use crate::tracer::ray::Ray;
use crate::tracer::simd::four::F32x4;
use crate::tracer::stats::MAX_DEPTH;

pub(super) struct Prepared<'a> {
    pub ray: &'a Ray,
    pub shear: Shear,
    /// Axes along which the ray runs downward, as an octant mask.
    pub mirror: u32,
    /// Axes along which it does not run at all.
    pub parallel: u32,
    /// Ray parameters of the root's planes.
    pub near: F32x4,
    pub far: F32x4,
    pub enter: f32,
    pub leave: f32,
}

impl<'a> Prepared<'a> {
    /// `None` when the ray misses the root or is not finite.
    #[inline(always)]
    pub(super) fn new(ray: &'a Ray) -> Option<Self> {
        let (origin, direction) = (F32x4::axes(ray.origin), F32x4::axes(ray.direction));
        let (zero, one, infinity) = (F32x4::splat(0.0), F32x4::splat(1.0), F32x4::splat(f32::INFINITY));
        let finite = direction.abs().less(infinity).signs() & origin.abs().less(infinity).signs();
        if finite & 0b111 != 0b111 {
            return None;
        }
        let inverse = one / direction;
        let (lower, upper) = ((F32x4::splat(-1.0) - origin) * inverse, (one - origin) * inverse);
        let downward = direction.less(zero);
        let (mut near, mut far) = (downward.select(upper, lower), downward.select(lower, upper));
        // Below this, 1/d or its product with a distance would overflow; −0 is one of them.
        let is_parallel = direction.abs().less(F32x4::splat(f32::MIN_POSITIVE));
        let parallel = is_parallel.signs() & 0b111;
        if parallel != 0 {
            let outside = !origin.abs().less_or_equal(one).signs();
            // All three parallel: no direction at all.
            if parallel == 0b111 || outside & parallel != 0 {
                return None;
            }
            near = is_parallel.select(F32x4::splat(f32::NEG_INFINITY), near);
            far = is_parallel.select(infinity, far);
        }
        // What is not a number does not count.
        let (enter, leave) = (near.max(zero).max_axis(), far.min(F32x4::splat(ray.t_max)).min_axis());
        // False for what is not a number.
        if !(enter <= leave) {
            return None;
        }
        let mirror = downward.signs() & 0b111 & !parallel;
        Some(Self { ray, shear: Shear::new(ray), mirror, parallel, near, far, enter, leave })
    }

    /// Ray parameters of the mid planes of a cell on `level`, of half those of its other planes. Where the ray is parallel to a plane it stays on one
    /// side for ever: in the upper half if it lies in the plane itself, which is safe since building lists what is
    /// there on both sides.
    #[inline(always)]
    pub(super) fn middle(&self, near: F32x4, far: F32x4, level: u32) -> F32x4 {
        let middle = near + far;
        if self.parallel == 0 { middle } else { self.beside(middle, level) }
    }

    #[cold]
    #[inline(never)]
    fn beside(&self, middle: F32x4, level: u32) -> F32x4 {
        let mut lanes = middle.to_array();
        for axis in (0..3).filter(|axis| self.parallel >> axis & 1 == 1) {
            // In cells of the deepest level from the root's lower face: its bits are the halves, level by level.
            let cells = (f64::from(self.ray.origin[axis]) + 1.0) * f64::from(1u32 << (MAX_DEPTH - 1));
            let cell = (cells as u32).min((1 << MAX_DEPTH) - 1);
            let upper = cell >> (MAX_DEPTH - 1 - level) & 1 == 1;
            lanes[axis] = if upper { f32::NEG_INFINITY } else { f32::INFINITY };
        }
        F32x4::new(lanes)
    }
}
