//! Scenes of any size, anywhere.

use glam::DVec3;
use trace::database::verify::Verified;
use trace::picture::ImageSettings;
use trace::preparation::{ViewChoices, view};
use trace::scene::SceneSource;
use trace::scene::{Material, Placement, Scene, Sphere};
use trace::tracer::octree::{BuildParameters, build_database};
use trace::tracer::primary::PrimaryRays;
use trace::tracer::ray::Ray;

use crate::images::{add_cube, add_polygon};
use crate::subjects::{Chance, bits, f32s, hits_of, ray};

const SIDE: u32 = 96;

/// The bits of every pixel's first hit.
fn first_hits(name: &str, placement: Placement) -> Vec<Option<(u32, u32)>> {
    let mut scene = name.parse::<SceneSource>().expect("a scene").load().expect("it can be read");
    scene.place(placement).expect("it stays finite");
    let image = |_: &_| Ok(ImageSettings::new(SIDE, SIDE, 0, 0.0).expect("possible"));
    let view = view(&scene, &ViewChoices::default(), image).expect("a view");
    let database = database(&scene);
    let camera = PrimaryRays::new(&database.database().header, &view);
    let ray = |i: u32| Ray::from_eye(camera.eye, camera.direction(i % SIDE, i / SIDE)).map(|(ray, _)| ray);
    // In place of one that misses the root, a ray that hits nothing.
    let nothing = crate::subjects::ray([0.0; 3], [0.0; 3]);
    let rays: Vec<Ray> = (0..SIDE * SIDE).map(|i| ray(i).unwrap_or(nothing)).collect();
    hits_of(&database, &rays).iter().map(bits).collect()
}

fn database(scene: &Scene) -> Verified {
    build_database(scene, BuildParameters { leaf_size: 4, max_depth: 12 }).expect("builds")
}

fn ids(hits: &[Option<(u32, u32)>]) -> Vec<Option<u32>> {
    hits.iter().map(|hit| hit.map(|(_, id)| id)).collect()
}

const SCENES: [&str; 4] = ["teapot:4", "gears:1", "balls:2", "scenes/primitives.nff"];

/// Cases 16 and 17: of extent 1e-20 and 1e20, every pixel sees the primitive that it sees at the scene's own extent.
#[test]
fn tiny_and_huge_scenes_show_the_same_primitives() {
    for name in SCENES {
        let expected = ids(&first_hits(name, Placement { scale: 1.0, translation: 0.0 }));
        for scale in [1e-20, 1e-12, 1e12, 1e20] {
            let found = ids(&first_hits(name, Placement { scale, translation: 0.0 }));
            let other = found.iter().zip(&expected).filter(|(a, b)| a != b).count();
            assert_eq!(other, 0, "{name}, scaled by {scale:e}: pixels that differ");
        }
    }
}

/// Case 35: scaled by a power of two, every hit keeps its bits.
#[test]
fn powers_of_two_change_no_bit() {
    for name in SCENES {
        let expected = first_hits(name, Placement { scale: 1.0, translation: 0.0 });
        for power in [-200, -20, -1, 1, 20, 200] {
            let found = first_hits(name, Placement { scale: 2f64.powi(power), translation: 0.0 });
            assert!(found == expected, "{name}, scaled by 2^{power}");
        }
    }
}

/// Case 18: at an offset of 1e7, where f64 leaves some 2e-9 of a unit, nothing is lost; only pixels whose ray passes
/// an edge by that little may see another primitive: at most one in a thousand.
#[test]
fn far_from_the_origin_nothing_is_lost() {
    for name in SCENES {
        let expected = ids(&first_hits(name, Placement { scale: 1.0, translation: 0.0 }));
        let found = ids(&first_hits(name, Placement { scale: 1.0, translation: 1e7 }));
        let other = found.iter().zip(&expected).filter(|(a, b)| a != b).count();
        assert!(other <= (SIDE * SIDE / 1000) as usize, "{name}: {other} pixels differ");
    }
}

/// Case 19: an object of 1e-6 in a scene of 1e6. In the middle, where f32 is fine enough, it is hit; elsewhere it is
/// smaller than a unit in the last place and may vanish, but nothing is hit where it is not.
#[test]
fn a_tiny_object_in_a_huge_scene() {
    let mut chance = Chance::new(19);
    for at in [DVec3::ZERO, DVec3::new(3e5, -2e5, 1e5)] {
        let mut scene = Scene { materials: vec![Material::WHITE], ..Scene::default() };
        add_cube(&mut scene, DVec3::ZERO, 1e6);
        let square = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        add_polygon(&mut scene, &square.map(|[x, y]| at + DVec3::new(x, y, 0.0) * 1e-6));
        scene.spheres.push(Sphere { centre: at + DVec3::Z * 1e-5, radius: 1e-6, material: 0 });
        let database = database(&scene);
        let target = database.database().header.normalisation.point(at);
        let mut rays = vec![ray(f32s(target - DVec3::Z * 0.5), [0.0, 0.0, 1.0])];
        rays.extend((0..2000).map(|i| {
            let origin = target + chance.direction() * [0.2, 1e-6][i % 2];
            let beside = chance.point() * [0.0, 1e-12, 1e-7][i % 3];
            ray(f32s(origin), f32s((target + beside - origin).normalize()))
        }));
        let hits = hits_of(&database, &rays);
        assert!(hits.iter().all(Option::is_some), "what is behind it is hit at least");
        if at == DVec3::ZERO {
            assert!([12, 13].contains(&hits[0].expect("a hit").primitive.0), "{:?}", hits[0]);
        }
    }
}
