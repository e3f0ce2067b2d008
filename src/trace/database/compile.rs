//! Scene → records: polygons become triangles, coordinates become normalised f32.

use glam::DVec3;

use super::ear_clipping::{Cut, Ear, Flaw, has_area, triangulate};
use super::layout::{DATABASE_BYTES_MAX, GRANULE_BYTES, TooLarge};
use super::normalisation::Normalisation;
use super::primitives::Primitives;
use super::records::{self, Cone, LightTerms, Material, Normals, PrimitiveId, Sphere, Surface, Triangle};
use super::{Database, Header, Layout, Objects, RecordLayout, Section};
use crate::scene::{Polygon, Scene, Warning};

/// All sections of a database but those of the octree.
#[derive(Clone, Debug)]
pub struct Records {
    pub layout: RecordLayout,
    pub normalisation: Normalisation,
    pub scene_primitives: u64,
    pub triangles: Vec<Triangle>,
    pub spheres: Vec<Sphere>,
    pub cones: Vec<Cone>,
    pub surfaces: Vec<Surface>,
    pub normals: Vec<Normals>,
    pub materials: Vec<Material>,
    /// Where polygons are objects: those with triangles.
    pub polygons: Vec<records::Polygon>,
    /// Whether a material lets a light's rays pass.
    pub has_sheets: bool,
    /// About polygons that are not shown as they are written, one of each kind.
    pub warnings: Vec<Warning>,
}

