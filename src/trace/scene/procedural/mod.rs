//! Scenes written from their definitions: the ones of Haines' Standard Procedural Databases (SPD)
//! that the paper uses, two more of them, and five of our own that are hard for an octree.
//!
//! E. Haines, *A Proposal for Standard Graphics Environments*, IEEE Computer Graphics and Applications
//! 7 (11), 1987. The definitions are his; sizes, order, materials, lights and views are as in SPD 3.14.

mod balls;
mod corner;
mod decades;
mod gears;
mod giant;
mod kind;
mod plane;
mod random;
mod slivers;
mod teapot;
mod teapot_patches;
mod tetra;
mod writer;

use std::io::{self, BufWriter, Write};
use std::path::Path;

use glam::DVec3;
use serde::{Deserialize, Serialize};

pub use kind::{Kind, KindError, SizeError};
pub use teapot::Board;
pub use writer::write_nff;

use super::{Camera, Light, Material, Polygon, Scene};
use ground::atomic_file;

/// No kind is larger; each narrows it further.
pub const SIZE_MAX: u32 = 1000;

/// Which procedural scene, and how large.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Procedural {
    pub kind: Kind,
    /// Size factor, for SPD's scenes SPD's; its range depends on the kind.
    pub size: u32,
    /// Of a teapot; [`Board::Squares`] for all others.
    #[serde(default)]
    pub board: Board,
}

/// A kind that has no board was to be without it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0} has no board, expected teapot")]
pub struct BoardError(pub Kind);

