//! Scene → records: polygons become triangles, coordinates become normalised f32.

use glam::DVec3;

use super::normalisation::Normalisation;
use super::records::{Cone, Material, Normals, PrimitiveId, Sphere, Surface, Triangle};
use super::{Database, Header, Layout, Section, ear_clipping, layout::TooLarge};
use crate::scene::{Polygon, Scene};

/// All sections of a database but those of the octree.
#[derive(Clone, Debug)]
pub struct Records {
    pub normalisation: Normalisation,
    pub scene_primitives: u64,
    pub triangles: Vec<Triangle>,
    pub spheres: Vec<Sphere>,
    pub cones: Vec<Cone>,
    pub surfaces: Vec<Surface>,
    pub normals: Vec<Normals>,
    pub materials: Vec<Material>,
}

#[derive(Clone, PartialEq, Debug, thiserror::Error)]
pub enum CompileError {
    #[error(transparent)]
    TooLarge(#[from] TooLarge),
    #[error("the scene has {0} polygons, at most {max} can be told apart", max = Triangle::POLYGONS_MAX)]
    TooManyPolygons(usize),
    #[error("polygon {polygon} (from 0) cannot be cut into triangles: {why}")]
    Polygon { polygon: usize, why: String },
}

/// Compiles everything that does not depend on the octree.
///
/// # Errors
/// The scene has more polygons than a tag can hold, or one that is too involved to be cut.
pub fn compile(scene: &Scene) -> Result<Records, CompileError> {
    if scene.polygons.len() >= Triangle::POLYGONS_MAX as usize {
        return Err(CompileError::TooManyPolygons(scene.polygons.len()));
    }
    let normalisation = Normalisation::new(scene.bounds());
    let mut records = Records {
        normalisation,
        scene_primitives: scene.primitive_count() as u64,
        triangles: Vec::with_capacity(scene.polygons.len()),
        spheres: Vec::with_capacity(scene.spheres.len()),
        cones: Vec::with_capacity(scene.cones.len()),
        surfaces: Vec::with_capacity(scene.primitive_count()),
        normals: Vec::new(),
        materials: scene.materials.iter().map(material).collect(),
    };
    for (id, polygon) in scene.polygons.iter().enumerate() {
        records.add_polygon(scene, id, polygon)?;
    }
    for sphere in &scene.spheres {
        records.spheres.push(Sphere {
            centre: f32s(normalisation.point(sphere.centre)),
            radius: normalisation.length(sphere.radius) as f32,
        });
        records.surfaces.push(Surface { material: sphere.material, normals: Surface::FLAT });
    }
    for cone in &scene.cones {
        records.cones.push(Cone {
            base: f32s(normalisation.point(cone.base)),
            base_radius: normalisation.length(cone.base_radius) as f32,
            apex: f32s(normalisation.point(cone.apex)),
            apex_radius: normalisation.length(cone.apex_radius) as f32,
        });
        records.surfaces.push(Surface { material: cone.material, normals: Surface::FLAT });
    }
    Ok(records)
}

impl Records {
    fn add_polygon(&mut self, scene: &Scene, id: usize, polygon: &Polygon) -> Result<(), CompileError> {
        let first = polygon.first_vertex as usize;
        let corners = &scene.vertices[first..first + polygon.vertex_count as usize];
        let triangles = ear_clipping::triangulate(corners)
            .map_err(|error| CompileError::Polygon { polygon: id, why: error.to_string() })?;
        for ear in triangles {
            let corner = |i: usize| f32s(self.normalisation.point(corners[ear.corners[i] as usize]));
            self.triangles.push(Triangle::new([corner(0), corner(1), corner(2)], id as u32, ear.interior_edges));
            let normals = polygon.first_normal.map_or(Surface::FLAT, |first| {
                let normal = |i: usize| f32s(scene.normals[first as usize + ear.corners[i] as usize]);
                self.normals.push(Normals([normal(0), normal(1), normal(2)]));
                self.normals.len() as u32 - 1
            });
            self.surfaces.push(Surface { material: polygon.material, normals });
        }
        Ok(())
    }

    /// How many primitives have an id: triangles, spheres, cones.
    pub fn primitive_count(&self) -> usize {
        self.triangles.len() + self.spheres.len() + self.cones.len()
    }

    /// Every primitive's id in order.
    pub fn primitive_ids(&self) -> impl Iterator<Item = PrimitiveId> + use<> {
        (0..self.primitive_count() as u32).map(PrimitiveId)
    }

    /// Puts the octree's sections and these into one image.
    ///
    /// # Errors
    /// The image would be larger than can be addressed.
    pub fn assemble(&self, octree: &[u32], leaf_lists: &[u32], max_depth: u32) -> Result<Database, TooLarge> {
        let sections: [&[u32]; Section::COUNT] = [
            octree,
            leaf_lists,
            bytemuck::cast_slice(&self.triangles),
            bytemuck::cast_slice(&self.spheres),
            bytemuck::cast_slice(&self.cones),
            bytemuck::cast_slice(&self.surfaces),
            bytemuck::cast_slice(&self.normals),
            bytemuck::cast_slice(&self.materials),
        ];
        let records = Section::ALL.map(|s| sections[s as usize].len() as u64 * 4 / s.record_bytes());
        let layout = Layout::new(records)?;
        let mut words = vec![0u32; (layout.image_bytes() / 4) as usize];
        for section in Section::ALL {
            let first = (layout.span(section).base.0 / 4) as usize;
            let source = sections[section as usize];
            words[first..first + source.len()].copy_from_slice(source);
        }
        let header =
            Header { layout, normalisation: self.normalisation, max_depth, scene_primitives: self.scene_primitives };
        Ok(Database { header, words: words.into() })
    }
}

fn f32s(v: DVec3) -> [f32; 3] {
    v.as_vec3().to_array()
}

fn material(m: &crate::scene::Material) -> Material {
    Material {
        diffuse: f32s(m.diffuse),
        highlight: f32s(m.highlight),
        reflection: f32s(m.reflection),
        shine: m.shine as f32,
        transmittance: m.transmittance as f32,
        ior: m.ior as f32,
    }
}
