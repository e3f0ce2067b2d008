//! Shadows and lights where rounding could show: no acne, no leak, no radiance that is not finite.

use glam::DVec3;
use trace::oracle::ClosedMesh;
use trace::scene::{Light, Material, Scene};

use crate::images::{PLACEMENTS, SIDE, add_cube, add_polygon, add_sphere, camera, image, placed};

fn white(position: DVec3) -> Light {
    Light { position, colour: DVec3::ONE }
}

/// Nothing but diffuse: what is lit is not black, and what is black is not lit.
const MATT: Material = Material::WHITE;

/// No acne: of a closed convex surface, every pixel that faces the light is lit and no other is, at every size and
/// place. For cosines nearer to zero than this, rounding of the normal decides.
#[test]
fn a_convex_surface_does_not_shadow_itself() {
    const TERMINATOR: f64 = 1e-5;
    let ball = {
        let mut scene = Scene { materials: vec![MATT], ..Scene::default() };
        add_sphere(&mut scene, DVec3::ZERO, 1.0);
        scene
    };
    let cube = {
        let mut scene = Scene { materials: vec![MATT], ..Scene::default() };
        add_cube(&mut scene, DVec3::ZERO, 0.8);
        scene
    };
    for (name, mut scene) in [("ball", ball), ("cube", cube), ("mesh", ClosedMesh::icosahedron(4).scene())] {
        let (eye, light) = (DVec3::new(1.9, -2.3, 1.4), DVec3::new(3.0, 1.0, 2.5));
        scene.camera = camera(eye, DVec3::ZERO);
        scene.lights = vec![white(light)];
        for (scale, offset) in PLACEMENTS {
            let name = format!("{name}, scaled by {scale:e}, moved by {offset:e}");
            let (pixels, non_finite) = image(&placed(&scene, scale, offset));
            assert_eq!(non_finite, 0, "{name}");
            let (mut lit, mut dark) = (0, 0);
            for (i, colour) in pixels.colour.iter().enumerate() {
                if pixels.primitive[i] < 0 {
                    continue;
                }
                let normal = DVec3::from(pixels.normal[i].map(f64::from));
                let position = eye + direction(&scene, i) * (f64::from(pixels.depth[i]) / scale);
                let cosine = normal.dot((light - position).normalize());
                let is_lit = colour[0] > 0.0;
                if cosine > TERMINATOR {
                    assert!(is_lit, "{name}: acne in pixel {i}, cosine {cosine}");
                    lit += 1;
                } else if cosine < -TERMINATOR {
                    assert!(!is_lit, "{name}: light on the far side in pixel {i}, cosine {cosine}");
                    dark += 1;
                }
            }
            assert!(lit > 500 && dark > 200, "{name}: {lit} lit, {dark} dark");
        }
    }
}

/// Through the centre of a pixel of the scene as it stands at the origin.
fn direction(scene: &Scene, pixel: usize) -> DVec3 {
    let camera = scene.camera.expect("a camera");
    let forward = (camera.at - camera.from).normalize();
    let right = forward.cross(camera.up).normalize();
    let half = (camera.angle_degrees.to_radians() / 2.0).tan();
    let place = |i: usize| 2.0 * (i as f64 + 0.5) / f64::from(SIDE) - 1.0;
    let (across, down) = (place(pixel % SIDE as usize), place(pixel / SIDE as usize));
    (forward + right * (half * across) - right.cross(forward) * (half * down)).normalize()
}

/// No leak: inside of a closed box that is lit from outside, all is black, edges and corners too.
#[test]
fn a_closed_box_is_dark_inside() {
    let cube = {
        let mut scene = Scene { materials: vec![MATT], ..Scene::default() };
        add_cube(&mut scene, DVec3::ZERO, 1.0);
        scene
    };
    let mesh = ClosedMesh::cube_of_fans(12).scene();
    let torus = ClosedMesh::torus(48, 24).scene();
    let inside = [("cube", cube, DVec3::ZERO), ("fans", mesh, DVec3::ZERO), ("torus", torus, DVec3::X * 0.7)];
    for (name, mut scene, eye) in inside {
        let eye = eye + DVec3::new(0.01, 0.02, -0.03);
        scene.background = DVec3::ONE;
        // Beside edges and corners, near and far.
        scene.lights = [[2.0, 2.0, 2.0], [1.5, 1.5, 0.0], [0.0, 0.0, 1.001], [-40.0, 3.0, 0.1], [1.01, -1.01, -1.01]]
            .map(|at| white(DVec3::from(at)))
            .to_vec();
        for towards in [DVec3::ONE, DVec3::new(-1.0, 0.9, 0.2), DVec3::new(0.1, -0.2, -1.0)] {
            scene.camera = camera(eye, eye + towards);
            for (scale, offset) in PLACEMENTS {
                let (pixels, non_finite) = image(&placed(&scene, scale, offset));
                let bright = pixels.colour.iter().filter(|colour| **colour != [0.0; 3]).count();
                assert_eq!((bright, non_finite), (0, 0), "{name}, scaled by {scale:e}, moved by {offset:e}");
                assert!(pixels.primitive.iter().all(|&id| id >= 0), "{name}: an eye ray escapes");
            }
        }
    }
}

