//! Packets through the hierarchy, front to back: a branch's children are first held against what all rays lie within,
//! then against each ray; where few rays are left they go on one by one, with the children side by side instead.

use super::build::LEVELS;
use super::packet::{LANES, Packet};
use super::tree::{Block, Branch, Bvh8, Child};
use super::triangles::{Rays, Rows, Triangles, vertex};
use crate::database::records::PrimitiveId;
use crate::tracer::simd::Registers;
use crate::tracer::simd::lanes::{Lanes, Singles};
use crate::tracer::slices::Slices;
use crate::tracer::vector::{dot, scale, splat, sub};

/// Ray parameters of planes are off by 3·2⁻²⁴ of themselves; this is more than twice as much, for either side.
const SLACK: f32 = 1.0 + 16.0 / (1 << 24) as f32;

/// A triangle's box, computed in f32, is wider by this.
const MARGIN: f32 = 1.0 / (1 << 23) as f32;

/// At most so many rays go on one by one.
const FEW: u32 = 2;

/// Seven children of every level wait at most, and the root: the hierarchy is no deeper than the codes that it is built from. So
/// `waiting < STACK` below always holds; it spares a check that could panic.
const STACK: usize = 7 * LEVELS as usize + 8;

#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Waiting {
    enter: [f32; LANES],
    child: Child,
    mask: u32,
}

#[derive(Clone, Copy)]
struct WaitingOne {
    enter: f32,
    child: Child,
}

/// What a walk needs besides the packet; kept from packet to packet.
pub(super) struct Scratch {
    stack: Box<[Waiting; STACK]>,
    stack_of_one: Box<[WaitingOne; STACK]>,
    rows: Rows,
    pub counts: Visits,
}

/// What walks did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Visits {
    pub packets: u64,
    /// Branches that a packet was held against, and a single ray.
    pub packet_branches: u64,
    pub single_branches: u64,
    pub packet_leaves: u64,
    pub single_leaves: u64,
    /// Tests of a triangle against 16 rays, or of a ray against up to 16 triangles.
    pub tests: u64,
    /// Hits whose order was decided exactly on the way.
    pub contended: u64,
}

impl Scratch {
    pub(super) fn new() -> Self {
        let nothing = Waiting { enter: [0.0; LANES], child: Child::EMPTY, mask: 0 };
        Self {
            stack: Box::new([nothing; STACK]),
            stack_of_one: Box::new([WaitingOne { enter: 0.0, child: Child::EMPTY }; STACK]),
            rows: Rows::ZERO,
            counts: Visits::default(),
        }
    }
}

/// Octants in the order in which rays that run downward along the axes of `mirror` meet them: `ORDER[mirror][bits]` is
/// `bits` with each octant o moved to o ^ mirror.
static ORDER: [[u8; 256]; 8] = {
    let mut order = [[0; 256]; 8];
    let mut mirror = 0;
    while mirror < 8 {
        let mut bits = 0;
        while bits < 256 {
            let mut octant = 0;
            while octant < 8 {
                order[mirror][bits] |= ((bits >> octant & 1) << (octant ^ mirror)) as u8;
                octant += 1;
            }
            bits += 1;
        }
        mirror += 1;
    }
    order
};

/// The planes that rays of this octant meet first along each axis, and last.
#[inline(always)]
fn sides(mirror: usize) -> [(usize, usize); 3] {
    let side = |axis: usize| if mirror >> axis & 1 == 1 { (axis + 3, axis) } else { (axis, axis + 3) };
    [side(0), side(1), side(2)]
}

