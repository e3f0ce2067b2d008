//! Sixteen rays that run into the same octant, and what is known of their nearest hits.

use crate::tracer::ray::{Ray, Source};
use crate::tracer::simd::lanes::{Lanes, Singles};
use crate::tracer::vector::{load, splat};

use super::triangles::Rays;
use crate::tracer::simd::Registers;

/// Rays of a packet.
pub(super) const LANES: usize = 16;

/// A lane without a hit.
pub(super) const NONE: u32 = u32::MAX;

/// Largest reciprocal of a direction's component: a ray parallel to a plane gets this one, so that nothing is
/// infinite. Within the root such a ray strays by 2⁻⁹⁸.
const INVERSE_MAX: f32 = (1u128 << 100) as f32;

#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(super) struct Packet {
    pub origin: [[f32; LANES]; 3],
    pub direction: [[f32; LANES]; 3],
    pub inverse: [[f32; LANES]; 3],
    /// Between what the ray parameter of the nearest hit is so far, `t_max` where there is none.
    pub least: [f32; LANES],
    pub far: [f32; LANES],
    /// Bits of the nearest hit's id, [`NONE`] where there is none.
    pub primitive: [f32; LANES],
    /// Bits of the polygon that the ray leaves from, which it cannot hit.
    pub polygon: [f32; LANES],
    pub t_max: [f32; LANES],
    pub source: [Source; LANES],
    /// Lanes that hold a ray, whose answer is not known yet.
    pub active: u32,
    /// Lanes whose nearest hit's `t` is known exactly.
    pub exact: u32,
    /// Axes along which the rays run downward, as an octant mask.
    pub mirror: usize,
    pub around: Around,
}

/// What all rays of a packet lie within, by axis; "near" and "far" as the rays see a box's planes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Around {
    pub near_origin: [f32; 3],
    pub far_origin: [f32; 3],
    pub least_inverse: [f32; 3],
    pub most_inverse: [f32; 3],
}

impl Packet {
    pub(super) fn new() -> Self {
        Self {
            origin: [[0.0; LANES]; 3],
            direction: [[0.0; LANES]; 3],
            inverse: [[0.0; LANES]; 3],
            least: [0.0; LANES],
            far: [0.0; LANES],
            primitive: [0.0; LANES],
            polygon: [0.0; LANES],
            t_max: [0.0; LANES],
            source: [Source::Eye; LANES],
            active: 0,
            exact: 0,
            mirror: 0,
            around: Around::default(),
        }
    }

    /// The octant a ray runs into; `None` for one that packets are not made for: its direction longer than 1 or shorter
    /// than some 0.4, not from within the root, without a range, or not finite.
    #[inline(always)]
    pub(super) fn octant(ray: &Ray) -> Option<usize> {
        let ([x, y, z], [ox, oy, oz]) = (ray.direction, ray.origin);
        let square = x * x + y * y + z * z;
        let usual =
            square > 0.2 && square < 1.01 && ox.abs() <= 1.0 && oy.abs() <= 1.0 && oz.abs() <= 1.0 && ray.t_max > 0.0;
        usual.then_some(usize::from(x < 0.0) | usize::from(y < 0.0) << 1 | usize::from(z < 0.0) << 2)
    }

    /// Takes up to [`LANES`] rays, at least one, all of one octant, and makes ready for a walk.
    #[inline(always)]
    pub(super) fn fill<R: Registers>(&mut self, rays: &[Ray], indices: &[u32]) {
        for (lane, &index) in indices.iter().enumerate() {
            let ray = &rays[index as usize];
            for axis in 0..3 {
                self.origin[axis][lane] = ray.origin[axis];
                self.direction[axis][lane] = ray.direction[axis];
            }
            self.t_max[lane] = ray.t_max;
            self.leave(lane, ray.source);
        }
        self.start::<R>((1u32 << indices.len()) - 1);
    }

    /// What a lane's ray leaves from.
    #[inline(always)]
    pub(super) fn leave(&mut self, lane: usize, source: Source) {
        self.source[lane] = source;
        self.polygon[lane] = f32::from_bits(if let Source::Polygon(polygon) = source { polygon } else { u32::MAX });
    }

    /// Makes ready for a walk with those of `lanes`, at least one, that run into the octant of the first: they are
    /// active then. Origins, directions, ranges and sources are there.
    #[inline(always)]
    pub(super) fn start<R: Registers>(&mut self, lanes: u32) -> u32 {
        let first = lanes.trailing_zeros() as usize & (LANES - 1);
        let (mut active, mut mirror) = (lanes, 0);
        for axis in 0..3 {
            let downward = R::F16::load(&self.direction[axis]).lt(R::F16::splat(0.0));
            let here = downward >> first & 1;
            mirror |= (here as usize) << axis;
            active &= if here == 1 { downward } else { !downward };
        }
        (self.least, self.far) = (self.t_max, self.t_max);
        self.primitive = [f32::from_bits(NONE); LANES];
        (self.active, self.exact, self.mirror) = (active, 0, mirror);
        for axis in 0..3 {
            // −0 as +0; lanes that are not active do as the first one.
            let direction = R::F16::load(&self.direction[axis]).add(R::F16::splat(0.0));
            let inverse = R::F16::splat(1.0).div(direction);
            let inverse = inverse.min(R::F16::splat(INVERSE_MAX)).max(R::F16::splat(-INVERSE_MAX));
            inverse.store(&mut self.inverse[axis]);
            let inverse = inverse.select(active, R::F16::splat(self.inverse[axis][first]));
            let origin = R::F16::load(&self.origin[axis]).select(active, R::F16::splat(self.origin[axis][first]));
            let (least, most) = (origin.least(), origin.most());
            let downward = mirror >> axis & 1 == 1;
            let around = &mut self.around;
            (around.near_origin[axis], around.far_origin[axis]) = if downward { (least, most) } else { (most, least) };
            (around.least_inverse[axis], around.most_inverse[axis]) = (inverse.least(), inverse.most());
        }
        active
    }

    /// All rays.
    #[inline(always)]
    pub(super) fn rays<L: Singles>(&self) -> Rays<L> {
        Rays { origin: load(&self.origin, 0), direction: load(&self.direction, 0) }
    }

    /// A lane's ray, many times.
    #[inline(always)]
    pub(super) fn one_ray<L: Singles>(&self, lane: usize) -> Rays<L> {
        let (o, d) = (&self.origin, &self.direction);
        let lane = lane & (LANES - 1);
        Rays {
            origin: splat([o[0][lane], o[1][lane], o[2][lane]]),
            direction: splat([d[0][lane], d[1][lane], d[2][lane]]),
        }
    }

    /// A lane's ray.
    pub(super) fn ray(&self, lane: usize) -> Ray {
        Ray {
            origin: [0, 1, 2].map(|axis| self.origin[axis][lane]),
            direction: [0, 1, 2].map(|axis| self.direction[axis][lane]),
            t_max: self.t_max[lane],
            source: self.source[lane],
        }
    }

    /// The nearest hit's primitive.
    #[inline(always)]
    pub(super) fn hit(&self, lane: usize) -> Option<u32> {
        let primitive = self.primitive[lane].to_bits();
        (primitive != NONE).then_some(primitive)
    }

    #[inline(always)]
    pub(super) fn set_hit(&mut self, lane: usize, primitive: u32, least: f32, most: f32, exact: bool) {
        self.primitive[lane] = f32::from_bits(primitive);
        (self.least[lane], self.far[lane]) = (least, most);
        self.exact = self.exact & !(1 << lane) | u32::from(exact) << lane;
    }
}
