//! A tile traced wave by wave: all primary rays, then all rays that their hits reflect or refract, and so on; each
//! wave's shadow rays light by light. Radiance is summed per surface in the order of the single-ray kernel, so that its
//! bits are the same.

use glam::{DVec3, Vec3};

use super::lighting::light;
use super::packet::{LANES, NONE, Packet};
use super::surfaces::{DOUBLES, Looks, Surfaces};
use super::walk::walk;
use super::{Queues, WideOctree, WideTracer};
use crate::database::Section;
use crate::database::records::Material;
use crate::database::verify::Verified;
use crate::tracer::hit::SurfacePoint;
use crate::tracer::memory_port::RayKind;
use crate::tracer::optics::refract;
use crate::tracer::primary::PrimaryRays;
use crate::tracer::ray::{Ray, Source, entering, moved_off};
use crate::tracer::simd::lanes::{Doubles, Lanes};
use crate::tracer::simd::{Registers, Simd, Task};
use crate::tracer::tile::{AovSet, Pixels, Rect};
use crate::tracer::vector::{load, normalise};
use crate::tracer::{TraceStats, View};

/// Rays that a packet is made of are from a square of so many pixels a side.
const SQUARE: usize = 4;

/// Rays of one generation.
#[derive(Debug, Default)]
struct Wave {
    rays: Vec<Ray>,
    /// By ray.
    origins: Vec<Origin>,
    radiance: Vec<Vec3>,
    queues: Queues,
}

/// What a ray adds to.
#[derive(Clone, Copy, Debug)]
struct Origin {
    /// Of the first wave a pixel of the tile, else a ray of the wave before.
    parent: u32,
    /// Share of the pixel that the ray decides, in the strongest channel.
    weight: f32,
    /// Share of the parent's radiance, by channel.
    share: Vec3,
}

impl Wave {
    fn clear(&mut self) {
        self.rays.clear();
        self.origins.clear();
        self.queues.clear();
    }

    /// Makes room, so that [`Self::push`] need not.
    fn reserve(&mut self, rays: usize) {
        self.rays.reserve(rays);
        self.origins.reserve(rays);
    }

    #[inline(always)]
    fn push(&mut self, ray: Ray, origin: Origin) {
        self.queues.push(&ray, self.rays.len() as u32);
        self.rays.push(ray);
        self.origins.push(origin);
    }
}

/// Traces tiles of one view from a whole database.
pub struct BatchTracer<'a> {
    tracer: WideTracer<'a>,
    looks: Looks<'a>,
    camera: PrimaryRays,
    /// Normalised position, linear RGB.
    lights: Vec<(DVec3, Vec3)>,
    background: Vec3,
    depth: u32,
    cutoff: f32,
    simd: Simd,
    waves: Vec<Wave>,
    primitives: Vec<u32>,
    surfaces: Surfaces,
}

impl<'a> BatchTracer<'a> {
    pub fn new(octree: &'a WideOctree, database: &'a Verified, view: &View, simd: Simd) -> Self {
        let tracer = WideTracer::new(octree, database, simd);
        let database = database.database();
        let normalisation = database.header.normalisation;
        let light = |l: &crate::scene::Light| (normalisation.point(l.position), l.colour.as_vec3());
        Self {
            tracer,
            looks: Looks {
                surfaces: database.records(Section::Surfaces),
                normals: database.records(Section::Normals),
                materials: database.records(Section::Materials),
            },
            camera: PrimaryRays::new(&database.header, view),
            lights: view.lights.iter().map(light).collect(),
            background: view.background.as_vec3(),
            depth: view.image.depth,
            cutoff: view.image.cutoff,
            simd,
            waves: Vec::new(),
            primitives: Vec::new(),
            surfaces: Surfaces::default(),
        }
    }

    pub fn counts(&self) -> super::Counts {
        self.tracer.counts()
    }

    /// Traces the pixels of `rect`.
    pub fn trace(&mut self, rect: Rect, aov: AovSet) -> (Pixels, TraceStats) {
        let mut stats = TraceStats::default();
        let mut pixels = self.start(rect, aov);
        stats.rays[RayKind::Primary as usize] += rect.pixel_count() as u64;
        let mut last = 0;
        while !self.waves[last].rays.is_empty() {
            if self.waves.len() == last + 1 {
                self.waves.push(Wave::default());
            }
            if last > 0 {
                self.find_hits(last);
            }
            self.shade(last, &mut stats);
            if last == 0 {
                self.first_hits(rect, aov, &mut pixels);
            }
            last += 1;
        }
        // From the last wave back, each ray's radiance is complete before its parent needs it.
        for wave in (1..last).rev() {
            let (before, after) = self.waves.split_at_mut(wave);
            let (parents, children) = (&mut before[wave - 1], &after[0]);
            for (origin, &radiance) in children.origins.iter().zip(&children.radiance) {
                parents.radiance[origin.parent as usize] += origin.share * radiance;
            }
        }
        let first = &self.waves[0];
        for (origin, &radiance) in first.origins.iter().zip(&first.radiance) {
            pixels.colour[origin.parent as usize] = radiance.to_array();
        }
        for colour in &mut pixels.colour {
            if !Vec3::from(*colour).is_finite() {
                stats.non_finite_pixels += 1;
                *colour = [0.0; 3];
            }
        }
        (pixels, stats)
    }