#[derive(Clone, PartialEq, Debug, thiserror::Error)]
pub enum CompileError {
    #[error(transparent)]
    TooLarge(#[from] TooLarge),
    #[error("the scene has {0} polygons, at most {max} can be told apart", max = Triangle::POLYGONS_MAX)]
    TooManyPolygons(usize),
}

/// Compiles everything that does not depend on the octree.
///
/// # Errors
/// The scene has more polygons than a tag can hold, or is larger than can be addressed.
pub fn compile(scene: &Scene) -> Result<Records, CompileError> {
    compile_as(scene, RecordLayout::DEFAULT)
}

/// [`compile`], its records laid out like this.
///
/// # Errors
/// As of `compile`.
pub fn compile_as(scene: &Scene, layout: RecordLayout) -> Result<Records, CompileError> {
    if scene.polygons.len() >= Triangle::POLYGONS_MAX as usize {
        return Err(CompileError::TooManyPolygons(scene.polygons.len()));
    }
    let least = least_layout(scene, layout)?;
    let records = |section| least.span(section).records as usize;
    let normalisation = Normalisation::new(scene.bounds());
    let (materials, material_at) = materials(scene);
    let mut records = Records {
        layout,
        normalisation,
        scene_primitives: scene.primitive_count() as u64,
        triangles: Vec::with_capacity(records(Section::Triangles)),
        spheres: Vec::with_capacity(scene.spheres.len()),
        cones: Vec::with_capacity(scene.cones.len()),
        surfaces: Vec::with_capacity(records(Section::Surfaces)),
        normals: Vec::with_capacity(records(Section::Normals)),
        materials,
        polygons: Vec::with_capacity(records(Section::Polygons)),
        has_sheets: scene.materials.iter().any(|material| material.shadow_transmittance > 0.0),
        warnings: Vec::new(),
    };
    for (id, polygon) in scene.polygons.iter().enumerate() {
        if let Some(flaw) = records.add_polygon(scene, polygon, id, material_at[polygon.material as usize]) {
            records.warn(scene, id, flaw);
        }
    }
    for sphere in &scene.spheres {
        records.spheres.push(Sphere {
            centre: f32s(normalisation.point(sphere.centre)),
            radius: normalisation.length(sphere.radius) as f32,
        });
        records.surfaces.push(Surface::plain(material_at[sphere.material as usize]));
    }
    for cone in &scene.cones {
        records.cones.push(Cone {
            base: f32s(normalisation.point(cone.base)),
            base_radius: normalisation.length(cone.base_radius) as f32,
            apex: f32s(normalisation.point(cone.apex)),
            apex_radius: normalisation.length(cone.apex_radius) as f32,
        });
        records.surfaces.push(Surface::plain(material_at[cone.material as usize]));
    }
    Ok(records)
}

/// The image of a scene with the smallest octree, one leaf: what is too large for that is told before
/// anything is made.
fn least_layout(scene: &Scene, layout: RecordLayout) -> Result<Layout, TooLarge> {
    let triangles = |polygon: &Polygon| u64::from(polygon.vertex_count).saturating_sub(2);
    let flat_and_smooth: u64 = scene.polygons.iter().map(triangles).sum();
    // A record for normals, and one for colours.
    let corners = |polygon: &Polygon| {
        triangles(polygon) * (u64::from(polygon.first_normal.is_some()) + u64::from(polygon.first_colour.is_some()))
    };
    let corners = scene.polygons.iter().map(corners).sum();
    let (spheres, cones) = (scene.spheres.len() as u64, scene.cones.len() as u64);
    let primitives = flat_and_smooth + spheres + cones;
    let materials = material_records(scene) as u64;
    let (polygons, listed) = match layout.objects() {
        Objects::Triangles => (0, primitives),
        Objects::Polygons => (scene.polygons.len() as u64, scene.polygons.len() as u64 + spheres + cones),
    };
    let records = [8, listed, flat_and_smooth, spheres, cones, primitives, corners, materials, polygons];
    Layout::padded(records, layout.strides())
}

impl Records {
    fn add_polygon(&mut self, scene: &Scene, polygon: &Polygon, id: usize, material: u32) -> Option<Flaw> {
        let corners = scene.corners(polygon);
        let first_triangle = self.triangles.len() as u32;
        // Most have three, and need no memory for it.
        let (cut, whole) = match corners.try_into() {
            Ok(triangle) => {
                let flaw = (!has_area(triangle)).then_some(Flaw::WithoutArea);
                (Cut { ears: Vec::new(), flaw }, &[Ear::WHOLE][..])
            }
            Err(_) => (triangulate(corners), &[][..]),
        };
        for ear in cut.ears.iter().chain(whole) {
            let corner = |i: usize| f32s(self.normalisation.point(corners[ear.corners[i] as usize]));
            self.triangles.push(Triangle::new([corner(0), corner(1), corner(2)], id as u32, ear.interior_edges));
            let mut push = |vectors: &[DVec3], first: u32| {
                let vector = |i: usize| f32s(vectors[first as usize + ear.corners[i] as usize]);
                self.normals.push(Normals([vector(0), vector(1), vector(2)]));
                self.normals.len() as u32 - 1
            };
            let colours = polygon.first_colour.map(|first| push(&scene.colours, first));
            let normals = polygon.first_normal.map(|first| push(&scene.normals, first));
            self.surfaces.push(match (colours, normals) {
                (Some(colours), normals) => Surface::coloured(material, colours, normals.is_some()),
                (None, Some(normals)) => Surface::smooth(material, normals),
                (None, None) => Surface::plain(material),
            });
        }
        let triangle_count = self.triangles.len() as u32 - first_triangle;
        if self.layout.objects() == Objects::Polygons && triangle_count > 0 {
            self.polygons.push(records::Polygon { first_triangle, triangle_count });
        }
        cut.flaw
    }

    /// Counts one more polygon with a flaw; the first is named.
    fn warn(&mut self, scene: &Scene, id: usize, flaw: Flaw) {
        let (kind, what) = match flaw {
            Flaw::CrossesItself => ("polygon-crosses-itself", "crosses itself, it is cut as well as can be"),
            Flaw::WithoutArea => ("polygon-without-area", "has no area, nothing of it is seen"),
            Flaw::TooIntricate => ("polygon-too-intricate", "takes too long to be cut into triangles, it is left out"),
        };
        if let Some(warning) = self.warnings.iter_mut().find(|warning| warning.kind == kind) {
            warning.count += 1;
            return;
        }
        let line = scene.polygon_lines.binary_search_by_key(&(id as u32), |&(polygon, _)| polygon);
        let line = line.ok().map(|i| scene.polygon_lines[i].1);
        let name = if line.is_some() { "a polygon".to_owned() } else { format!("polygon {id} (from 0)") };
        let text = format!("{name} of {} corners {what}", scene.polygons[id].vertex_count);
        let warning = Warning::of_scene(kind, text);
        self.warnings.push(Warning { file: scene.file.clone(), line, column: line.map(|_| 1), ..warning });
    }

