//! A tile traced wave by wave: all primary rays, then all rays that their hits reflect or refract, and so on; each
//! wave's shadow rays light by light. Radiance is summed per surface in the order of the single-ray kernel, so that its
//! bits are the same.

use glam::{DVec3, Vec3};

use super::lighting::light;
use super::packet::NONE;
use super::surfaces::{DOUBLES, Looks, Surfaces};
use super::{WideOctree, WideTracer};
use crate::database::Section;
use crate::database::verify::Verified;
use crate::tracer::hit::SurfacePoint;
use crate::tracer::memory_port::RayKind;
use crate::tracer::primary::PrimaryRays;
use crate::tracer::ray::{Ray, Source, entering};
use crate::tracer::shade::refract;
use crate::tracer::simd::lanes::{Doubles, Lanes};
use crate::tracer::simd::{Registers, Simd, Task};
use crate::tracer::tile::{AovSet, Pixels, Rect};
use crate::tracer::{TraceStats, View};

/// Rays that a packet is made of are from a square of so many pixels a side.
const SQUARE: u32 = 4;

/// Rays of one generation.
#[derive(Debug, Default)]
struct Wave {
    rays: Vec<Ray>,
    /// By ray, what it adds to: of the first wave a pixel of the tile, else a ray of the wave before.
    parent: Vec<u32>,
    /// Share of the parent's radiance, by channel.
    share: Vec<Vec3>,
    /// Share of the pixel that the ray decides, in the strongest channel.
    weight: Vec<f32>,
    radiance: Vec<Vec3>,
}

impl Wave {
    fn clear(&mut self) {
        self.rays.clear();
        self.parent.clear();
        self.share.clear();
        self.weight.clear();
    }

