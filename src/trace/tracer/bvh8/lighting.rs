//! Light on a wave's surfaces, sixteen at a time: for each light a packet of shadow rays, and what comes through.

use glam::{DVec3, Vec3};

use super::PacketTracer;
use super::packet::{LANES, Packet};
use super::surfaces::{DOUBLES, Surfaces};
use super::walk::walk;
use crate::tracer::TraceStats;
use crate::tracer::memory_port::RayKind;
use crate::tracer::octree::hero::Hero;
use crate::tracer::optics::{Cosines, Finish, aim, brighten};
use crate::tracer::shade::through_sheets;
use crate::tracer::simd::Registers;
use crate::tracer::simd::lanes::Doubles;
use crate::tracer::slices::Slices;
use crate::tracer::vector::{load, store};
use crate::tracer::view::Illumination;

/// Casts rays to every light from each surface that is turned to it, and adds what comes through. How many rays.
#[inline(always)]
pub(super) fn light<R: Registers>(
    surfaces: &mut Surfaces,
    illumination: &Illumination,
    tracer: &mut PacketTracer<'_>,
) -> u64 {
    let PacketTracer { bvh, slices, packet, scratch, hero, .. } = tracer;
    let mut cosines = Cosines { normal: [0.0; LANES], mirrored: [0.0; LANES] };
    let mut rays = 0;
    for first in (0..surfaces.count).step_by(LANES) {
        for lane in 0..LANES {
            packet.leave(lane, surfaces.source[first + lane]);
        }
        for &(position, colour) in &illumination.lights {
            let lanes = (1u32 << LANES.min(surfaces.count - first)) - 1;
            let (turned_to, meets_root) = aim_all::<R>(surfaces, first, position, packet, &mut cosines);
            let turned_to = turned_to & lanes;
            rays += u64::from(turned_to.count_ones());
            let mut lit = turned_to & !meets_root;
            let mut left = turned_to & meets_root;
            while left != 0 {
                let active = packet.start::<R>(left);
                walk::<R, true>(bvh, slices, packet, scratch);
                lit |= packet.active;
                left &= !active;
            }
            brighten_all::<R>(surfaces, first, colour, &cosines, lit);
            if illumination.has_sheets {
                rays += light_through_sheets(surfaces, first, colour, &cosines, turned_to & !lit, packet, hero, slices);
            }
        }
    }
    rays
}

/// Adds what comes to these lanes through sheets that let a light's rays pass, as the single-ray kernel does. How many rays go on.
#[cold]
#[inline(never)]
#[expect(clippy::too_many_arguments, reason = "parts of one tracer, and the lanes' surfaces and rays")]
fn light_through_sheets(
    surfaces: &mut Surfaces,
    first: usize,
    colour: Vec3,
    cosines: &Cosines<[f32; LANES]>,
    mut blocked: u32,
    packet: &Packet,
    hero: &mut Hero,
    slices: &mut Slices<'_>,
) -> u64 {
    let mut stats = TraceStats::default();
    while blocked != 0 {
        let lane = blocked.trailing_zeros() as usize;
        blocked &= blocked - 1;
        let Ok(share) = through_sheets(hero, slices, packet.ray(lane), &mut stats);
        if share > 0.0 {
            let at = first + lane;
            let row = |rows: &[Vec<f32>; 3]| [rows[0][at], rows[1][at], rows[2][at]];
            let finish = Finish {
                diffuse: row(&surfaces.diffuse),
                highlight: row(&surfaces.highlight),
                shine: &surfaces.shine[at..],
            };
            let cosines = Cosines { normal: &cosines.normal[lane..], mirrored: &cosines.mirrored[lane..] };
            let brighter = brighten::<f32, f64>(row(&surfaces.radiance), colour * share, &finish, cosines, 1);
            for (row, channel) in surfaces.radiance.iter_mut().zip(brighter) {
                row[at] = channel;
            }
        }
    }
    stats.rays[RayKind::Shadow as usize]
}

/// Makes rays to the light; a bit for each that leaves to the side that the normal is on, and for each that meets the root.
#[inline(always)]
fn aim_all<R: Registers>(
    surfaces: &Surfaces,
    first: usize,
    light: DVec3,
    packet: &mut Packet,
    cosines: &mut Cosines<[f32; LANES]>,
) -> (u32, u32) {
    let (mut turned_to, mut meets_root) = (0, 0);
    for half in [0, DOUBLES] {
        let at = first + half;
        let (point, outward) = (load::<R::D8, _>(&surfaces.position, at), load(&surfaces.outward, at));
        let from = surfaces.is_round().then(|| load(&surfaces.rounded, at));
        let to_light = aim(light, point, from, outward, load(&surfaces.normal, at), load(&surfaces.mirrored, at));
        turned_to |= (to_light.turned_to & 0xff) << half;
        meets_root |= (to_light.meets_root & 0xff) << half;
        to_light.cosines.normal.narrow(&mut cosines.normal[half..]);
        to_light.cosines.mirrored.narrow(&mut cosines.mirrored[half..]);
        for axis in 0..3 {
            to_light.origin[axis].narrow(&mut packet.origin[axis][half..]);
            to_light.direction[axis].narrow(&mut packet.direction[axis][half..]);
        }
        to_light.distance.narrow(&mut packet.t_max[half..]);
    }
    (turned_to, meets_root)
}

/// Adds what a light of this colour brings to the surfaces of the `lit` lanes.
#[inline(always)]
fn brighten_all<R: Registers>(
    surfaces: &mut Surfaces,
    first: usize,
    colour: Vec3,
    cosines: &Cosines<[f32; LANES]>,
    lit: u32,
) {
    for half in [0, DOUBLES] {
        let lit = lit >> half & 0xff;
        if lit == 0 {
            continue;
        }
        let at = first + half;
        let finish = Finish {
            diffuse: load(&surfaces.diffuse, at),
            highlight: load(&surfaces.highlight, at),
            shine: &surfaces.shine[at..],
        };
        let cosines = Cosines { normal: &cosines.normal[half..], mirrored: &cosines.mirrored[half..] };
        let radiance = load(&surfaces.radiance, at);
        let brighter = brighten::<R::F8, R::D8>(radiance, colour, &finish, cosines, lit);
        store(brighter, &mut surfaces.radiance, at);
    }
}
