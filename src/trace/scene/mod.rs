//! Files and procedural definitions to a [`Scene`]: world coordinates in f64, nothing compiled yet.

pub mod camera;
mod cursor;
pub mod load;
pub mod nff;
pub mod obj;
pub mod placement;
pub mod procedural;
mod scene_source;
pub mod source;
pub mod source_error;
mod up_axis;
pub mod warning;

use std::path::PathBuf;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::picture::Terminator;
pub use camera::Camera;
pub use load::load;
pub use placement::Placement;
pub use scene_source::SceneSource;
pub use source_error::SourceError;
pub use up_axis::UpAxis;
pub use warning::{Warning, Warnings};

/// What a scene file holds. Every number is finite; every index is in range.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// `None` when the file has none (OBJ).
    pub camera: Option<Camera>,
    /// Linear RGB where a ray hits nothing.
    pub background: DVec3,
    pub lights: Vec<Light>,
    pub materials: Vec<Material>,
    /// Vertices of all polygons, one polygon after the other.
    pub vertices: Vec<DVec3>,
    /// Unit vertex normals of all smooth polygons, one polygon after the other.
    pub normals: Vec<DVec3>,
    /// Linear RGB at the vertices of all coloured polygons, one polygon after the other.
    pub colours: Vec<DVec3>,
    pub polygons: Vec<Polygon>,
    pub spheres: Vec<Sphere>,
    pub cones: Vec<Cone>,
    /// How this kind of file is usually shown, where the image settings do not say.
    pub terminator: Terminator,
    /// The file that polygons are from; `None` of a procedural scene.
    pub file: Option<PathBuf>,
    /// Other files that it was read from.
    pub libraries: Vec<PathBuf>,
    /// Index and line of every polygon of a file that must be cut into triangles, in order.
    pub polygon_lines: Vec<(u32, u32)>,
    /// What of the file was repaired or left out.
    pub warnings: Warnings,
}

/// A planar polygon, convex or concave, front side counter-clockwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Polygon {
    /// Index into [`Scene::vertices`].
    pub first_vertex: u32,
    /// At least 3.
    pub vertex_count: u32,
    /// Index into [`Scene::normals`]; `None` for a flat polygon.
    pub first_normal: Option<u32>,
    /// Index into [`Scene::colours`]; `None` for a polygon of its material's colour alone.
    pub first_colour: Option<u32>,
    pub material: u32,
}

/// A sphere. A negative radius: only the inside is visible (NFF).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    pub centre: DVec3,
    /// World units, not zero.
    pub radius: f64,
    pub material: u32,
}

/// An open cone or cylinder. Negative radii: only the inside is visible (NFF).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cone {
    pub base: DVec3,
    pub base_radius: f64,
    pub apex: DVec3,
    /// Same sign as the base's; one of the two may be zero.
    pub apex_radius: f64,
    pub material: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Light {
    pub position: DVec3,
    /// Linear RGB intensity, not attenuated by distance.
    pub colour: DVec3,
}

/// Whitted's terms: emission + Σ lights (diffuse·cos + highlight·cos^shine) + reflection·L + transmittance·L.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Linear RGB, colour times Kd.
    pub diffuse: DVec3,
    /// Linear RGB of the Phong highlight.
    pub highlight: DVec3,
    /// Linear RGB weight of the reflected ray; zero: none is cast.
    pub reflection: DVec3,
    /// Phong exponent.
    pub shine: f64,
    /// Weight of the refracted ray, 0 to 1; zero: none is cast.
    pub transmittance: f64,
    /// Index of refraction inside; positive where transmittance is. At 1 nothing is bent.
    pub ior: f64,
    /// Linear RGB that the surface sends out on both sides; it lights nothing else.
    pub emission: DVec3,
    /// Share of a light's rays that pass through the surface, 0 to 1; zero: it casts a full shadow.
    pub shadow_transmittance: f64,
}

impl Material {
    /// What a surface is made of when its file does not say.
    pub const WHITE: Self = Self {
        diffuse: DVec3::ONE,
        highlight: DVec3::ZERO,
        reflection: DVec3::ZERO,
        shine: 1.0,
        transmittance: 0.0,
        ior: 1.0,
        emission: DVec3::ZERO,
        shadow_transmittance: 0.0,
    };

    /// An NFF `f` line: colour, Kd, Ks, shine, T, index of refraction.
    pub fn from_nff(colour: DVec3, kd: f64, ks: f64, shine: f64, t: f64, ior: f64) -> Self {
        Self {
            diffuse: colour * kd,
            highlight: DVec3::splat(ks),
            reflection: DVec3::splat(ks),
            shine,
            transmittance: t,
            ior,
            ..Self::WHITE
        }
    }
}

/// Whether a polygon may have a flaw that is to be named by its line: all that have to be cut into triangles, and triangles that have
/// no area or nearly none.
pub(crate) fn may_be_flawed(corners: &[DVec3]) -> bool {
    const NEARLY_NONE: f64 = 1e-9;
    let &[a, b, c] = corners else { return true };
    let (ab, ac) = (b - a, c - a);
    // Also where it is not a number.
    !(ab.cross(ac).length() > NEARLY_NONE * ab.length() * ac.length())
}

impl Scene {
    /// The corners of a polygon.
    pub fn corners(&self, polygon: &Polygon) -> &[DVec3] {
        &self.vertices[polygon.first_vertex as usize..][..polygon.vertex_count as usize]
    }

    /// The vertex normals of a smooth polygon.
    pub fn corner_normals(&self, polygon: &Polygon) -> Option<&[DVec3]> {
        let first = polygon.first_normal? as usize;
        Some(&self.normals[first..][..polygon.vertex_count as usize])
    }

    /// The colours at a polygon's vertices.
    pub fn corner_colours(&self, polygon: &Polygon) -> Option<&[DVec3]> {
        let first = polygon.first_colour? as usize;
        Some(&self.colours[first..][..polygon.vertex_count as usize])
    }

    /// Primitives as the paper counts them: polygons before triangulation, spheres, cones.
    pub fn primitive_count(&self) -> usize {
        self.polygons.len() + self.spheres.len() + self.cones.len()
    }

    /// Smallest box around all primitives, `None` for an empty scene.
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        let mut bounds: Option<(DVec3, DVec3)> = None;
        let mut include = |lo: DVec3, hi: DVec3| {
            bounds = Some(bounds.map_or((lo, hi), |(a, b)| (a.min(lo), b.max(hi))));
        };
        self.vertices.iter().for_each(|&v| include(v, v));
        for s in &self.spheres {
            include(s.centre - s.radius.abs(), s.centre + s.radius.abs());
        }
        for c in &self.cones {
            // Tight: a disc of radius r with unit axis n reaches r·√(1 − n_a²) along axis a.
            let axis = (c.apex - c.base).normalize_or_zero();
            let reach = (DVec3::ONE - axis * axis).max(DVec3::ZERO).map(f64::sqrt);
            include(c.base - reach * c.base_radius.abs(), c.base + reach * c.base_radius.abs());
            include(c.apex - reach * c.apex_radius.abs(), c.apex + reach * c.apex_radius.abs());
        }
        bounds
    }
}
