//! One scene of every kind of surface, rendered at sizes and places far apart: the same image, but for pixels whose
//! ray passes an edge by rounding only.

use glam::DVec3;
use trace::picture::{AovSet, ImageSettings, Pixels};
use trace::render::{Kernel, Settings, render};
use trace::scene::{Camera, Light, Material, Placement, Polygon, Scene, Sphere};
use trace::tracer::View;
use trace::tracer::bvh8::Bvh8;
use trace::tracer::octree::{BuildParameters, build_database};
use trace::tracer::simd::Simd;

pub(crate) const SIDE: u32 = 128;

/// Renders with four bounces by every kernel, which have to agree bit by bit, and counts the pixels whose radiance is
/// not finite.
pub(crate) fn image(scene: &Scene) -> (Pixels, u64) {
    let database = build_database(scene, BuildParameters { leaf_size: 8, max_depth: 12 }).expect("builds");
    let view = View {
        camera: scene.camera.expect("a camera"),
        lights: scene.lights.clone(),
        background: scene.background,
        image: ImageSettings::new(SIDE, SIDE, 4, 0.001).expect("possible").with_terminator(scene.terminator),
    };
    let bvh = Bvh8::build(&database);
    let kernels = Simd::available().map(|simd| Kernel::Packets(&bvh, simd));
    let mut images = kernels.chain([Kernel::Single { mailbox: true }]).map(|kernel| {
        let settings = Settings { threads: 1, aov: AovSet { depth: true, normal: true, primitive: true }, kernel };
        let rendering =
            render(&database, &view, settings, |_| std::ops::ControlFlow::Continue(())).expect("a small image");
        (rendering.frame.pixels().clone(), rendering.stats.non_finite_pixels, rendering.stats.rays)
    });
    let first = images.next().expect("scalar code is always there");
    for image in images {
        assert_eq!(image, first);
    }
    let (pixels, non_finite_pixels, _) = first;
    (pixels, non_finite_pixels)
}

pub(crate) fn placed(scene: &Scene, scale: f64, translation: f64) -> Scene {
    let mut scene = scene.clone();
    scene.place(Placement { scale, translation }).expect("it stays finite");
    scene
}

/// What extents and offsets every scene here is put to. At 1e7 f64 leaves 1.9e-9 of a unit.
pub(crate) const PLACEMENTS: [(f64, f64); 4] = [(1.0, 0.0), (1e-12, 0.0), (1e12, 0.0), (1.0, 1e7)];

pub(crate) fn add_polygon(scene: &mut Scene, corners: &[DVec3]) {
    let polygon = Polygon {
        first_vertex: scene.vertices.len() as u32,
        vertex_count: corners.len() as u32,
        first_normal: None,
        first_colour: None,
        material: scene.materials.len() as u32 - 1,
    };
    scene.vertices.extend(corners);
    scene.polygons.push(polygon);
}

/// The six faces of a cube, seen from outside.
pub(crate) fn add_cube(scene: &mut Scene, centre: DVec3, half: f64) {
    for axis in 0..3 {
        for side in [1.0, -1.0] {
            let corner = |u: f64, v: f64| {
                let mut at = DVec3::ZERO;
                (at[axis], at[(axis + 1) % 3], at[(axis + 2) % 3]) = (side, u * side, v);
                centre + at * half
            };
            add_polygon(scene, &[corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]);
        }
    }
}

pub(crate) fn add_sphere(scene: &mut Scene, centre: DVec3, radius: f64) {
    let material = scene.materials.len() as u32 - 1;
    scene.spheres.push(Sphere { centre, radius, material });
}

pub(crate) fn camera(from: DVec3, at: DVec3) -> Option<Camera> {
    Some(Camera { from, at, up: DVec3::Z, angle_degrees: 45.0, resolution: None })
}