    /// The primitives, by id.
    pub fn primitives(&self) -> Primitives<'_> {
        Primitives { triangles: &self.triangles, spheres: &self.spheres, cones: &self.cones }
    }

    /// How many primitives have an id.
    pub fn primitive_count(&self) -> usize {
        self.primitives().count()
    }

    /// Every primitive's id in order.
    pub fn primitive_ids(&self) -> impl Iterator<Item = PrimitiveId> + use<> {
        (0..self.primitive_count() as u32).map(PrimitiveId)
    }

    /// What the octree lists: polygons or triangles, spheres and cones.
    pub fn object_count(&self) -> usize {
        match self.layout.objects() {
            Objects::Triangles => self.primitive_count(),
            Objects::Polygons => self.polygons.len() + self.spheres.len() + self.cones.len(),
        }
    }

    /// What the octree's sections may take besides these, in bytes.
    pub fn octree_bytes_max(&self) -> u64 {
        let counts = [
            self.triangles.len(),
            self.spheres.len(),
            self.cones.len(),
            self.surfaces.len(),
            self.normals.len(),
            self.materials.len(),
            self.polygons.len(),
        ];
        let [triangles, spheres, cones, surfaces, normals, materials, polygons] = counts.map(|count| count as u64);
        let rest = [0, 0, triangles, spheres, cones, surfaces, normals, materials, polygons];
        let rest = Layout::padded(rest, self.layout.strides());
        // Both sections fill their granules.
        rest.map_or(0, |rest| (DATABASE_BYTES_MAX - rest.database_bytes()).saturating_sub(2 * GRANULE_BYTES))
    }

    /// Puts the octree's sections and these into one image. Each is let go as soon as it is copied.
    ///
    /// # Errors
    /// The image would be larger than can be addressed.
    pub fn assemble(self, octree: Vec<u32>, leaf_lists: Vec<u32>, max_depth: u32) -> Result<Database, TooLarge> {
        let sections: [Box<dyn Words>; Section::COUNT] = [
            Box::new(octree),
            Box::new(leaf_lists),
            Box::new(self.triangles),
            Box::new(self.spheres),
            Box::new(self.cones),
            Box::new(self.surfaces),
            Box::new(self.normals),
            Box::new(self.materials),
            Box::new(self.polygons),
        ];
        let records = Section::ALL.map(|s| sections[s as usize].words().len() as u64 * 4 / s.content_bytes());
        let layout = Layout::padded(records, self.layout.strides())?;
        let mut words = vec![0u32; (layout.database_bytes() / 4) as usize];
        for (section, source) in Section::ALL.into_iter().zip(sections) {
            let first = (layout.span(section).base.0 / 4) as usize;
            let (content, stride) = (section.content_bytes() as usize / 4, layout.record_bytes(section) as usize / 4);
            if stride == content {
                words[first..first + source.words().len()].copy_from_slice(source.words());
                continue;
            }
            let records = words[first..].chunks_exact_mut(stride);
            for (record, content) in records.zip(source.words().chunks_exact(content)) {
                record[..content.len()].copy_from_slice(content);
            }
        }
        let header = Header {
            layout,
            normalisation: self.normalisation,
            max_depth,
            scene_primitives: self.scene_primitives,
            has_sheets: self.has_sheets,
        };
        Ok(Database { header, words: words.into() })
    }
}

/// A section's records, whatever they are.
trait Words {
    fn words(&self) -> &[u32];
}

impl<T: bytemuck::Pod> Words for Vec<T> {
    fn words(&self) -> &[u32] {
        bytemuck::cast_slice(self)
    }
}

fn f32s(v: DVec3) -> [f32; 3] {
    v.as_vec3().to_array()
}

/// The records of all materials, and which record each material is: those with light terms take two.
fn materials(scene: &Scene) -> (Vec<Material>, Vec<u32>) {
    let (mut records, mut indices) =
        (Vec::with_capacity(material_records(scene)), Vec::with_capacity(scene.materials.len()));
    for material in &scene.materials {
        indices.push(records.len() as u32);
        let has_light_terms = has_light_terms(material);
        records.push(Material::new(material, has_light_terms));
        if has_light_terms {
            let terms = LightTerms {
                emission: f32s(material.emission),
                shadow_transmittance: material.shadow_transmittance as f32,
            };
            records.push(terms.into());
        }
    }
    (records, indices)
}

