//! What is computed once a ray.

use glam::{Vec3, Vec4, Vec4Swizzles};

use crate::database::records::MAX_DEPTH;
use crate::tracer::primitives::triangle::Shear;
use crate::tracer::ray::Ray;

pub(super) struct Prepared<'a> {
    pub ray: &'a Ray,
    pub shear: Shear,
    /// Axes along which the ray runs downward, as an octant mask.
    pub mirror: u32,
    /// Axes along which it does not run at all.
    pub parallel: u32,
    /// Ray parameters of the root's planes.
    pub near: Vec4,
    pub far: Vec4,
    pub enter: f32,
    pub leave: f32,
}

impl<'a> Prepared<'a> {
    /// `None` when the ray misses the root or is not finite.
    #[inline(always)]
    pub(super) fn new(ray: &'a Ray) -> Option<Self> {
        let (origin, direction) = (axes(ray.origin), axes(ray.direction));
        let (zero, one, infinity) = (Vec4::splat(0.0), Vec4::splat(1.0), Vec4::splat(f32::INFINITY));
        let finite = (direction.abs().cmplt(infinity) & origin.abs().cmplt(infinity)).bitmask();
        if finite & 0b111 != 0b111 {
            return None;
        }
        let inverse = one / direction;
        let (lower, upper) = ((Vec4::splat(-1.0) - origin) * inverse, (one - origin) * inverse);
        let downward = direction.cmplt(zero);
        let (mut near, mut far) = (Vec4::select(downward, upper, lower), Vec4::select(downward, lower, upper));
        // Below this, 1/d or its product with a distance would overflow; −0 is one of them.
        let is_parallel = direction.abs().cmplt(Vec4::splat(f32::MIN_POSITIVE));
        let parallel = is_parallel.bitmask() & 0b111;
        if parallel != 0 {
            let outside = !origin.abs().cmple(one).bitmask();
            // All three parallel: no direction at all.
            if parallel == 0b111 || outside & parallel != 0 {
                return None;
            }
            near = Vec4::select(is_parallel, Vec4::splat(f32::NEG_INFINITY), near);
            far = Vec4::select(is_parallel, infinity, far);
        }
        // What is not a number does not count.
        let (enter, leave) = (greatest_axis(near.max(zero)), least_axis(far.min(Vec4::splat(ray.t_max))));
        // False for what is not a number.
        if !(enter <= leave) {
            return None;
        }
        let mirror = downward.bitmask() & 0b111 & !parallel;
        Some(Self { ray, shear: Shear::new(ray), mirror, parallel, near, far, enter, leave })
    }

    /// Ray parameters of the mid planes of a cell on `level`, of half those of its other planes. Where the ray is parallel to a plane it stays on one
    /// side for ever: in the upper half if it lies in the plane itself, which is safe since building lists what is
    /// there on both sides.
    #[inline(always)]
    pub(super) fn middle(&self, near: Vec4, far: Vec4, level: u32) -> Vec4 {
        let middle = near + far;
        if self.parallel == 0 { middle } else { self.beside(middle, level) }
    }

    #[cold]
    #[inline(never)]
    fn beside(&self, middle: Vec4, level: u32) -> Vec4 {
        let mut lanes = middle.to_array();
        for axis in (0..3).filter(|axis| self.parallel >> axis & 1 == 1) {
            // In cells of the deepest level from the root's lower face: its bits are the halves, level by level.
            let cells = (f64::from(self.ray.origin[axis]) + 1.0) * f64::from(1u32 << (MAX_DEPTH - 1));
            let cell = (cells as u32).min((1 << MAX_DEPTH) - 1);
            let upper = cell >> (MAX_DEPTH - 1 - level) & 1 == 1;
            lanes[axis] = if upper { f32::NEG_INFINITY } else { f32::INFINITY };
        }
        Vec4::from_array(lanes)
    }
}

/// A vector, and zero.
#[inline(always)]
fn axes(v: [f32; 3]) -> Vec4 {
    Vec3::from_array(v).extend(0.0)
}

/// The smallest of the first three lanes, of numbers.
#[inline(always)]
pub(super) fn least_axis(v: Vec4) -> f32 {
    v.min(v.yzzw()).min(v.zyzw()).x
}

/// The largest of the first three lanes, of numbers.
#[inline(always)]
fn greatest_axis(v: Vec4) -> f32 {
    v.max(v.yzzw()).max(v.zyzw()).x
}
