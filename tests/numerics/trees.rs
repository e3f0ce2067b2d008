//! The octree has no say in what is hit.

use glam::DVec3;
use trace::database::verify::Verified;
use trace::picture::{AovSet, ImageSettings};
use trace::render::{Kernel, Settings, render};
use trace::scene::{Camera, Scene, Sphere, UpAxis};
use trace::tracer::hit::Hit;
use trace::tracer::octree::{BuildParameters, build_database, hero::Hero};
use trace::tracer::slices::Slices;
use trace::tracer::{TraceStats, View};

use crate::subjects::{Chance, Pieces, TREES, bits, f32s, hits_of, ray};

/// Case 28: a hit that lies outside of the leaf in which it was found does not hide a nearer one in the next leaf.
#[test]
fn a_hit_outside_of_the_leaf_does_not_hide_a_nearer_one() {
    let mut pieces = Pieces::default();
    // Long and slanted: met first in a leaf near the origin, hit far behind it.
    pieces.add([[-0.9, -0.9, 0.9], [-0.9, 0.9, 0.9], [0.9, 0.0, -0.9]]);
    // Small, in between.
    for k in 0..8 {
        let x = -0.8 + 0.1 * k as f32;
        pieces.add([[x, -0.05, -0.75], [x, 0.05, -0.75], [x, 0.0, -0.65]]);
    }
    assert_eq!(pieces.hit(ray([-1.0, 0.0, -0.7], [1.0, 0.0, 0.0])).map(|hit| hit.1), Some(1));
    let mut chance = Chance::new(28);
    let mut pieces = chance.soup(60);
    for _ in 0..60 {
        pieces.add([0; 3].map(|_| f32s(chance.point())));
    }
    let rays: Vec<_> = (0..2000).map(|_| ray(f32s(chance.point()), f32s(chance.direction()))).collect();
    assert!(pieces.hits(&rays).iter().flatten().count() > 1000);
}

fn colours(database: &Verified, view: &View, mailbox: bool) -> Vec<u32> {
    let settings = Settings { threads: 1, aov: AovSet::default(), kernel: Kernel::Single { mailbox } };
    let rendering = render(database, view, settings, |_| std::ops::ControlFlow::Continue(()));
    let frame = rendering.expect("a small image").frame;
    frame.pixels().colour.iter().flatten().map(|c| c.to_bits()).collect()
}

fn view(scene: &Scene, side: u32) -> View {
    let camera = Camera::framing(scene.bounds(), UpAxis::Y, 1.0, 45.0);
    View {
        camera,
        lights: camera.framing_lights().to_vec(),
        background: DVec3::splat(0.25),
        image: ImageSettings::new(side, side, 3, 0.01).expect("possible"),
    }
}

/// Cases 31 and 34: octrees of depth 0, 1 and 20, with and without a mailbox, give one image.
///
/// Case 33, bits that do not depend on the number of nodes, is `same_image` of the integration tests: 1, 2, 4 and 9
/// nodes. The octree is always built eagerly; lazy building, the case's other half, does not exist.
#[test]
fn depth_and_mailbox_do_not_change_the_image() {
    let mut scene = "teapot:3".parse::<trace::scene::SceneSource>().map(|s| s.load());
    let scene = scene.as_mut().expect("a procedural scene").as_mut().expect("it can be made");
    let view = view(scene, 48);
    let mut images = [(8, 0), (8, 1), (8, 20), (1, 20)].into_iter().flat_map(|(leaf_size, max_depth)| {
        let database = build_database(scene, BuildParameters { leaf_size, max_depth }).expect("small");
        [true, false].map(|mailbox| colours(&database, &view, mailbox))
    });
    let first = images.next().expect("an image");
    assert!(first.iter().any(|c| *c != first[0]), "an image of something");
    assert!(images.all(|image| image == first));
}

/// Case 34: every hit is the same without a mailbox.
#[test]
fn the_mailbox_does_not_change_a_hit() {
    let mut chance = Chance::new(34);
    let pieces = chance.soup(200);
    let rays: Vec<_> = (0..1000).map(|_| ray(f32s(chance.point()), f32s(chance.direction()))).collect();
    for tree in TREES {
        let database = pieces.database(tree);
        let hits = |mailbox| -> Vec<Option<Hit>> {
            let (mut hero, mut port) = (Hero::new(&database.database().header, mailbox), Slices::new(&database));
            let mut stats = TraceStats::default();
            let nearest = |ray| {
                let Ok(hit) = hero.nearest(&mut port, ray, &mut stats);
                hit
            };
            rays.iter().map(nearest).collect()
        };
        let (with, without) = (hits(true), hits(false));
        assert!(with.iter().map(bits).eq(without.iter().map(bits)), "{tree:?}");
    }
}

/// Case 32: an empty scene, and one that is a single point.
#[test]
fn nothing_and_a_point() {
    let mut chance = Chance::new(32);
    let rays: Vec<_> = (0..200).map(|_| ray(f32s(chance.point()), f32s(chance.direction()))).collect();
    assert!(Pieces::default().hits(&rays).iter().all(Option::is_none));

    let empty = Scene::default();
    for place in [DVec3::ZERO, DVec3::splat(1e9), DVec3::new(-1e-20, 3.0, 1e20)] {
        let mut point = Scene { materials: vec![trace::scene::Material::WHITE], ..Scene::default() };
        point.vertices = vec![place; 3];
        point.polygons = vec![trace::scene::Polygon {
            first_vertex: 0,
            vertex_count: 3,
            first_normal: None,
            first_colour: None,
            material: 0,
        }];
        for scene in [&empty, &point] {
            for tree in TREES {
                let database = build_database(scene, tree).expect("nothing to build");
                assert!(hits_of(&database, &rays).iter().all(Option::is_none));
                let colours = colours(&database, &view(scene, 8), true);
                assert!(colours.iter().all(|&c| f32::from_bits(c) == 0.25), "all of it is background");
            }
        }
    }
    // The smallest sphere there can be is as large as the root.
    let radius = f64::from_bits(1);
    let mut scene = Scene { materials: vec![trace::scene::Material::WHITE], ..Scene::default() };
    scene.spheres.push(Sphere { centre: DVec3::ZERO, radius, material: 0 });
    for tree in TREES {
        hits_of(&build_database(&scene, tree).expect("one sphere"), &rays);
    }
}
