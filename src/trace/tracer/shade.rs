//! Whitted's illumination (T. Whitted, *An improved illumination model for shaded display*, 1980) with NFF's
//! local terms: diffuse and Phong highlight of every light that is not shadowed, a reflected ray, a refracted
//! ray. A surface's radiance is summed in this order, so that its bits do not depend on when rays are traced.

use glam::{DVec3, Vec3};

use super::hit::{Hit, HitOn, SurfacePoint};
use super::memory_port::{MemoryPort, RayKind};
use super::octree::hero::Hero;
use super::optics::{
    Cosines, Finish, Share, aim, brighten, facing, facing_round, mirrored, refract, rounded, scatter, smooth, tint,
};
use super::ray::Ray;
use super::stats::TraceStats;
use super::vector::V3;
use super::view::{Illumination, View};
use crate::database::Header;
use crate::database::records::{LightTerms, Material, PrimitiveId, Surface};

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
    /// Sheets that were passed straight on so far.
    sheets: u32,
    /// Share of the pixel that this ray decides, in the strongest channel.
    weight: f32,
}

impl Shader {
    pub fn new(header: &Header, view: &View, mailbox: bool) -> Self {
        Self { hero: Hero::new(header, mailbox), illumination: Illumination::new(view, header) }
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
        let ancestry = Ancestry { bounces: 0, sheets: 0, weight: 1.0 };
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
        let corners = Corners::read(port, hit, surface)?;
        let (own, outward) = (corners.normal(hit, point).to_array(), point.normal.to_array());
        let normal = match self.illumination.is_terminator_soft {
            true => facing_round(own, outward, incoming.to_array()),
            false => facing(own, incoming.to_array()),
        };
        let mirrored = DVec3::from(mirrored(incoming.to_array(), normal));
        let normal = DVec3::from(normal);
        let diffuse = corners.tinted(hit, material.diffuse);
        let terms = light_terms(port, surface, &material)?;
        let seen = || facing(outward, incoming.to_array());
        let from = self.illumination.is_terminator_soft.then(|| corners.rounded(hit, point, seen()).to_array());
        let finish = Finish { diffuse, highlight: material.highlight, shine: &[material.shine] };
        let mut radiance = self.local(port, point, from, normal, mirrored, terms.emission, &finish, stats)?;
        let is_sheet = is_sheet(&material, &terms);
        let onward = Onward::new(ancestry.bounces, ancestry.sheets, is_sheet, self.illumination.depth);
        if onward.is_none() {
            return Ok(radiance);
        }
        let refracted = || if is_sheet { Some(incoming) } else { refract(&material, point.normal, normal, incoming) };
        let (reflection, refraction) = scatter(&material, ancestry.weight, self.illumination.cutoff, refracted);
        let reflection = reflection.map(|share| (share, mirrored));
        for (kind, ray, steps) in
            [(RayKind::Reflection, reflection, onward.reflected), (RayKind::Refraction, refraction, onward.refracted)]
        {
            if let (Some((Share { by_channel, weight }, direction)), Some((bounces, sheets))) = (ray, steps) {
                let ray = point.leaving(direction.normalize(), f32::INFINITY);
                let ancestry = Ancestry { bounces, sheets, weight };
                radiance += by_channel * self.secondary(port, kind, &ray, ancestry, stats)?;
            }
        }
        Ok(radiance)
    }

    /// What the surface emits, and the light that comes straight from the lights on the viewer's side of it.
    #[expect(clippy::too_many_arguments, reason = "each is computed once for the surface, and used for other rays too")]
    fn local<M: MemoryPort>(
        &mut self,
        port: &mut M,
        point: &SurfacePoint,
        from: Option<V3<f64>>,
        normal: DVec3,
        mirrored: DVec3,
        emission: [f32; 3],
        finish: &Finish<'_, f32>,
        stats: &mut TraceStats,
    ) -> Result<Vec3, M::Error> {
        let (outward, normal, mirrored) = (point.normal.to_array(), normal.to_array(), mirrored.to_array());
        let mut radiance = emission;
        for light in 0..self.illumination.lights.len() {
            let (position, colour) = self.illumination.lights[light];
            let to_light = aim::<f64>(position, point.position.to_array(), from, outward, normal, mirrored);
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
            let mut share = 1.0;
            if to_light.meets_root & 1 == 1 && self.hero.occluded(port, &ray, stats)? {
                share = match self.illumination.has_sheets {
                    true => through_sheets(&mut self.hero, port, ray, stats)?,
                    false => 0.0,
                };
            }
            if share > 0.0 {
                let Cosines { normal, mirrored } = to_light.cosines;
                let cosines = Cosines { normal: &[normal as f32][..], mirrored: &[mirrored as f32] };
                radiance = brighten::<f32, f64>(radiance, colour * share, finish, cosines, 1);
            }
        }
        Ok(radiance.into())
    }
}

/// More sheets than this on the way of a ray let nothing pass.
const SHEETS_MAX: u32 = 64;