#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    #[error(transparent)]
    Size(#[from] SizeError),
    #[error(transparent)]
    Board(#[from] BoardError),
    #[error(transparent)]
    Io(#[from] io::Error),
}

impl Procedural {
    /// `None`: the kind's default size.
    ///
    /// # Errors
    /// The kind is not made in this size.
    pub fn new(kind: Kind, size: Option<u32>) -> Result<Self, SizeError> {
        let size = size.unwrap_or(kind.default_size());
        let scene = Self { kind, size, board: Board::Squares };
        if kind.sizes().contains(&size) { Ok(scene) } else { Err(SizeError { kind, size }) }
    }

    /// The same with this board.
    ///
    /// # Errors
    /// The kind has none.
    pub fn on(self, board: Board) -> Result<Self, BoardError> {
        if self.kind == Kind::Teapot { Ok(Self { board, ..self }) } else { Err(BoardError(self.kind)) }
    }

    /// The scene in full precision; files have six digits.
    pub fn scene(&self) -> Scene {
        match self.kind {
            Kind::Gears => gears::scene(self.size),
            Kind::Teapot => teapot::scene(self.size, self.board),
            Kind::Balls => balls::scene(self.size),
            Kind::Tetra => tetra::scene(self.size),
            Kind::Slivers => slivers::scene(self.size),
            Kind::Plane => plane::scene(self.size),
            Kind::Decades => decades::scene(self.size),
            Kind::Giant => giant::scene(self.size),
            Kind::Corner => corner::scene(self.size),
        }
    }
}

/// Makes a procedural scene and writes it as NFF: to a file that is there whole or not at all, or to
/// standard output.
///
/// # Errors
/// The kind is not made in this size or has no board, or the output cannot be written. A reader of standard output that
/// has seen enough (`| head`) is no error.
pub fn write(kind: Kind, size: Option<u32>, board: Option<Board>, file: Option<&Path>) -> Result<(), WriteError> {
    let scene = Procedural::new(kind, size)?;
    let scene = board.map_or(Ok(scene), |board| scene.on(board))?.scene();
    match file {
        Some(file) => atomic_file::write(file, |out| write_nff(&scene, out))?,
        None => {
            let mut out = BufWriter::new(io::stdout().lock());
            match write_nff(&scene, &mut out).and_then(|()| out.flush()) {
                Err(error) if error.kind() == io::ErrorKind::BrokenPipe => {}
                written => written?,
            }
        }
    }
    Ok(())
}

/// What all of them have, as SPD's do: the sky blue background, an angle of 45°, 512 × 512 pixels, and lights that
/// share a brightness of 1/√n.
fn empty_scene<const LIGHTS: usize>(from: DVec3, at: DVec3, up: DVec3, lights: [DVec3; LIGHTS]) -> Scene {
    let colour = DVec3::splat(1.0 / (LIGHTS as f64).sqrt());
    Scene {
        camera: Some(Camera { from, at, up, angle_degrees: 45.0, resolution: Some((512, 512)) }),
        background: DVec3::new(0.078, 0.361, 0.753),
        lights: lights.map(|position| Light { position, colour }).into(),
        ..Scene::default()
    }
}

/// The Phong exponent whose highlight has fallen to one half at this angle.
fn shine(half_angle_degrees: f64) -> f64 {
    libm::log(0.5) / libm::log(libm::cos(half_angle_degrees.to_radians()))
}

/// The exponent that SPD writes for surfaces without a highlight.
const NO_SHINE: f64 = 100_000.0;

impl Scene {
    /// Adds the material of what is added after it.
    fn set_material(&mut self, material: Material) {
        self.materials.push(material);
    }

    fn material(&self) -> u32 {
        self.materials.len() as u32 - 1
    }

    fn add_polygon(&mut self, corners: &[DVec3]) {
        self.add_polygon_of(corners, self.material());
    }

    fn add_polygon_of(&mut self, corners: &[DVec3], material: u32) {
        let first_vertex = self.vertices.len() as u32;
        self.vertices.extend_from_slice(corners);
        let vertex_count = corners.len() as u32;
        self.polygons.push(Polygon { first_vertex, vertex_count, first_normal: None, first_colour: None, material });
    }

    fn add_smooth_polygon(&mut self, corners: &[DVec3], normals: &[DVec3]) {
        let first_normal = Some(self.normals.len() as u32);
        self.normals.extend_from_slice(normals);
        self.add_polygon(corners);
        if let Some(polygon) = self.polygons.last_mut() {
            polygon.first_normal = first_normal;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use crate::scene::nff;

    /// Output of SPD itself; `None`, loudly, where it is not there.
    pub(super) fn reference(name: &str) -> Option<PathBuf> {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/reference/scenes").join(name);
        if path.exists() {
            return Some(path);
        }
        eprintln!("SKIPPED: {} is absent, nothing was compared", path.display());
        None
    }

    pub(super) const REFERENCES: [(Kind, u32, &str); 4] = [
        (Kind::Gears, 2, "gears2.nff"),
        (Kind::Teapot, 12, "teapot12.nff"),
        (Kind::Balls, 4, "balls4.nff"),
        (Kind::Tetra, 6, "tetra6.nff"),
    ];

    fn assert_close(what: &str, ours: DVec3, theirs: DVec3) {
        let tolerance = 1e-5 * theirs.abs().max_element().max(1.0);
        assert!((ours - theirs).abs().max_element() <= tolerance, "{what}: {ours} is not {theirs}");
    }

    fn assert_same_scene(ours: &Scene, theirs: &Scene) {
        let counts = |s: &Scene| (s.polygons.len(), s.vertices.len(), s.normals.len(), s.spheres.len(), s.cones.len());
        assert_eq!(counts(ours), counts(theirs));
        assert!(ours.polygons == theirs.polygons, "vertex counts, kinds or materials, in order");
        for (&a, &b) in ours.vertices.iter().zip(&theirs.vertices) {
            assert_close("vertex", a, b);
        }
        for (&a, &b) in ours.normals.iter().zip(&theirs.normals) {
            assert_close("normal", a, b);
        }
        for (a, b) in ours.spheres.iter().zip(&theirs.spheres) {
            assert_close("centre", a.centre, b.centre);
            assert!((a.radius - b.radius).abs() <= 1e-5 && a.material == b.material);
        }
        assert_eq!(ours.materials.len(), theirs.materials.len());
        for (a, b) in ours.materials.iter().zip(&theirs.materials) {
            assert_close("diffuse", a.diffuse, b.diffuse);
            assert_close("highlight", a.highlight, b.highlight);
            assert_close("reflection", a.reflection, b.reflection);
            let scalars = |m: &Material| DVec3::new(m.shine, m.transmittance, m.ior);
            assert_close("shine, T, ior", scalars(a), scalars(b));
        }
        assert_eq!(ours.lights.len(), theirs.lights.len());
        for (a, b) in ours.lights.iter().zip(&theirs.lights) {
            assert_close("light", a.position, b.position);
            assert_eq!(a.colour, b.colour);
        }
        let (a, b) = (ours.camera.expect("a camera"), theirs.camera.expect("a camera"));
        assert_close("from", a.from, b.from);
        assert_close("at", a.at, b.at);
        assert_close("up", a.up, b.up);
        assert_eq!((a.angle_degrees, a.resolution), (b.angle_degrees, b.resolution));
        assert_eq!(ours.background, theirs.background);
    }

    #[test]
    fn scenes_are_those_of_spd() {
        for (kind, size, name) in REFERENCES {
            let Some(path) = reference(name) else { return };
            let theirs = nff::load(&path).expect("a reference scene");
            assert_same_scene(&Procedural { kind, size, board: Board::Squares }.scene(), &theirs);
        }
    }

    /// A file has a material wherever another one begins.
    fn with_materials_as_written(mut scene: Scene) -> Scene {
        let (mut written, mut current) = (Vec::new(), None);
        let polygons = scene.polygons.iter_mut().map(|p| &mut p.material);
        let spheres = scene.spheres.iter_mut().map(|s| &mut s.material);
        for material in polygons.chain(spheres).chain(scene.cones.iter_mut().map(|c| &mut c.material)) {
            if current.replace(*material) != Some(*material) {
                written.push(scene.materials[*material as usize]);
            }
            *material = written.len() as u32 - 1;
        }
        Scene { materials: written, ..scene }
    }

    #[test]
    fn what_is_written_reads_back_as_the_same_scene() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        for kind in Kind::ALL {
            let size = *kind.sizes().start() + 1;
            let file = folder.path().join(format!("{kind}.nff"));
            write(kind, Some(size), None, Some(&file)).expect("written");
            let written = with_materials_as_written(Procedural { kind, size, board: Board::Squares }.scene());
            assert_same_scene(&nff::load(&file).expect("valid"), &written);
        }
        let files = std::fs::read_dir(folder.path()).expect("a folder").count();
        assert_eq!(files, Kind::ALL.len(), "nothing but a file each");
    }

    #[test]
    fn primitives_are_as_many_as_the_definitions_say() {
        let scene = |kind, size| Procedural { kind, size, board: Board::Squares }.scene();
        let gears = scene(Kind::Gears, 4);
        let quads = gears.polygons.iter().filter(|p| p.vertex_count == 4).count();
        assert_eq!((quads, gears.polygons.len() - quads), (9217, 128));
        let teapot = scene(Kind::Teapot, 90);
        let smooth = teapot.polygons.iter().filter(|p| p.first_normal.is_some()).count();
        assert_eq!((smooth, teapot.polygons.len() - smooth), (517_680, 8100));
        assert_eq!(scene(Kind::Tetra, 10).polygons.len(), 1_048_576);
        for size in 1..=5 {
            assert_eq!(scene(Kind::Balls, size).spheres.len(), (9usize.pow(size + 1) - 1) / 8);
        }
    }

    #[test]
    fn our_own_are_as_large_as_they_say() {
        let counts = |kind, size| {
            let scene = Procedural::new(kind, size).expect("a size that is made").scene();
            (scene.polygons.len(), scene.spheres.len(), scene.cones.len())
        };
        assert_eq!(counts(Kind::Slivers, None), (10_001, 0, 0));
        assert_eq!(counts(Kind::Plane, None), (1_000_000, 0, 0));
        assert_eq!(counts(Kind::Plane, Some(3)), (900, 0, 0));
        assert_eq!(counts(Kind::Decades, None), (1, 10_000, 0));
        assert_eq!(counts(Kind::Giant, None), (513, 0, 0));
        assert_eq!(counts(Kind::Corner, None), (335, 25, 48));
    }

    fn extents(corners: &[DVec3]) -> DVec3 {
        let low = corners.iter().fold(DVec3::INFINITY, |low, &v| low.min(v));
        corners.iter().fold(DVec3::NEG_INFINITY, |high, &v| high.max(v)) - low
    }

    #[test]
    fn our_own_are_as_hard_as_they_say() {
        let scene = |kind| Procedural::new(kind, None).expect("a default").scene();
        let slivers = scene(Kind::Slivers);
        let width_ratio = |corners: &[DVec3]| {
            let (base, long) = (corners[1] - corners[0], corners[2] - corners[0]);
            base.length() / long.length()
        };
        let ratios: Vec<f64> = slivers.polygons[1..].iter().map(|p| width_ratio(slivers.corners(p))).collect();
        assert!(ratios.iter().all(|&ratio| ratio < 0.05) && ratios.iter().any(|&ratio| ratio < 2e-6));
        assert!(scene(Kind::Plane).vertices.iter().all(|v| v.z == 0.0));
        let radii: Vec<f64> = scene(Kind::Decades).spheres.iter().map(|s| s.radius).collect();
        assert!((radii[0] / radii[radii.len() - 1] - 1e9).abs() < 1.0);
        let giant = scene(Kind::Giant);
        let sizes: Vec<f64> = giant.polygons.iter().map(|p| extents(giant.corners(p)).max_element()).collect();
        assert!(sizes[1..].iter().all(|&size| (0.5e6..2e6).contains(&(sizes[0] / size))));
        let corner = scene(Kind::Corner);
        assert!(corner.polygons.iter().any(|p| p.vertex_count == 10), "concave ones");
        let (low, high) = corner.bounds().expect("a town");
        let town = low + (high - low) / 64.0;
        assert!(corner.vertices.iter().all(|v| v.cmple(town).all()));
        assert!(corner.spheres.iter().filter(|s| !s.centre.cmple(town).all()).count() == 1, "the moon");
    }

    /// Strewing does not depend on where, or on what else is made.
    #[test]
    fn the_same_scene_is_made_again() {
        for kind in Kind::ALL {
            let small = Procedural { kind, size: *kind.sizes().start(), board: Board::Squares };
            assert_eq!(small.scene(), small.scene(), "{kind}");
        }
    }

    #[test]
    fn a_teapot_without_its_board_is_the_rest_of_the_scene() {
        let with = Procedural::new(Kind::Teapot, None).expect("a default");
        let without = with.on(Board::None).expect("a teapot");
        let (with, without) = (with.scene(), without.scene());
        // The paper, sections 2.2 and 7.
        assert_eq!((without.polygons.len(), without.materials.len()), (9120, 1));
        let triangles = with.polygons.len() - without.polygons.len()..;
        for (a, b) in with.polygons[triangles].iter().zip(&without.polygons) {
            assert_eq!((with.corners(a), a.vertex_count, b.material), (without.corners(b), 3, 0));
        }
        assert_eq!((&with.normals, with.materials[2]), (&without.normals, without.materials[0]));
        assert_eq!((&with.lights, with.camera, with.background), (&without.lights, without.camera, without.background));
        for kind in Kind::ALL.into_iter().filter(|&kind| kind != Kind::Teapot) {
            let scene = Procedural::new(kind, None).expect("a default");
            assert_eq!(scene.on(Board::None), Err(BoardError(kind)));
        }
    }

    #[test]
    fn every_teapot_has_unit_normals() {
        for size in (2..40).chain([90]) {
            let teapot = Procedural { kind: Kind::Teapot, size, board: Board::Squares }.scene();
            assert!(teapot.normals.iter().all(|normal| normal.is_normalized()), "size {size}");
        }
    }

    #[test]
    fn the_largest_sizes_stay_below_forty_million() {
        for kind in Kind::ALL {
            let largest = *kind.sizes().end();
            assert!(kind.primitives(largest) <= 40_000_000, "{kind}");
            assert!(largest == 1000 || kind.primitives(largest + 1) > 40_000_000, "{kind}");
        }
    }

    #[test]
    fn sizes_and_names_are_checked() {
        assert_eq!(
            Procedural::new(Kind::Tetra, None),
            Ok(Procedural { kind: Kind::Tetra, size: 6, board: Board::Squares })
        );
        for kind in Kind::ALL {
            assert_eq!(kind.to_string().parse(), Ok(kind));
            assert!(kind.sizes().contains(&kind.default_size()));
            assert!(Procedural::new(kind, Some(0)).is_err());
            assert!(Procedural::new(kind, Some(u32::MAX)).is_err());
        }
        let error = Procedural::new(Kind::Gears, Some(42)).expect_err("too large");
        assert_eq!(
            error.to_string(),
            "gears of size 42: not made, it would be 42378338 triangles or spheres, expected a size from 1 to 41"
        );
        let error = "cube".parse::<Kind>().expect_err("no such kind");
        assert_eq!(error.to_string(), format!("\"cube\" is not a procedural scene, expected {}", Kind::LIST));
        assert_eq!(Kind::LIST.replace(" or ", ", "), Kind::ALL.map(Kind::name).join(", "));
    }
}
