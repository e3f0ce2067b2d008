//! Geometry and rays by chance, shrunk by proptest to the smallest that fails. The seed is fixed: every run tests the
//! same cases.

use glam::DVec3;
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestCaseError, TestRng, TestRunner};
use trace::database::verify::Verified;
use trace::oracle::verify;
use trace::picture::ImageSettings;
use trace::scene::{Camera, Cone, Material, Placement, Polygon, Scene, Sphere};
use trace::tracer::View;
use trace::tracer::octree::{BuildParameters, build_database};

/// Rays a scene: through pixels, anywhere, along axes, at edges and vertices, from surfaces.
const RAYS: u64 = 400;

fn runner(cases: u32) -> TestRunner {
    let config = Config { cases, failure_persistence: None, ..Config::default() };
    TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha))
}

/// No kernel may lose a hit of the scene or make one up, wherever it stands and whatever the tree.
fn hold(cases: u32, triangles: impl Strategy<Value = Vec<[DVec3; 3]>>) {
    let everything = (triangles, curved(), placement(), tree(), any::<u64>());
    let held = runner(cases).run(&everything, |(triangles, (spheres, cones), placement, tree, seed)| {
        let mut scene = Scene { materials: vec![Material::WHITE], spheres, cones, ..Scene::default() };
        for corners in triangles {
            let first_vertex = scene.vertices.len() as u32;
            scene.vertices.extend(corners);
            scene.polygons.push(Polygon {
                first_vertex,
                vertex_count: 3,
                first_normal: None,
                first_colour: None,
                material: 0,
            });
        }
        scene.place(placement).map_err(|error| TestCaseError::reject(error.to_string()))?;
        let database = build_database(&scene, tree).map_err(|error| TestCaseError::fail(error.to_string()))?;
        let verification = verify(&database, &view(&database), RAYS, seed);
        prop_assert!(verification.holds(), "{:#?}", verification.disagreements);
        Ok(())
    });
    if let Err(failure) = held {
        panic!("{failure}");
    }
}

/// From beside the root, in the coordinates of the world.
fn view(database: &Verified) -> View {
    let normalisation = database.database().header.normalisation;
    let world = |normalised: DVec3| normalisation.centre + normalised.map(|x| normalisation.world_length(x));
    View {
        camera: Camera {
            from: world(DVec3::new(1.5, 2.5, 3.5)),
            at: world(DVec3::ZERO),
            up: DVec3::Z,
            angle_degrees: 40.0,
            resolution: None,
        },
        lights: Vec::new(),
        background: DVec3::ZERO,
        image: ImageSettings::new(64, 64, 0, 0.0).expect("possible"),
    }
}

fn coordinate() -> impl Strategy<Value = f64> {
    prop_oneof![4 => -1.0..1.0f64, 1 => (-16..=16i32).prop_map(|k| f64::from(k) / 16.0), 1 => Just(0.0)]
}

fn point() -> impl Strategy<Value = DVec3> {
    [coordinate(), coordinate(), coordinate()].prop_map(DVec3::from_array)
}

/// A length of any magnitude from one down to `10^-most`.
fn length(most: f64) -> impl Strategy<Value = f64> {
    (0.0..most).prop_map(|power| 10f64.powf(-power))
}

/// A few spheres and cones beside, or none.
fn curved() -> impl Strategy<Value = (Vec<Sphere>, Vec<Cone>)> {
    let sphere = (point(), length(6.0), any::<bool>()).prop_map(|(centre, radius, inside)| Sphere {
        centre,
        radius: if inside { -radius } else { radius },
        material: 0,
    });
    let cone = (point(), point(), length(4.0), 0.0..1.0f64).prop_filter("two ends", |(a, b, ..)| a != b).prop_map(
        |(base, apex, base_radius, taper)| Cone {
            base,
            base_radius,
            apex,
            apex_radius: base_radius * taper,
            material: 0,
        },
    );
    (prop::collection::vec(sphere, 0..3), prop::collection::vec(cone, 0..3))
}

/// Extents from 1e-20 to 1e20; offsets up to 1e9 at extents down to a thousandth.
fn placement() -> impl Strategy<Value = Placement> {
    prop_oneof![
        Just(Placement { scale: 1.0, translation: 0.0 }),
        (-20.0..20.0f64).prop_map(|power| Placement { scale: 10f64.powf(power), translation: 0.0 }),
        (-9.0..9.0f64, -3.0..3.0f64).prop_map(|(power, scale)| Placement {
            scale: 10f64.powf(scale),
            translation: power.signum() * 10f64.powf(power.abs()),
        }),
    ]
}

fn tree() -> impl Strategy<Value = BuildParameters> {
    (1..12u32, 0..=20u32).prop_map(|(leaf_size, max_depth)| BuildParameters { leaf_size, max_depth })
}

#[test]
fn soups() {
    let triangle = (point(), length(3.0), [point(), point(), point()]);
    hold(120, prop::collection::vec(triangle.prop_map(|(at, size, corners)| corners.map(|c| at + c * size)), 0..60));
}

/// Up to a thousand million times as long as wide.
#[test]
fn slivers() {
    let sliver = (point(), point(), point(), length(9.0), 0.0..1.0f64)
        .prop_map(|(a, b, aside, width, share)| [a, b, a.lerp(b, share) + aside * width]);
    hold(120, prop::collection::vec(sliver, 1..40));
}

/// Around a hub, flat or not, of up to 48 triangles.
#[test]
fn fans() {
    let fan = (point(), length(6.0), prop::collection::vec(point(), 3..49)).prop_map(|(hub, size, rim)| {
        (0..rim.len()).map(|i| [hub, hub + rim[i] * size, hub + rim[(i + 1) % rim.len()] * size]).collect()
    });
    hold(120, fan);
}

/// Overlapping triangles in a few planes that lie close together or are one, along an axis or askew.
#[test]
fn coplanar_stacks() {
    let layer = ([point(), point(), point()], prop_oneof![3 => Just(0.0), 1 => length(9.0)]);
    let stack = (prop::collection::vec(layer, 1..40), 0..4usize).prop_map(|(layers, axis)| {
        let flat = |mut corner: DVec3, height: f64| {
            match axis {
                3 => corner.z = height - corner.x - corner.y,
                axis => corner[axis] = height,
            }
            corner
        };
        layers.into_iter().map(|(corners, height)| corners.map(|corner| flat(corner, height))).collect()
    });
    hold(120, stack);
}

/// A triangle of any size beside others of any other size.
#[test]
fn sizes_far_apart() {
    let triangle = (point(), length(12.0), [point(), point(), point()]);
    hold(
        120,
        prop::collection::vec(triangle.prop_map(|(at, size, corners)| corners.map(|c| at * 0.5 + c * size)), 1..30),
    );
}
