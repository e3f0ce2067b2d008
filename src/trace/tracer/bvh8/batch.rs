//! A tile traced wave by wave: all primary rays, then all rays that their hits reflect or refract, and so on; each
//! wave's shadow rays light by light. Radiance is summed per surface in the order of the single-ray kernel, so that its
//! bits are the same.

use glam::Vec3;

use super::branching::Branching;
use super::lighting::light;
use super::packet::NONE;
use super::primaries::Primaries;
use super::surfaces::Surfaces;
use super::wave::Wave;
use super::{Bvh8, PacketTracer};
use crate::database::records::PrimitiveId;
use crate::database::verify::Verified;
use crate::picture::{AovSet, Pixels, Rect};
use crate::tracer::memory_port::RayKind;
use crate::tracer::primary::PrimaryRays;
use crate::tracer::ray::Ray;
use crate::tracer::shade::generations_max;
use crate::tracer::simd::{Registers, Simd, Task};
use crate::tracer::slices::Slices;
use crate::tracer::tile::first_hit;
use crate::tracer::view::Illumination;
use crate::tracer::{TraceStats, View};

/// Traces tiles of one view from a whole database.
pub struct BatchTracer<'a> {
    tracer: PacketTracer<'a>,
    camera: PrimaryRays,
    illumination: Illumination,
    waves: Vec<Wave>,
    primitives: Vec<u32>,
    surfaces: Surfaces,
}

impl<'a> BatchTracer<'a> {
    pub fn new(bvh: &'a Bvh8, database: &'a Verified, view: &View, simd: Simd) -> Self {
        let header = &database.database().header;
        Self {
            tracer: PacketTracer::new(bvh, database, simd),
            camera: PrimaryRays::new(header, view),
            illumination: Illumination::new(view, header),
            waves: Vec::new(),
            primitives: Vec::new(),
            surfaces: Surfaces::default(),
        }
    }

    pub fn counts(&self) -> super::Visits {
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
                parents.radiance[origin.parent as usize] += origin.share.by_channel * radiance;
            }
        }
        let first = &self.waves[0];
        for (origin, &radiance) in first.origins.iter().zip(&first.radiance) {
            pixels.colour[origin.parent as usize] = radiance.to_array();
        }
        stats.non_finite_pixels = pixels.blacken_non_finite();
        (pixels, stats)
    }

    /// Traces the primary rays; those that hit something are the first wave. The pixels as they are where nothing is hit.
    fn start(&mut self, rect: Rect, aov: AovSet) -> Pixels {
        if self.waves.is_empty() {
            self.waves.push(Wave::default());
        }
        let Self { tracer, camera, waves, primitives, .. } = self;
        waves[0].clear();
        primitives.clear();
        tracer.simd.run(Primaries { tracer, camera, rect, wave: &mut waves[0], primitives });
        Pixels::of_background(rect.pixel_count(), self.illumination.background.to_array(), aov)
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
        let (simd, slices) = (self.tracer.simd, self.tracer.slices);
        surfaces.take(&self.primitives, &slices, self.illumination.is_terminator_soft);
        simd.run(PlaceSurfaces { surfaces, rays: &wave.rays, slices: &slices });
        let illumination = &self.illumination;
        stats.rays[RayKind::Shadow as usize] += simd.run(Light { surfaces, illumination, tracer: &mut self.tracer });
        wave.radiance.clear();
        wave.radiance.resize(wave.rays.len(), self.illumination.background);
        for (at, &ray) in surfaces.ray.iter().enumerate() {
            let [r, g, b] = &surfaces.radiance;
            wave.radiance[ray as usize] = Vec3::new(r[at], g[at], b[at]);
        }
        next.clear();
        let Illumination { depth, cutoff, has_sheets, .. } = self.illumination;
        if number < generations_max(depth, has_sheets) as usize {
            simd.run(Branching { surfaces, wave, slices: &slices, cutoff, depth, next, stats });
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
            let primitive = PrimitiveId(surfaces.primitive[at]);
            first_hit(pixels, pixel as usize, &self.camera, direction, primitive, &surfaces.point(at));
        }
    }
}

struct PlaceSurfaces<'t, 'a> {
    surfaces: &'t mut Surfaces,
    rays: &'t [Ray],
    slices: &'t Slices<'a>,
}

impl Task for PlaceSurfaces<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<R: Registers>(self) {
        self.surfaces.place::<R>(self.rays, self.slices);
    }
}

struct Light<'t, 'a> {
    surfaces: &'t mut Surfaces,
    illumination: &'t Illumination,
    tracer: &'t mut PacketTracer<'a>,
}

impl Task for Light<'_, '_> {
    type Output = u64;

    #[inline(always)]
    fn run<R: Registers>(self) -> u64 {
        light::<R>(self.surfaces, self.illumination, self.tracer)
    }
}