/// A floor, a mirror ball, a glass ball, a matt ball, a glossy and a glass cube, a wall that mirrors; three lights.
fn still_life() -> Scene {
    let matt = Material::from_nff(DVec3::new(0.8, 0.7, 0.5), 0.8, 0.0, 1.0, 0.0, 1.0);
    let mirror = Material::from_nff(DVec3::new(0.9, 0.9, 1.0), 0.2, 0.8, 30.0, 0.0, 1.0);
    let glass = Material::from_nff(DVec3::ONE, 0.1, 0.1, 60.0, 0.8, 1.5);
    let mut scene = Scene {
        camera: camera(DVec3::new(2.7, -3.1, 1.9), DVec3::new(0.0, 0.0, 0.4)),
        background: DVec3::new(0.1, 0.2, 0.4),
        ..Scene::default()
    };
    let light = |x, y, z, brightness| Light { position: DVec3::new(x, y, z), colour: DVec3::splat(brightness) };
    scene.lights = vec![light(3.0, -1.0, 4.0, 0.5), light(-2.0, -3.0, 3.0, 0.3), light(0.3, 0.2, 5.0, 0.2)];
    scene.materials.push(matt);
    let floor = [[-3.0, -3.0], [3.0, -3.0], [3.0, 3.0], [-3.0, 3.0]].map(|[x, y]| DVec3::new(x, y, 0.0));
    add_polygon(&mut scene, &floor);
    add_sphere(&mut scene, DVec3::new(0.9, 0.7, 0.31), 0.31);
    scene.materials.push(mirror);
    add_sphere(&mut scene, DVec3::new(-0.6, -0.4, 0.52), 0.52);
    add_cube(&mut scene, DVec3::new(0.3, 1.2, 0.41), 0.41);
    let wall = [[-2.0, 0.0], [1.0, 0.0], [1.0, 2.0], [-2.0, 2.0]].map(|[x, z]| DVec3::new(x, 2.3 + x * 0.1, z));
    add_polygon(&mut scene, &wall);
    scene.materials.push(glass);
    add_sphere(&mut scene, DVec3::new(0.5, -0.9, 0.45), 0.45);
    add_cube(&mut scene, DVec3::new(1.4, -0.3, 0.27), 0.26);
    scene
}

/// Of 16,384 pixels this many may differ by more than [`SLIGHT`] in a channel: those whose ray, or a ray that it
/// leads to, passes an edge, a silhouette or a shadow's outline within rounding. Normalised coordinates differ by one
/// rounding of f32, 6e-8, or at 1e7 by that of f64 there; four bounces off balls multiply it to some 1e-5, and a pixel
/// is some 1e-2 wide: of the pixels that have such an outline in them, about half of all, one in a thousand. That is
/// ten; measured are none.
const PIXELS_THAT_MAY_DIFFER: usize = 10;

/// What rounding may change in the shading of a point: a highlight of exponent 60 multiplies the 1e-5 by up to that,
/// at weights below one; half a step of 8 bits is 2e-3. Measured: 1.0e-6.
const SLIGHT: f32 = 1e-4;

/// On the average of all pixels. Measured: 2.3e-10.
const MEAN_DIFFERENCE: f64 = 1e-6;

#[test]
fn size_and_place_do_not_change_the_image() {
    let scene = still_life();
    let (expected, non_finite) = image(&scene);
    assert_eq!(non_finite, 0);
    let bright = expected.colour.iter().filter(|c| c.iter().any(|&c| c > 0.3)).count();
    assert!(bright > 3000, "an image of something: {bright}");
    for (scale, offset) in PLACEMENTS {
        let (found, non_finite) = image(&placed(&scene, scale, offset));
        assert_eq!(non_finite, 0, "scaled by {scale:e}, moved by {offset:e}");
        assert!(found.colour.iter().flatten().all(|c| c.is_finite()));
        let difference = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).map(|i| (a[i] - b[i]).abs()).fold(0.0, f32::max);
        let differences: Vec<f32> = found.colour.iter().zip(&expected.colour).map(difference).collect();
        let outlines = differences.iter().filter(|&&d| d > SLIGHT).count();
        let mean = differences.iter().map(|&d| f64::from(d)).sum::<f64>() / differences.len() as f64;
        let largest = differences.iter().copied().fold(0.0, f32::max);
        println!("scaled by {scale:e}, moved by {offset:e}: {outlines} pixels, mean {mean:e}, largest {largest:e}");
        assert!(outlines <= PIXELS_THAT_MAY_DIFFER, "scaled by {scale:e}, moved by {offset:e}: {outlines} pixels");
        assert!(mean <= MEAN_DIFFERENCE, "scaled by {scale:e}, moved by {offset:e}: {mean:e}");
    }
}