/// Finds the nearest hit of every ray of the packet, or, if `ANY`, leaves active those that hit nothing.
#[inline(always)]
pub(super) fn walk<R: Registers, const ANY: bool>(
    bvh: &Bvh8,
    slices: &Slices<'_>,
    packet: &mut Packet,
    scratch: &mut Scratch,
) {
    scratch.counts.packets += 1;
    if bvh.root == Child::EMPTY {
        return;
    }
    scratch.stack[0] = Waiting { enter: [0.0; LANES], child: bvh.root, mask: packet.active };
    let mut waiting = 1;
    let sides = sides(packet.mirror);
    while waiting > 0 {
        waiting -= 1;
        let next = &scratch.stack[waiting];
        let child = next.child;
        let mask = if ANY {
            next.mask & packet.active
        } else {
            let far = R::F16::load(&packet.far).mul(R::F16::splat(SLACK));
            next.mask & R::F16::load(&next.enter).le(far)
        };
        if mask.count_ones() <= FEW {
            let mut rest = mask;
            while rest != 0 {
                let lane = rest.trailing_zeros() as usize;
                rest &= rest - 1;
                walk_one::<R, ANY>(bvh, slices, packet, lane, child, scratch);
            }
        } else if child.is_leaf() {
            scratch.counts.packet_leaves += 1;
            let (blocks, curved) = bvh.leaf(child);
            for block in blocks {
                test_block::<R, ANY>(&block, slices, packet, mask, scratch);
            }
            for &id in curved {
                let mask = near_sphere::<R::F16>(slices, id, &packet.rays(), R::F16::load(&packet.far), mask);
                if mask != 0 {
                    slices.test_curved::<ANY>(packet, mask, id);
                }
            }
        } else {
            scratch.counts.packet_branches += 1;
            let branch = bvh.branch(child);
            let met = met_by_any::<R>(branch, packet, &sides);
            let mut order = u32::from(ORDER[packet.mirror][met as usize]);
            // The farthest first: the nearest comes off the stack before it.
            while order != 0 {
                let last = 31 - order.leading_zeros();
                order ^= 1 << last;
                let octant = last as usize ^ packet.mirror;
                let (enter, met) = meet::<R>(branch, octant, packet, &sides);
                debug_assert!(waiting < STACK, "the hierarchy is deeper than its codes");
                if met & mask != 0 && waiting < STACK {
                    let entry = &mut scratch.stack[waiting];
                    enter.store(&mut entry.enter);
                    (entry.child, entry.mask) = (branch.children[octant], met & mask);
                    waiting += 1;
                    bvh.prefetch(branch.children[octant]);
                }
            }
        }
        if ANY && packet.active == 0 {
            return;
        }
    }
}

/// The children that any ray between those of the packet may meet.
#[inline(always)]
fn met_by_any<R: Registers>(branch: &Branch, packet: &Packet, sides: &[(usize, usize); 3]) -> u32 {
    let around = &packet.around;
    let (mut enter, mut leave) = (R::F8::splat(0.0), R::F8::splat(f32::INFINITY));
    for axis in 0..3 {
        let near = R::F8::load(&branch.planes[sides[axis].0]).sub(R::F8::splat(around.near_origin[axis]));
        let far = R::F8::load(&branch.planes[sides[axis].1]).sub(R::F8::splat(around.far_origin[axis]));
        let (least, most) = (R::F8::splat(around.least_inverse[axis]), R::F8::splat(around.most_inverse[axis]));
        enter = enter.max(near.mul(least).min(near.mul(most)));
        leave = leave.min(far.mul(least).max(far.mul(most)));
    }
    enter.le(leave.mul(R::F8::splat(SLACK)))
}

/// Where each ray of the packet enters a child, and which do.
#[inline(always)]
fn meet<R: Registers>(branch: &Branch, octant: usize, packet: &Packet, sides: &[(usize, usize); 3]) -> (R::F16, u32) {
    let octant = octant & 7;
    let (mut enter, mut leave) = (R::F16::splat(0.0), R::F16::load(&packet.far));
    for axis in 0..3 {
        let origin = R::F16::load(&packet.origin[axis]);
        let inverse = R::F16::load(&packet.inverse[axis]);
        let near = R::F16::splat(branch.planes[sides[axis].0][octant]).sub(origin).mul(inverse);
        let far = R::F16::splat(branch.planes[sides[axis].1][octant]).sub(origin).mul(inverse);
        enter = enter.max(near);
        leave = leave.min(far);
    }
    (enter, enter.le(leave.mul(R::F16::splat(SLACK))))
}

/// A block of a leaf against the rays of `mask`.
#[inline(always)]
fn test_block<R: Registers, const ANY: bool>(
    block: &Block<'_>,
    slices: &Slices<'_>,
    packet: &mut Packet,
    mask: u32,
    scratch: &mut Scratch,
) {
    let mut which = near_any::<R>(block, packet) & ((1u32 << block.count) - 1);
    if which == 0 {
        return;
    }
    let triangles = Triangles::<R::F16>::of_block(block);
    if which.count_ones() <= mask.count_ones() {
        triangles.store(&mut scratch.rows);
        while which != 0 {
            let at = which.trailing_zeros() as usize;
            which &= which - 1;
            scratch.counts.tests += 1;
            test_one::<R, ANY>(block, at, slices, packet, mask, scratch);
        }
    } else {
        let mut rest = if ANY { mask & packet.active } else { mask };
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            scratch.counts.tests += 1;
            test_lane::<R::F16, ANY>(&triangles, block, which, slices, packet, lane, scratch);
        }
    }
}