/// Case 30: a light on a surface, at a vertex, and in the eye: finite.
#[test]
fn a_light_on_a_surface_is_finite() {
    let mut scene = Scene { materials: vec![MATT], background: DVec3::splat(0.5), ..Scene::default() };
    let floor = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[x, y]| DVec3::new(x, y, 0.0));
    add_polygon(&mut scene, &floor);
    add_sphere(&mut scene, DVec3::new(0.0, 0.0, 0.5), 0.25);
    let eye = DVec3::new(1.9, -2.3, 1.4);
    scene.camera = camera(eye, DVec3::ZERO);
    let places = [DVec3::ZERO, DVec3::new(1.0, 1.0, 0.0), DVec3::new(0.0, 0.0, 0.75), DVec3::new(0.0, 0.0, 0.5), eye];
    // Exactly where a pixel's ray meets the floor, as nearly as that is known.
    let through_middle = direction(&scene, (SIDE * SIDE / 2 + SIDE / 2) as usize);
    let met = eye - through_middle * (eye.z / through_middle.z);
    scene.lights = places.into_iter().chain([met]).map(white).collect();
    for (scale, offset) in PLACEMENTS {
        let (pixels, non_finite) = image(&placed(&scene, scale, offset));
        assert_eq!(non_finite, 0, "scaled by {scale:e}, moved by {offset:e}");
        assert!(pixels.colour.iter().flatten().all(|c| c.is_finite()));
    }
}

/// Case 29, in an image: what stands behind the light does not shadow, what stands before it does. Within the offset
/// of a secondary ray's origin, 2.4e-7 of the half extent, it may be either.
#[test]
fn what_is_behind_the_light_does_not_shadow() {
    let lit_by = |height: f64| {
        let mut scene = Scene { materials: vec![MATT], ..Scene::default() };
        for (z, half) in [(0.0, 1.0), (2.0, 3.0)] {
            let corners =
                [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[x, y]| DVec3::new(x * half, y * half, z));
            add_polygon(&mut scene, &corners);
        }
        scene.camera = camera(DVec3::new(0.1, -0.2, 1.5), DVec3::ZERO);
        scene.lights = vec![white(DVec3::new(0.2, 0.1, height))];
        let (pixels, _) = image(&scene);
        pixels.colour.iter().filter(|colour| colour[0] > 0.0).count()
    };
    let all = (SIDE * SIDE) as usize;
    assert_eq!([lit_by(1.0), lit_by(2.0 - 1e-5), lit_by(2.0 + 1e-5), lit_by(3.0)], [all, all, 0, 0]);
}

/// A radiance that is not finite is counted, and not written: NaN from a light that shines NaN times, infinity from
/// two lights too bright to be added.
#[test]
fn a_radiance_that_is_not_finite_is_counted_and_not_written() {
    let mut scene = Scene { materials: vec![MATT], background: DVec3::splat(0.5), ..Scene::default() };
    add_sphere(&mut scene, DVec3::ZERO, 1.0);
    let eye = DVec3::new(1.9, -2.3, 1.4);
    scene.camera = camera(eye, DVec3::ZERO);
    for colour in [f64::NAN, f64::MAX] {
        scene.lights = vec![Light { position: eye * 2.0, colour: DVec3::splat(colour) }; 2];
        let (pixels, non_finite) = image(&scene);
        let (seen, background): (Vec<_>, Vec<_>) =
            pixels.colour.iter().zip(&pixels.primitive).partition(|&(_, &primitive)| primitive >= 0);
        let black = seen.iter().filter(|(colour, _)| **colour == [0.0; 3]).count();
        assert!(non_finite > 1000 && non_finite <= seen.len() as u64, "{non_finite} of {}", seen.len());
        assert_eq!(black as u64, non_finite, "they are black");
        assert!(background.iter().all(|(colour, _)| **colour == [0.5; 3]), "and no others");
        assert!(pixels.colour.iter().flatten().all(|c| c.is_finite()));
    }
}
