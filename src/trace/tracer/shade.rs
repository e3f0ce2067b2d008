//! Whitted's illumination (T. Whitted, *An improved illumination model for shaded display*, 1980) with NFF's
//! local terms: diffuse and Phong highlight of every light that is not shadowed, a reflected ray, a refracted
//! ray. A surface's radiance is summed in this order, so that its bits do not depend on when rays are traced.

use glam::{DVec3, Vec3};

use super::hit::{Hit, HitOn, SurfacePoint};
use super::memory_port::{MemoryPort, RayKind};
use super::octree::hero::Hero;
use super::optics::{Cosines, Finish, Share, aim, brighten, facing, mirrored, refract, scatter, smooth};
use super::ray::Ray;
use super::stats::TraceStats;
use super::view::{Illumination, View};
use crate::database::Header;
use crate::database::records::{Material, PrimitiveId, Surface};

/// Shades what rays hit, and casts the rays for it.
pub struct Shader {
    hero: Hero,
    illumination: Illumination,
}

/// What a primary ray brought.
pub struct Seen {
    /// Linear RGB.
    pub radiance: Vec3,
    pub first: Option<(PrimitiveId, SurfacePoint)>,
}

/// A ray's place in its pixel's tree.
#[derive(Clone, Copy)]
struct Ancestry {
    /// Reflections and refractions so far.
    bounces: u32,
    /// Share of the pixel that this ray decides, in the strongest channel.
    weight: f32,
}

impl Shader {
    pub fn new(header: &Header, view: &View, mailbox: bool) -> Self {
        Self { hero: Hero::new(header, mailbox), illumination: Illumination::new(view, &header.normalisation) }
    }

    /// Traces a primary ray: normalised origin anywhere, unit direction.
    ///
    /// # Errors
    /// The port's.
    pub fn primary<M: MemoryPort>(
        &mut self,
        port: &mut M,
        eye: DVec3,
        direction: DVec3,
        stats: &mut TraceStats,
    ) -> Result<Seen, M::Error> {
        stats.rays[RayKind::Primary as usize] += 1;
        port.set_ray_kind(RayKind::Primary);
        let missed = Seen { radiance: self.illumination.background, first: None };
        let Some((ray, _)) = Ray::from_eye(eye, direction) else { return Ok(missed) };
        let Some(hit) = self.hero.nearest(port, &ray, stats)? else { return Ok(missed) };
        let point = hit.surface_point(&ray);
        let ancestry = Ancestry { bounces: 0, weight: 1.0 };
        let radiance = self.shade(port, &ray, &hit, &point, ancestry, stats)?;
        Ok(Seen { radiance, first: Some((hit.primitive, point)) })
    }

    fn secondary<M: MemoryPort>(
        &mut self,
        port: &mut M,
        kind: RayKind,
        ray: &Ray,
        ancestry: Ancestry,
        stats: &mut TraceStats,
    ) -> Result<Vec3, M::Error> {
        stats.rays[kind as usize] += 1;
        port.set_ray_kind(kind);
        match self.hero.nearest(port, ray, stats)? {
            None => Ok(self.illumination.background),
            Some(hit) => self.shade(port, ray, &hit, &hit.surface_point(ray), ancestry, stats),
        }
    }

    fn shade<M: MemoryPort>(
        &mut self,
        port: &mut M,
        ray: &Ray,
        hit: &Hit,
        point: &SurfacePoint,
        ancestry: Ancestry,
        stats: &mut TraceStats,
    ) -> Result<Vec3, M::Error> {
        let surface = port.surface(hit.primitive.0)?;
        let material = port.material(surface.material)?;
        let incoming = ray.direction_f64();
        let normal = shading_normal(port, hit, point, surface)?;
        let normal = DVec3::from(facing(normal.to_array(), incoming.to_array()));
        let mirrored = DVec3::from(mirrored(incoming.to_array(), normal.to_array()));
        let mut radiance = self.local(port, point, normal, mirrored, &material, stats)?;
        if ancestry.bounces == self.illumination.depth {
            return Ok(radiance);
        }
        let refracted = || refract(&material, point.normal, normal, incoming);
        let (reflection, refraction) = scatter(&material, ancestry.weight, self.illumination.cutoff, refracted);
        let reflection = reflection.map(|share| (share, mirrored));
        for (kind, ray) in [(RayKind::Reflection, reflection), (RayKind::Refraction, refraction)] {
            if let Some((Share { by_channel, weight }, direction)) = ray {
                let ray = point.leaving(direction.normalize(), f32::INFINITY);
                let ancestry = Ancestry { bounces: ancestry.bounces + 1, weight };
                radiance += by_channel * self.secondary(port, kind, &ray, ancestry, stats)?;
            }
        }
        Ok(radiance)
    }

    /// Light that comes straight from the lights on the viewer's side of the surface.
    fn local<M: MemoryPort>(
        &mut self,
        port: &mut M,
        point: &SurfacePoint,
        normal: DVec3,
        mirrored: DVec3,
        material: &Material,
        stats: &mut TraceStats,
    ) -> Result<Vec3, M::Error> {
        let (outward, normal, mirrored) = (point.normal.to_array(), normal.to_array(), mirrored.to_array());
        let finish = Finish { diffuse: material.diffuse, highlight: material.highlight, shine: &[material.shine] };
        let mut radiance = [0.0; 3];
        for light in 0..self.illumination.lights.len() {
            let (position, colour) = self.illumination.lights[light];
            let to_light = aim::<f64>(position, point.position.to_array(), outward, normal, mirrored);
            if to_light.turned_to == 0 {
                continue;
            }
            stats.rays[RayKind::Shadow as usize] += 1;
            port.set_ray_kind(RayKind::Shadow);
            let ray = Ray {
                origin: to_light.origin.map(|c| c as f32),
                direction: to_light.direction.map(|c| c as f32),
                t_max: to_light.distance as f32,
                source: point.source,
            };
            if !self.hero.occluded(port, &ray, stats)? {
                let Cosines { normal, mirrored } = to_light.cosines;
                let cosines = Cosines { normal: &[normal as f32][..], mirrored: &[mirrored as f32] };
                radiance = brighten::<f32, f64>(radiance, colour, &finish, cosines, 1);
            }
        }
        Ok(radiance.into())
    }
}

/// The normal that a surface is shaded by, not yet turned to where the ray comes from.
#[inline(always)]
pub(super) fn shading_normal<M: MemoryPort>(
    port: &mut M,
    hit: &Hit,
    point: &SurfacePoint,
    surface: Surface,
) -> Result<DVec3, M::Error> {
    let HitOn::Triangle { barycentrics, .. } = hit.on else { return Ok(point.normal) };
    if surface.normals == Surface::FLAT {
        return Ok(point.normal);
    }
    let corners = port.normals(surface.normals)?.widened();
    Ok(smooth(corners, barycentrics, point.normal.to_array()).into())
}