/// The triangles of a block whose boxes any ray between those of the packet may meet.
#[inline(always)]
fn near_any<R: Registers>(block: &Block<'_>, packet: &Packet) -> u32 {
    let around = &packet.around;
    let (a, b, c) = (vertex::<R::F16>(block, 0), vertex::<R::F16>(block, 1), vertex::<R::F16>(block, 2));
    let (mut enter, mut leave) = (R::F16::splat(0.0), R::F16::splat(f32::INFINITY));
    for axis in 0..3 {
        let lower = a[axis].min(b[axis]).min(c[axis]).sub(R::F16::splat(MARGIN));
        let upper = a[axis].max(b[axis]).max(c[axis]).add(R::F16::splat(MARGIN));
        let (near, far) = if packet.mirror >> axis & 1 == 1 { (upper, lower) } else { (lower, upper) };
        let near = near.sub(R::F16::splat(around.near_origin[axis]));
        let far = far.sub(R::F16::splat(around.far_origin[axis]));
        let (least, most) = (R::F16::splat(around.least_inverse[axis]), R::F16::splat(around.most_inverse[axis]));
        enter = enter.max(near.mul(least).min(near.mul(most)));
        leave = leave.min(far.mul(least).max(far.mul(most)));
    }
    enter.le(leave.mul(R::F16::splat(SLACK)))
}

/// The rays of `mask` that a sphere is not surely missed by; all, if it is a cone.
///
/// In f32, with a slack of four times what a distance from the ray is off by: the origin's from the centre is at most
/// 2√3, and there are seven roundings of 2⁻²⁴ of it.
#[inline(always)]
fn near_sphere<L: Singles>(slices: &Slices<'_>, id: u32, rays: &Rays<L>, far: L, mask: u32) -> u32 {
    const SLACK: f32 = 1.0 / (1 << 16) as f32;
    let Some(sphere) = slices.primitives.sphere(PrimitiveId(id)) else { return mask };
    let to_centre = sub(splat(sphere.centre), rays.origin);
    // Directions are no longer than 1: so are distances along them no shorter in units of the ray parameter.
    let inverse_square = L::splat(1.0).div(dot(rays.direction, rays.direction));
    let along = dot(to_centre, rays.direction).mul(inverse_square);
    let beside = sub(to_centre, scale(rays.direction, along));
    let reach = L::splat(sphere.radius.abs() + SLACK);
    let reach_along = reach.mul(inverse_square);
    let behind = along.add(reach_along).lt(L::splat(0.0));
    let beyond = far.lt(along.sub(reach_along));
    mask & dot(beside, beside).le(reach.mul(reach)) & !(behind | beyond)
}

/// One triangle against the rays of `mask`.
#[inline(always)]
fn test_one<R: Registers, const ANY: bool>(
    block: &Block<'_>,
    at: usize,
    slices: &Slices<'_>,
    packet: &mut Packet,
    mask: u32,
    scratch: &mut Scratch,
) {
    let triangle = Triangles::<R::F16>::one_of(&scratch.rows, at);
    let rays = packet.rays();
    let mask = if ANY { mask & packet.active } else { mask };
    let far = R::F16::load(&packet.far);
    let Some(tested) = triangle.test(&rays, mask, far) else { return };
    let id = block.id(at);
    let leaving = R::F16::load(&packet.polygon).differ(R::F16::splat(f32::from_bits(block.polygon(at))));
    let mut contended = tested.possible & leaving;
    if ANY {
        let occluded = tested.before(far) & leaving;
        packet.active &= !occluded;
        contended &= !occluded;
    } else {
        let here = R::F16::splat(f32::from_bits(id));
        let primitive = R::F16::load(&packet.primitive);
        contended &= primitive.differ(here);
        if contended == 0 {
            return;
        }
        let (least, most) = tested.between();
        let (least_so_far, certain) = (R::F16::load(&packet.least), tested.certain & contended);
        let nearer = certain & most.lt(least_so_far);
        let farther = certain & far.lt(least);
        least.select(nearer, least_so_far).store(&mut packet.least);
        most.select(nearer, far).store(&mut packet.far);
        here.select(nearer, primitive).store(&mut packet.primitive);
        packet.exact &= !nearer;
        contended &= !(nearer | farther);
    }
    while contended != 0 {
        let lane = contended.trailing_zeros() as usize;
        contended &= contended - 1;
        scratch.counts.contended += 1;
        slices.contend::<ANY>(packet, lane, id);
    }
}