    #[inline(always)]
    fn push(&mut self, ray: Ray, parent: u32, share: Vec3, weight: f32) {
        self.rays.push(ray);
        self.parent.push(parent);
        self.share.push(share);
        self.weight.push(weight);
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
            self.wave(last, &mut stats);
            if last == 0 {
                self.first_hits(rect, aov, &mut pixels);
            }
            last += 1;
        }
        // From the last wave back, each ray's radiance is complete before its parent needs it.
        for wave in (1..last).rev() {
            let (before, after) = self.waves.split_at_mut(wave);
            let (parents, children) = (&mut before[wave - 1], &after[0]);
            for ((&parent, &share), &radiance) in children.parent.iter().zip(&children.share).zip(&children.radiance) {
                parents.radiance[parent as usize] += share * radiance;
            }
        }
        let first = &self.waves[0];
        for (&pixel, &radiance) in first.parent.iter().zip(&first.radiance) {
            pixels.colour[pixel as usize] = radiance.to_array();
        }
        for colour in &mut pixels.colour {
            if !Vec3::from(*colour).is_finite() {
                stats.non_finite_pixels += 1;
                *colour = [0.0; 3];
            }
        }
        (pixels, stats)
    }

    /// Makes the first wave. The pixels as they are where nothing is hit.
    fn start(&mut self, rect: Rect, aov: AovSet) -> Pixels {
        if self.waves.is_empty() {
            self.waves.push(Wave::default());
        }
        let wave = &mut self.waves[0];
        wave.clear();
        let mut places = Vec::with_capacity(rect.pixel_count());
        for square_y in (0..rect.height).step_by(SQUARE as usize) {
            for square_x in (0..rect.width).step_by(SQUARE as usize) {
                for y in square_y..rect.height.min(square_y + SQUARE) {
                    for x in square_x..rect.width.min(square_x + SQUARE) {
                        places.push((x, y));
                    }
                }
            }
        }
        self.simd.run(Primaries { camera: &self.camera, rect, places: &places, wave });
        let count = rect.pixel_count();
        let planes = |wanted: bool| if wanted { count } else { 0 };
        Pixels {
            colour: vec![self.background.to_array(); count],
            depth: vec![-1.0; planes(aov.depth)],
            normal: vec![[0.0; 3]; planes(aov.normal)],
            primitive: vec![-1; planes(aov.primitive)],
        }
    }

    /// Traces a wave, and makes the next one.
    fn wave(&mut self, number: usize, stats: &mut TraceStats) {
        let (before, after) = self.waves.split_at_mut(number + 1);
        let (wave, next) = (&mut before[number], &mut after[0]);
        self.primitives.clear();
        self.primitives.resize(wave.rays.len(), NONE);
        self.tracer.nearest_primitives(&wave.rays, &mut self.primitives);
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
            let Self { looks, cutoff, .. } = self;
            for at in 0..surfaces.count {
                branch(surfaces, at, wave, looks, *cutoff, next, stats);
            }
        }
    }

    /// Fills the planes besides the colour, from the surfaces of the first wave.
    fn first_hits(&self, rect: Rect, aov: AovSet, pixels: &mut Pixels) {
        if aov.is_empty() {
            return;
        }
        let surfaces = &self.surfaces;
        for at in 0..surfaces.count {
            let pixel = self.waves[0].parent[surfaces.ray[at] as usize];
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

/// Adds to the next wave what a surface reflects and refracts.
#[inline(always)]
fn branch(
    surfaces: &Surfaces,
    at: usize,
    wave: &Wave,
    looks: &Looks<'_>,
    cutoff: f32,
    next: &mut Wave,
    stats: &mut TraceStats,
) {
    let material = &looks.materials[surfaces.material[at] as usize];
    let mut reflection = Vec3::from(material.reflection);
    if material.transmittance <= 0.0 && reflection.max_element() <= 0.0 {
        return;
    }
    let ray = surfaces.ray[at];
    let point = surfaces.point(at);
    let mut refracted = None;
    if material.transmittance > 0.0 {
        let normal = DVec3::new(surfaces.normal[0][at], surfaces.normal[1][at], surfaces.normal[2][at]);
        refracted = refract(material, point.normal, normal, wave.rays[ray as usize].direction_f64());
        if refracted.is_none() {
            // Total internal reflection: what cannot leave is reflected.
            reflection += material.transmittance;
        }
    }
    let mirrored = DVec3::new(surfaces.mirrored[0][at], surfaces.mirrored[1][at], surfaces.mirrored[2][at]);
    let rays = [
        (RayKind::Reflection, reflection, Some(mirrored)),
        (RayKind::Refraction, Vec3::splat(material.transmittance), refracted),
    ];
    for (kind, share, direction) in rays {
        let weight = wave.weight[ray as usize] * share.max_element();
        if let Some(direction) = direction
            && weight > cutoff
        {
            let direction = direction.normalize();
            let leaving = Ray::leaving(point.position, point.normal, direction, f32::INFINITY, point.source);
            stats.rays[kind as usize] += 1;
            next.push(leaving, ray, share, weight);
        }
    }
}

impl Surfaces {
    fn point(&self, at: usize) -> SurfacePoint {
        SurfacePoint {
            position: DVec3::new(self.position[0][at], self.position[1][at], self.position[2][at]),
            normal: DVec3::new(self.outward[0][at], self.outward[1][at], self.outward[2][at]),
            source: self.source[at],
        }
    }
}

/// Makes the primary rays of the pixels that see into the root.
struct Primaries<'t> {
    camera: &'t PrimaryRays,
    rect: Rect,
    places: &'t [(u32, u32)],
    wave: &'t mut Wave,
}

impl Task for Primaries<'_> {
    type Output = ();

    #[inline(always)]
    fn run<R: Registers>(self) {
        let Self { camera, rect, places, wave } = self;
        let (mut xs, mut ys) = ([0.0f64; DOUBLES], [0.0f64; DOUBLES]);
        let (mut origins, mut directions) = ([[0.0; DOUBLES]; 3], [[0.0; DOUBLES]; 3]);
        for places in places.chunks(DOUBLES) {
            for (lane, &(x, y)) in places.iter().enumerate() {
                (xs[lane], ys[lane]) = (f64::from(rect.x + x), f64::from(rect.y + y));
            }
            let direction = camera.directions(R::D8::load(&xs), R::D8::load(&ys));
            let (inside, _, enters) = entering(camera.eye.to_array(), direction);
            for axis in 0..3 {
                inside[axis].narrow(&mut origins[axis]);
                direction[axis].narrow(&mut directions[axis]);
            }
            for (lane, &(x, y)) in places.iter().enumerate() {
                if enters >> lane & 1 == 1 {
                    let ray = Ray {
                        origin: [origins[0][lane], origins[1][lane], origins[2][lane]],
                        direction: [directions[0][lane], directions[1][lane], directions[2][lane]],
                        t_max: f32::INFINITY,
                        source: Source::Eye,
                    };
                    wave.push(ray, y * rect.width + x, Vec3::ONE, 1.0);
                }
            }
        }
    }
}

struct Place<'t, 'a> {
    surfaces: &'t mut Surfaces,
    rays: &'t [Ray],
    primitives: &'t super::scene::Primitives<'a>,
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
