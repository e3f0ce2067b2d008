//! Primary rays, straight from the camera into packets.

use super::PacketTracer;
use super::packet::{LANES, Packet};
use super::surfaces::DOUBLES;
use super::walk::walk;
use super::wave::{Origin, Wave};
use crate::picture::Rect;
use crate::tracer::optics::Share;
use crate::tracer::primary::PrimaryRays;
use crate::tracer::ray::{Source, entering};
use crate::tracer::simd::lanes::{Doubles, Lanes};
use crate::tracer::simd::{Registers, Task};
use crate::tracer::vector::splat;

/// Rays that a packet is made of are from a square of so many pixels a side.
const SQUARE: usize = 4;

/// Traces the primary rays, a square of pixels at a time, and keeps those that hit something.
pub(super) struct Primaries<'t, 'a> {
    pub tracer: &'t mut PacketTracer<'a>,
    pub camera: &'t PrimaryRays,
    pub rect: Rect,
    pub wave: &'t mut Wave,
    pub primitives: &'t mut Vec<u32>,
}

impl Task for Primaries<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<R: Registers>(self) {
        let Self { tracer, camera, rect, wave, primitives: found } = self;
        let PacketTracer { bvh, slices, packet, scratch, .. } = tracer;
        packet.t_max = [f32::INFINITY; LANES];
        (0..LANES).for_each(|lane| packet.leave(lane, Source::Eye));
        for y in (0..rect.height).step_by(SQUARE) {
            for x in (0..rect.width).step_by(SQUARE) {
                let mut left = aim::<R>(camera, rect, x, y, packet);
                while left != 0 {
                    let active = packet.start::<R>(left);
                    walk::<R, false>(bvh, slices, packet, scratch);
                    left &= !active;
                    for lane in (0..LANES).filter(|lane| active >> lane & 1 == 1) {
                        if let Some(primitive) = packet.hit(lane) {
                            let pixel = (y + lane as u32 / 4) * rect.width + x + lane as u32 % 4;
                            wave.push(
                                packet.ray(lane),
                                Origin { parent: pixel, share: Share::WHOLE, bounces: 0, sheets: 0 },
                            );
                            found.push(primitive);
                        }
                    }
                }
            }
        }
    }
}

/// Makes the rays of a square's pixels; a bit for each that is in the tile and sees into the root.
#[inline(always)]
fn aim<R: Registers>(camera: &PrimaryRays, rect: Rect, x: u32, y: u32, packet: &mut Packet) -> u32 {
    let (mut xs, mut ys) = ([0.0; LANES], [0.0; LANES]);
    let mut inside = 0;
    for lane in 0..LANES {
        let (x, y) = (x + lane as u32 % 4, y + lane as u32 / 4);
        (xs[lane], ys[lane]) = (f64::from(rect.x + x), f64::from(rect.y + y));
        inside |= u32::from(x < rect.width && y < rect.height) << lane;
    }
    let mut sees = 0;
    for half in [0, DOUBLES] {
        let direction = camera.directions(R::D8::load(&xs[half..]), R::D8::load(&ys[half..]));
        let (origin, _, enters) = entering(splat(camera.eye.to_array()), direction);
        sees |= (enters & 0xff) << half;
        for axis in 0..3 {
            origin[axis].narrow(&mut packet.origin[axis][half..]);
            direction[axis].narrow(&mut packet.direction[axis][half..]);
        }
    }
    inside & sees
}