/// One ray against the triangles of `which`.
#[inline(always)]
fn test_lane<L: Singles, const ANY: bool>(
    triangles: &Triangles<L>,
    block: &Block<'_>,
    which: u32,
    slices: &Slices<'_>,
    packet: &mut Packet,
    lane: usize,
    scratch: &mut Scratch,
) {
    let rays = packet.one_ray(lane);
    let far = L::splat(packet.far[lane]);
    let Some(tested) = triangles.test(&rays, which, far) else { return };
    let leaving = L::load(block.polygons()).differ(L::splat(packet.polygon[lane]));
    let mut possible = tested.possible & leaving;
    if possible == 0 {
        return;
    }
    if ANY {
        if tested.before(far) & leaving != 0 {
            packet.active &= !(1 << lane);
            return;
        }
        while possible != 0 {
            let at = possible.trailing_zeros() as usize;
            possible &= possible - 1;
            scratch.counts.contended += 1;
            slices.contend::<ANY>(packet, lane, block.id(at));
        }
        return;
    }
    let (mut least, mut most) = ([0.0; LANES], [0.0; LANES]);
    let between = tested.between();
    between.0.store(&mut least[..L::N]);
    between.1.store(&mut most[..L::N]);
    while possible != 0 {
        let at = possible.trailing_zeros() as usize & 15;
        possible &= possible - 1;
        let id = block.id(at);
        if packet.primitive[lane].to_bits() == id {
            continue;
        }
        let certain = tested.certain >> at & 1 == 1;
        if certain && most[at] < packet.least[lane] {
            packet.set_hit(lane, id, least[at], most[at], false);
        } else if !(certain && packet.far[lane] < least[at]) {
            scratch.counts.contended += 1;
            slices.contend::<ANY>(packet, lane, id);
        }
    }
}

/// One ray from `child` on.
#[inline(always)]
fn walk_one<R: Registers, const ANY: bool>(
    bvh: &Bvh8,
    slices: &Slices<'_>,
    packet: &mut Packet,
    lane: usize,
    child: Child,
    scratch: &mut Scratch,
) {
    let lane = lane & (LANES - 1);
    let sides = sides(packet.mirror);
    let origin = [packet.origin[0][lane], packet.origin[1][lane], packet.origin[2][lane]];
    let inverse = [packet.inverse[0][lane], packet.inverse[1][lane], packet.inverse[2][lane]];
    let mut waiting = 0;
    let mut child = child;
    loop {
        if child.is_leaf() {
            scratch.counts.single_leaves += 1;
            let (blocks, curved) = bvh.leaf(child);
            for block in blocks {
                let which = (1u32 << block.count) - 1;
                scratch.counts.tests += 1;
                if block.count <= 8 {
                    let triangles = Triangles::<R::F8>::of_block(&block);
                    test_lane::<R::F8, ANY>(&triangles, &block, which, slices, packet, lane, scratch);
                } else {
                    let triangles = Triangles::<R::F16>::of_block(&block);
                    test_lane::<R::F16, ANY>(&triangles, &block, which, slices, packet, lane, scratch);
                }
            }
            for &id in curved {
                if near_sphere::<f32>(slices, id, &packet.one_ray(lane), packet.far[lane], 1) != 0 {
                    slices.test_curved::<ANY>(packet, 1 << lane, id);
                }
            }
            if ANY && packet.active >> lane & 1 == 0 {
                return;
            }
        } else {
            scratch.counts.single_branches += 1;
            let branch = bvh.branch(child);
            let (mut enter, mut leave) = (R::F8::splat(0.0), R::F8::splat(packet.far[lane]));
            for axis in 0..3 {
                let (o, i) = (R::F8::splat(origin[axis]), R::F8::splat(inverse[axis]));
                enter = enter.max(R::F8::load(&branch.planes[sides[axis].0]).sub(o).mul(i));
                leave = leave.min(R::F8::load(&branch.planes[sides[axis].1]).sub(o).mul(i));
            }
            let met = enter.le(leave.mul(R::F8::splat(SLACK)));
            let mut enters = [0.0; 8];
            enter.store(&mut enters);
            let mut order = u32::from(ORDER[packet.mirror & 7][met as usize & 255]);
            while order != 0 && waiting < STACK {
                let last = 31 - order.leading_zeros();
                order ^= 1 << last;
                let octant = (last as usize ^ packet.mirror) & 7;
                scratch.stack_of_one[waiting] = WaitingOne { enter: enters[octant], child: branch.children[octant] };
                waiting += 1;
            }
        }
        // The next one that is not beyond what was hit since.
        loop {
            if waiting == 0 {
                return;
            }
            waiting -= 1;
            let next = scratch.stack_of_one[waiting];
            if next.enter <= packet.far[lane] * SLACK {
                child = next.child;
                break;
            }
        }
    }
}