    /// Traces the primary rays; those that hit something are the first wave. The pixels as they are where nothing is hit.
    fn start(&mut self, rect: Rect, aov: AovSet) -> Pixels {
        if self.waves.is_empty() {
            self.waves.push(Wave::default());
        }
        let Self { tracer, camera, waves, primitives, simd, .. } = self;
        waves[0].clear();
        primitives.clear();
        simd.run(Primaries { tracer, camera, rect, wave: &mut waves[0], primitives });
        let count = rect.pixel_count();
        let planes = |wanted: bool| if wanted { count } else { 0 };
        Pixels {
            colour: vec![self.background.to_array(); count],
            depth: vec![-1.0; planes(aov.depth)],
            normal: vec![[0.0; 3]; planes(aov.normal)],
            primitive: vec![-1; planes(aov.primitive)],
        }
    }

    /// Finds what the rays of a wave hit.
    fn find_hits(&mut self, number: usize) {
        let wave = &self.waves[number];
        self.primitives.clear();
        self.primitives.resize(wave.rays.len(), NONE);
        self.tracer.nearest_primitives(&wave.rays, &wave.queues, &mut self.primitives);
    }

    /// Lights what a wave hits, and makes the next one.
    fn shade(&mut self, number: usize, stats: &mut TraceStats) {
        let (before, after) = self.waves.split_at_mut(number + 1);
        let (wave, next) = (&mut before[number], &mut after[0]);
        let surfaces = &mut self.surfaces;
        surfaces.take(&self.primitives, &self.looks);
        self.simd.run(Place { surfaces, rays: &wave.rays, primitives: &self.tracer.primitives, looks: &self.looks });
        stats.rays[RayKind::Shadow as usize] +=
            self.simd.run(Light { surfaces, lights: &self.lights, tracer: &mut self.tracer });
        wave.radiance.clear();
        wave.radiance.resize(wave.rays.len(), self.background);
        for (at, &ray) in surfaces.ray.iter().enumerate() {
            let [r, g, b] = &surfaces.radiance;
            wave.radiance[ray as usize] = Vec3::new(r[at], g[at], b[at]);
        }
        next.clear();
        if number < self.depth as usize {
            self.simd.run(Branch { surfaces, wave, looks: &self.looks, cutoff: self.cutoff, next, stats });
        }
    }

    /// Fills the planes besides the colour, from the surfaces of the first wave.
    fn first_hits(&self, rect: Rect, aov: AovSet, pixels: &mut Pixels) {
        if aov.is_empty() {
            return;
        }
        let surfaces = &self.surfaces;
        for at in 0..surfaces.count {
            let pixel = self.waves[0].origins[surfaces.ray[at] as usize].parent;
            let direction = self.camera.direction(rect.x + pixel % rect.width, rect.y + pixel / rect.width);
            let pixel = pixel as usize;
            let point = surfaces.point(at);
            if aov.depth {
                pixels.depth[pixel] = self.camera.depth(&point, direction);
            }
            if aov.normal {
                pixels.normal[pixel] = point.normal_to_eye(direction);
            }
            if aov.primitive {
                pixels.primitive[pixel] = surfaces.primitive[at] as i32;
            }
        }
    }
}

/// Makes the next wave: what surfaces reflect and refract.
struct Branch<'t, 'a> {
    surfaces: &'t Surfaces,
    wave: &'t Wave,
    looks: &'t Looks<'a>,
    cutoff: f32,
    next: &'t mut Wave,
    stats: &'t mut TraceStats,
}

impl Task for Branch<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<R: Registers>(self) {
        let Self { surfaces, wave, looks, cutoff, next, stats } = self;
        let mut reflected = Reflected::default();
        next.reserve(2 * surfaces.count);
        for first in (0..surfaces.count).step_by(DOUBLES) {
            let lanes = first..surfaces.count.min(first + DOUBLES);
            if lanes.clone().any(|at| surfaces.material(looks, at).is_branching()) {
                reflected.compute::<R::D8>(surfaces, first);
                for at in lanes {
                    branch(surfaces, at, &reflected, wave, looks, cutoff, next, stats);
                }
            }
        }
    }
}

/// Origins and directions of reflected rays, side by side.
#[derive(Default)]
struct Reflected {
    origin: [[f32; DOUBLES]; 3],
    direction: [[f32; DOUBLES]; 3],
}

impl Reflected {
    #[inline(always)]
    fn compute<L: Doubles>(&mut self, surfaces: &Surfaces, first: usize) {
        let direction = normalise(load::<L, _>(&surfaces.mirrored, first));
        let origin = moved_off(load(&surfaces.position, first), load(&surfaces.outward, first), direction);
        for axis in 0..3 {
            origin[axis].narrow(&mut self.origin[axis]);
            direction[axis].narrow(&mut self.direction[axis]);
        }
    }

