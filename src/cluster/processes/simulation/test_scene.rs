//! What is rendered; where nothing else is asked for, 27 spheres, some of them mirrors, seen in one row of pixels, each of them a
//! tile.

use std::sync::OnceLock;

use glam::DVec3;

use ground::ids::TileId;
use trace::database::verify::Verified;
use trace::picture::AovSet;
use trace::picture::{ImageSettings, Rect, Sides, Tiling};
use trace::scene::{Camera, Light, Material, Scene, Sphere};
use trace::tracer::octree::{BuildParameters, build_database};
use trace::tracer::slices::Slices;
use trace::tracer::{TileTracer, View};

/// A database, and an image of it.
#[derive(Clone, Debug)]
pub(super) struct TestScene {
    pub(super) database: Verified,
    pub(super) view: View,
    pub(super) tiling: Tiling,
}

impl TestScene {
    pub(super) fn spheres(tiles: u32) -> Self {
        let tiling = Tiling::new(Sides { width: tiles, height: 1, tile_width: 1, tile_height: 1 });
        Self { database: database().clone(), view: view(tiles), tiling: tiling.expect("possible") }
    }
}

/// The database, made once.
pub(in crate::processes) fn database() -> &'static Verified {
    static DATABASE: OnceLock<Verified> = OnceLock::new();
    DATABASE.get_or_init(|| {
        let colour = |r, g, b| Material::from_nff(DVec3::new(r, g, b), 0.7, 0.3, 20.0, 0.0, 1.0);
        let spheres = (0..27u32).map(|i| {
            let centre = DVec3::new(f64::from(i % 3), f64::from(i / 3 % 3), f64::from(i / 9));
            Sphere { centre, radius: 0.4, material: i % 2 }
        });
        let scene = Scene {
            materials: vec![colour(1.0, 0.5, 0.2), colour(0.1, 0.4, 0.9)],
            spheres: spheres.collect(),
            ..Scene::default()
        };
        build_database(&scene, BuildParameters { leaf_size: 2, max_depth: 8 }).expect("a small scene")
    })
}

/// So many pixels wide.
pub(in crate::processes) fn view(tiles: u32) -> View {
    let from = DVec3::new(6.0, 5.0, 4.0);
    View {
        camera: Camera { from, at: DVec3::ONE, up: DVec3::Z, angle_degrees: 35.0, resolution: None },
        lights: vec![Light { position: DVec3::new(9.0, 1.0, 9.0), colour: DVec3::ONE }],
        background: DVec3::splat(0.1),
        image: ImageSettings::new(tiles, 1, 3, 0.0).expect("possible settings"),
    }
}

/// The colour of each tile, traced without any process.
pub(super) fn colours(tiles: u32) -> Vec<[f32; 3]> {
    let mut tracer = TileTracer::new(&database().database().header, &view(tiles), true);
    let mut slices = Slices::new(database());
    let trace = |TileId(x)| {
        let rect = Rect { x, y: 0, width: 1, height: 1 };
        let Ok((pixels, _)) = tracer.trace(&mut slices, rect, AovSet::default());
        pixels.colour[0]
    };
    (0..tiles).map(TileId).map(trace).collect()
}