fn material_records(scene: &Scene) -> usize {
    scene.materials.len() + scene.materials.iter().filter(|material| has_light_terms(material)).count()
}

fn has_light_terms(material: &crate::scene::Material) -> bool {
    material.emission != DVec3::ZERO || material.shadow_transmittance > 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square, a bow tie, and a triangle and a square on a line, smooth so that nothing may get out of step.
    fn flawed() -> Scene {
        let polygons: [&[[f64; 2]]; 5] = [
            &[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]],
            &[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [2.0, 2.0]],
            &[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]],
            &[[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [1.5, 1.5]],
            &[[0.0, 0.0], [3.0, 0.0], [0.0, 1.0], [2.0, 2.0], [2.0, -1.0]],
        ];
        let mut scene = Scene { materials: vec![crate::scene::Material::WHITE], ..Scene::default() };
        for polygon in polygons {
            let first = scene.vertices.len() as u32;
            scene.vertices.extend(polygon.iter().map(|&[x, y]| DVec3::new(x, y, 0.0)));
            scene.polygons.push(Polygon {
                first_vertex: first,
                vertex_count: polygon.len() as u32,
                first_normal: Some(first),
                first_colour: None,
                material: 0,
            });
        }
        scene.normals = vec![DVec3::Z; scene.vertices.len()];
        scene
    }

    #[test]
    fn flawed_polygons_are_cut_and_named_by_their_lines() {
        let texts = |scene: &Scene| {
            let records = compile(scene).expect("small");
            assert_eq!(records.triangles.len(), 2 + 2 + 1 + 2 + 3);
            assert_eq!((records.surfaces.len(), records.normals.len()), (10, 10));
            records.warnings.iter().map(Warning::to_string).collect::<Vec<_>>()
        };
        let mut scene = flawed();
        let expected = [
            "polygon 1 (from 0) of 4 corners crosses itself, it is cut as well as can be (and 1 more)",
            "polygon 2 (from 0) of 3 corners has no area, nothing of it is seen (and 1 more)",
        ];
        assert_eq!(texts(&scene), expected);
        scene.file = Some("a.obj".into());
        scene.polygon_lines = vec![(0, 7), (1, 8), (3, 11), (4, 12)];
        let expected = [
            "a.obj:8:1: a polygon of 4 corners crosses itself, it is cut as well as can be (and 1 more)",
            "a.obj: polygon 2 (from 0) of 3 corners has no area, nothing of it is seen (and 1 more)",
        ];
        assert_eq!(texts(&scene), expected);
    }

    #[test]
    fn the_scenes_that_are_computed_give_no_warning() {
        use crate::scene::procedural::{Board, Kind, Procedural};
        for (kind, size) in
            [(Kind::Gears, 1), (Kind::Teapot, 12), (Kind::Balls, 2), (Kind::Tetra, 4), (Kind::Slivers, 2)]
        {
            let scene = Procedural { kind, size, board: Board::Squares }.scene();
            assert_eq!(compile(&scene).expect("records").warnings, [], "{kind}");
        }
    }

    #[test]
    fn what_is_too_large_is_told_before_anything_is_made() {
        // Vertices that are not even there.
        let polygon =
            Polygon { first_vertex: 0, vertex_count: 100_000_002, first_normal: None, first_colour: None, material: 0 };
        let scene = Scene { polygons: vec![polygon], ..Scene::default() };
        let error = compile(&scene).expect_err("too large");
        let told = "the database would be 5200000256 bytes or more, at most 4294967296 can be addressed";
        assert_eq!(error.to_string(), told);
        let smooth = Scene { polygons: vec![Polygon { first_normal: Some(0), ..polygon }], ..Scene::default() };
        let bytes = 5_200_000_256 + 3_600_000_000;
        assert_eq!(compile(&smooth).expect_err("too large"), CompileError::TooLarge(TooLarge { bytes }));
    }
}