    #[inline(always)]
    fn ray(&self, lane: usize, source: Source) -> Ray {
        Ray {
            origin: [self.origin[0][lane], self.origin[1][lane], self.origin[2][lane]],
            direction: [self.direction[0][lane], self.direction[1][lane], self.direction[2][lane]],
            t_max: f32::INFINITY,
            source,
        }
    }
}

/// Adds to the next wave what a surface reflects and refracts.
#[inline(always)]
#[expect(clippy::too_many_arguments, reason = "one step of a loop")]
fn branch(
    surfaces: &Surfaces,
    at: usize,
    reflected: &Reflected,
    wave: &Wave,
    looks: &Looks<'_>,
    cutoff: f32,
    next: &mut Wave,
    stats: &mut TraceStats,
) {
    let material = surfaces.material(looks, at);
    let parent = surfaces.ray[at];
    let weight = wave.origins[parent as usize].weight;
    let mut reflection = Vec3::from(material.reflection);
    let mut refracted = None;
    if material.transmittance > 0.0 {
        let point = surfaces.point(at);
        let normal = DVec3::new(surfaces.normal[0][at], surfaces.normal[1][at], surfaces.normal[2][at]);
        let direction = refract(material, point.normal, normal, wave.rays[parent as usize].direction_f64());
        if direction.is_none() {
            // Total internal reflection: what cannot leave is reflected.
            reflection += material.transmittance;
        }
        refracted = direction.map(|direction| {
            Ray::leaving(point.position, point.normal, direction.normalize(), f32::INFINITY, point.source)
        });
    }
    let origin = |share: Vec3| Origin { parent, weight: weight * share.max_element(), share };
    let reflection = origin(reflection);
    if reflection.weight > cutoff {
        stats.rays[RayKind::Reflection as usize] += 1;
        next.push(reflected.ray(at % DOUBLES, surfaces.source[at]), reflection);
    }
    let refraction = origin(Vec3::splat(material.transmittance));
    if let Some(ray) = refracted
        && refraction.weight > cutoff
    {
        stats.rays[RayKind::Refraction as usize] += 1;
        next.push(ray, refraction);
    }
}

impl Surfaces {
    #[inline(always)]
    fn material<'a>(&self, looks: &Looks<'a>, at: usize) -> &'a Material {
        &looks.materials[self.material[at] as usize]
    }

    fn point(&self, at: usize) -> SurfacePoint {
        SurfacePoint {
            position: DVec3::new(self.position[0][at], self.position[1][at], self.position[2][at]),
            normal: DVec3::new(self.outward[0][at], self.outward[1][at], self.outward[2][at]),
            source: self.source[at],
        }
    }
}

/// Traces the primary rays, a square of pixels at a time, and keeps those that hit something.
struct Primaries<'t, 'a> {
    tracer: &'t mut WideTracer<'a>,
    camera: &'t PrimaryRays,
    rect: Rect,
    wave: &'t mut Wave,
    primitives: &'t mut Vec<u32>,
}

impl Task for Primaries<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<R: Registers>(self) {
        let Self { tracer, camera, rect, wave, primitives: found } = self;
        let WideTracer { octree, primitives, packet, scratch, .. } = tracer;
        packet.t_max = [f32::INFINITY; LANES];
        (0..LANES).for_each(|lane| packet.leave(lane, Source::Eye));
        for y in (0..rect.height).step_by(SQUARE) {
            for x in (0..rect.width).step_by(SQUARE) {
                let mut left = aim::<R>(camera, rect, x, y, packet);
                while left != 0 {
                    let active = packet.start::<R>(left);
                    walk::<R, false>(octree, primitives, packet, scratch);
                    left &= !active;
                    for lane in (0..LANES).filter(|lane| active >> lane & 1 == 1) {
                        if let Some(primitive) = packet.hit(lane) {
                            let pixel = (y + lane as u32 / 4) * rect.width + x + lane as u32 % 4;
                            wave.push(packet.ray(lane), Origin { parent: pixel, weight: 1.0, share: Vec3::ONE });
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
        let (origin, _, enters) = entering(camera.eye.to_array(), direction);
        sees |= (enters & 0xff) << half;
        for axis in 0..3 {
            origin[axis].narrow(&mut packet.origin[axis][half..]);
            direction[axis].narrow(&mut packet.direction[axis][half..]);
        }
    }
    inside & sees
}

struct Place<'t, 'a> {
    surfaces: &'t mut Surfaces,
    rays: &'t [Ray],
    primitives: &'t super::primitives::Primitives<'a>,
    looks: &'t Looks<'a>,
}

impl Task for Place<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<R: Registers>(self) {
        self.surfaces.place::<R>(self.rays, self.primitives, self.looks);
    }
}

struct Light<'t, 'a> {
    surfaces: &'t mut Surfaces,
    lights: &'t [(DVec3, Vec3)],
    tracer: &'t mut WideTracer<'a>,
}

impl Task for Light<'_, '_> {
    type Output = u64;

    #[inline(always)]
    fn run<R: Registers>(self) -> u64 {
        let WideTracer { octree, primitives, packet, scratch, .. } = self.tracer;
        light::<R>(self.surfaces, self.lights, octree, primitives, packet, scratch)
    }
}