/// Whether a surface lets rays pass straight on.
#[inline(always)]
pub(super) fn is_sheet(material: &Material, terms: &LightTerms) -> bool {
    terms.shadow_transmittance > 0.0 && material.ior() == 1.0
}

/// What the rays that a surface sends on have behind them then: bounces, and sheets that were passed. `None` for those that have had as
/// many as there may be. What passes a sheet has not bounced.
#[derive(Clone, Copy)]
pub(super) struct Onward {
    pub reflected: Option<(u32, u32)>,
    pub refracted: Option<(u32, u32)>,
}

impl Onward {
    #[inline(always)]
    pub(super) fn new(bounces: u32, sheets: u32, is_sheet: bool, depth: u32) -> Self {
        let bounced = (bounces < depth).then_some((bounces + 1, sheets));
        let passed = (sheets < SHEETS_MAX).then_some((bounces, sheets + 1));
        Self { reflected: bounced, refracted: if is_sheet { passed } else { bounced } }
    }

    #[inline(always)]
    fn is_none(self) -> bool {
        self.reflected.is_none() && self.refracted.is_none()
    }
}

/// How many rays may follow one another.
pub(super) fn generations_max(depth: u32, has_sheets: bool) -> u32 {
    if has_sheets { depth + SHEETS_MAX } else { depth }
}

/// The share of a light's ray that passes all that is in its way, which is something. Sheet after sheet from the surface on, so that
/// the product's bits do not depend on the order of tests; each sheet that lets light pass is one more shadow ray.
pub(super) fn through_sheets<M: MemoryPort>(
    hero: &mut Hero,
    port: &mut M,
    mut ray: Ray,
    stats: &mut TraceStats,
) -> Result<f32, M::Error> {
    let mut share = 1.0;
    for _ in 0..=SHEETS_MAX {
        let Some(hit) = hero.nearest(port, &ray, stats)? else { return Ok(share) };
        let surface = port.surface(hit.primitive.0)?;
        let material = port.material(surface.material)?;
        share *= light_terms(port, surface, &material)?.shadow_transmittance;
        if !(share > 0.0) {
            return Ok(0.0);
        }
        stats.rays[RayKind::Shadow as usize] += 1;
        ray = hit.surface_point(&ray).leaving(ray.direction_f64(), ray.t_max - hit.t);
    }
    Ok(0.0)
}

#[inline(always)]
fn light_terms<M: MemoryPort>(port: &mut M, surface: Surface, material: &Material) -> Result<LightTerms, M::Error> {
    if material.has_light_terms() { Ok(port.material(surface.material + 1)?.into()) } else { Ok(LightTerms::NONE) }
}

/// What is known of the corners of a triangle that is hit.
pub(super) struct Corners {
    normals: Option<[[f64; 3]; 3]>,
    colours: Option<[[f64; 3]; 3]>,
}

impl Corners {
    #[inline(always)]
    pub(super) fn read<M: MemoryPort>(port: &mut M, hit: &Hit, surface: Surface) -> Result<Self, M::Error> {
        let mut corners = Self { normals: None, colours: None };
        if let HitOn::Triangle { .. } = hit.on {
            if let Some(index) = surface.normals() {
                corners.normals = Some(port.normals(index)?.widened());
            }
            if let Some(index) = surface.colours() {
                corners.colours = Some(port.normals(index)?.widened());
            }
        }
        Ok(corners)
    }

    /// The normal that a surface is shaded by, not yet turned to where the ray comes from.
    #[inline(always)]
    pub(super) fn normal(&self, hit: &Hit, point: &SurfacePoint) -> DVec3 {
        match (&hit.on, self.normals) {
            (&HitOn::Triangle { barycentrics, .. }, Some(normals)) => {
                smooth(normals, barycentrics, point.normal.to_array()).into()
            }
            _ => point.normal,
        }
    }

    /// A colour times that of the triangle.
    #[inline(always)]
    pub(super) fn tinted(&self, hit: &Hit, colour: [f32; 3]) -> [f32; 3] {
        match (&hit.on, self.colours) {
            (&HitOn::Triangle { barycentrics, .. }, Some(colours)) => {
                let tint = tint(colours, barycentrics);
                [colour[0] * tint[0] as f32, colour[1] * tint[1] as f32, colour[2] * tint[2] as f32]
            }
            _ => colour,
        }
    }

    /// Where rays to lights leave with a soft terminator.
    #[inline(always)]
    pub(super) fn rounded(&self, hit: &Hit, point: &SurfacePoint, seen: V3<f64>) -> DVec3 {
        match (&hit.on, self.normals) {
            (HitOn::Triangle { triangle, barycentrics }, Some(normals)) => {
                let vertices = triangle.vertices().map(|vertex| vertex.to_array());
                rounded(point.position.to_array(), vertices, normals, *barycentrics, seen).into()
            }
            _ => point.position,
        }
    }
}
