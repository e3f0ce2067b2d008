//! What surfaces are made of, against radiances worked out by hand: emission, colours at corners, sheets that let light
//! through, and the soft terminator. Every kernel gives the same bits and casts the same rays ([`image`]).

use glam::DVec3;
use trace::picture::Terminator;
use trace::scene::{Camera, Light, Material, Polygon, Scene};

use crate::images::{PLACEMENTS, SIDE, add_polygon, add_sphere, camera, image, placed};

/// Seen from above, upright; one light straight above the middle, far away and white.
fn from_above() -> Scene {
    Scene {
        camera: Some(Camera { up: DVec3::Y, ..camera(DVec3::Z * 10.0, DVec3::ZERO).expect("one") }),
        lights: vec![Light { position: DVec3::Z * 1e6, colour: DVec3::ONE }],
        background: DVec3::new(0.25, 0.5, 0.125),
        ..Scene::default()
    }
}

fn square(scene: &mut Scene, half: f64, z: f64) {
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    add_polygon(scene, &corners.map(|[x, y]| DVec3::new(x * half, y * half, z)));
}

fn matt(colour: DVec3) -> Material {
    Material { diffuse: colour, ..Material::WHITE }
}

/// Opacity `d` of a material that does not bend light: what the reader of MTL files makes of it.
fn sheet(colour: DVec3, d: f64) -> Material {
    Material { diffuse: colour * d, transmittance: 1.0 - d, shadow_transmittance: 1.0 - d, ..Material::WHITE }
}

fn middle(scene: &Scene) -> DVec3 {
    pixel(scene, SIDE / 2, SIDE / 2)
}

fn pixel(scene: &Scene, x: u32, y: u32) -> DVec3 {
    let (pixels, non_finite) = image(scene);
    assert_eq!(non_finite, 0);
    DVec3::from(pixels.colour[(y * SIDE + x) as usize].map(f64::from))
}

fn assert_close(found: DVec3, expected: DVec3) {
    assert!((found - expected).abs().max_element() < 1e-4, "{found}, expected {expected}");
}

#[test]
fn what_emits_is_seen_without_a_light_and_lights_nothing_else() {
    let mut scene = Scene { lights: Vec::new(), ..from_above() };
    scene.materials.push(Material { emission: DVec3::new(2.0, 0.5, 0.0), ..matt(DVec3::ONE) });
    add_sphere(&mut scene, DVec3::ZERO, 0.5);
    scene.materials.push(matt(DVec3::ONE));
    square(&mut scene, 3.0, -1.0);
    // After one with light terms, materials are where they were.
    scene.materials.push(Material { emission: DVec3::splat(0.75), ..matt(DVec3::ZERO) });
    add_sphere(&mut scene, DVec3::new(2.0, 0.0, 0.0), 0.5);
    assert_close(middle(&scene), DVec3::new(2.0, 0.5, 0.0));
    assert_eq!(pixel(&scene, SIDE / 2, SIDE / 5), DVec3::ZERO);
    assert_close(pixel(&scene, SIDE / 2 + 31, SIDE / 2), DVec3::splat(0.75));
    // And it is added to what a light brings.
    scene.lights = from_above().lights;
    let mut dark = scene.clone();
    dark.materials[0].emission = DVec3::ZERO;
    assert_close(middle(&scene) - middle(&dark), DVec3::new(2.0, 0.5, 0.0));
}

#[test]
fn a_sheet_shows_its_share_and_what_is_behind_it() {
    let colour = DVec3::new(1.0, 0.5, 0.0);
    for d in [0.0, 0.25, 0.5, 1.0] {
        let mut scene = from_above();
        scene.materials.push(sheet(colour, d));
        square(&mut scene, 1.0, 0.0);
        assert_close(middle(&scene), colour * d + scene.background * (1.0 - d));
        // Seen aslant, nothing is bent: the edge of what is behind is where it was.
        scene.materials.push(matt(DVec3::X));
        square(&mut scene, 0.5, -2.0);
        scene.camera = camera(DVec3::new(3.0, -2.0, 9.0), DVec3::ZERO);
        scene.lights[0].colour = DVec3::ZERO;
        let (behind, _) = image(&scene);
        scene.polygons.remove(0);
        let (alone, _) = image(&scene);
        let is_seen = |pixel: &[f32; 3]| f64::from(pixel[1]) < 0.5 * (1.0 - d) - 1e-3;
        if d < 1.0 {
            let differing = behind.colour.iter().zip(&alone.colour).filter(|(a, b)| is_seen(a) != (b[1] < 0.5 - 1e-3));
            assert!(differing.count() <= 4);
        }
    }
}

#[test]
fn a_sheet_leaves_its_share_of_a_light_behind_it_and_several_leave_the_product() {
    for &(scale, translation) in &PLACEMENTS {
        let floor = DVec3::new(0.5, 1.0, 0.25);
        let mut scene = from_above();
        scene.camera = Some(Camera {
            from: DVec3::new(0.0, -10.0, 3.0),
            at: DVec3::new(0.0, 0.0, -2.0),
            up: DVec3::Z,
            ..scene.camera.expect("one")
        });
        scene.materials.push(matt(floor));
        square(&mut scene, 1.0, -2.0);
        for (z, d) in [(3.0, 0.5), (4.0, 0.25), (5.0, 0.0)] {
            scene.materials.push(sheet(DVec3::X, d));
            square(&mut scene, 2.0, z);
        }
        let lit = middle(&placed(&scene, scale, translation));
        assert_close(lit, floor * 0.5 * 0.75);
        // What is opaque still casts a full shadow, whether it is before or behind.
        for z in [2.5, 4.5, 6.0] {
            let mut shadowed = scene.clone();
            shadowed.materials.push(matt(DVec3::ONE));
            square(&mut shadowed, 2.0, z);
            assert_eq!(middle(&placed(&shadowed, scale, translation)), DVec3::ZERO, "at {z}");
        }
        // A sheet beyond the light is in nobody's way.
        scene.lights[0].position = DVec3::Z * 2.5;
        let lit = middle(&placed(&scene, scale, translation));
        assert!((lit - floor).abs().max_element() < 1e-3, "{lit}");
    }
}

#[test]
fn a_closed_body_of_sheets_is_passed_twice() {
    let mut scene = from_above();
    scene.camera = camera(DVec3::new(0.0, -10.0, 0.5), DVec3::new(0.0, 0.0, -2.0));
    scene.materials.push(matt(DVec3::ONE));
    square(&mut scene, 1.0, -2.0);
    scene.materials.push(sheet(DVec3::X, 0.25));
    add_sphere(&mut scene, DVec3::Z * 4.0, 1.5);
    assert_close(middle(&scene), DVec3::splat(0.75 * 0.75));
}

#[test]
fn colours_go_over_from_corner_to_corner_and_times_the_materials() {
    let mut scene = from_above();
    scene.materials.push(matt(DVec3::new(1.0, 0.5, 1.0)));
    let corners = [[-2.0, -2.0], [2.0, -2.0], [2.0, 2.0], [-2.0, 2.0]].map(|[x, y]| DVec3::new(x, y, 0.0));
    add_polygon(&mut scene, &corners);
    scene.colours = vec![DVec3::ZERO, DVec3::X, DVec3::ONE, DVec3::Y];
    scene.polygons[0].first_colour = Some(0);
    // At (x, y) of the square from 0 to 1 the colour is (x, y, the lesser of both), as the cut is from corner 0 to 2.
    let seen = |x: f64, y: f64| {
        let at = |share: f64| ((share * 4.0 - 2.0) / (10.0 * 22.5f64.to_radians().tan()) + 1.0) * f64::from(SIDE) / 2.0;
        let (column, row) = (at(x) as u32, at(1.0 - y) as u32);
        let back = |pixel: u32| {
            ((f64::from(pixel) + 0.5) * 2.0 / f64::from(SIDE) - 1.0) * 10.0 * 22.5f64.to_radians().tan() / 4.0 + 0.5
        };
        let (x, y) = (back(column), 1.0 - back(row));
        (pixel(&scene, column, row), DVec3::new(x, 0.5 * y, x.min(y)))
    };
    for (x, y) in [(0.5, 0.5), (0.9, 0.2), (0.1, 0.3), (0.7, 0.95)] {
        let (found, expected) = seen(x, y);
        assert_close(found, expected);
    }
    // Smooth at once: normals and colours are records of their own.
    let mut smooth = scene.clone();
    smooth.normals = vec![DVec3::Z; 4];
    smooth.polygons[0].first_normal = Some(0);
    assert_eq!(image(&smooth).0.colour, image(&scene).0.colour);
    // White corners change nothing.
    scene.colours = vec![DVec3::ONE; 4];
    let coloured = image(&scene).0;
    scene.polygons[0].first_colour = None;
    assert_eq!(coloured, image(&scene).0);
}

/// A ball of flat triangles with the normals of a round one.
fn ball(rings: u32, terminator: Terminator) -> Scene {
    let mut scene = Scene {
        camera: camera(DVec3::new(0.0, -4.0, 0.0), DVec3::ZERO),
        lights: vec![Light { position: DVec3::new(100.0, -30.0, 40.0), colour: DVec3::ONE }],
        terminator,
        ..Scene::default()
    };
    scene.materials.push(matt(DVec3::ONE));
    let point = |ring: u32, step: u32| {
        let (theta, phi) = (f64::from(ring) / f64::from(rings), f64::from(step) / f64::from(rings));
        let (theta, phi) = (theta * std::f64::consts::PI, phi * std::f64::consts::PI);
        DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
    };
    for ring in 0..rings {
        for step in 0..2 * rings {
            let corners = [point(ring, step), point(ring + 1, step), point(ring + 1, step + 1), point(ring, step + 1)];
            for [a, b, c] in [[0, 1, 2], [0, 2, 3]].map(|triangle| triangle.map(|i: usize| corners[i])) {
                let (first_vertex, first_normal) = (scene.vertices.len() as u32, Some(scene.normals.len() as u32));
                scene.vertices.extend([a, b, c]);
                scene.normals.extend([a, b, c]);
                scene.polygons.push(Polygon {
                    first_vertex,
                    vertex_count: 3,
                    first_normal,
                    first_colour: None,
                    material: 0,
                });
            }
        }
    }
    scene
}

/// Pixels that a light should reach, by the normals, and that are black.
fn black_steps(scene: &Scene) -> usize {
    let mut round = scene.clone();
    (round.polygons, round.vertices, round.normals) = (Vec::new(), Vec::new(), Vec::new());
    add_sphere(&mut round, DVec3::ZERO, 1.0);
    let (flat, round) = (image(scene).0, image(&round).0);
    let lit = |pixel: &[f32; 3]| pixel[0] > 0.02;
    let hits = flat.primitive.iter().map(|&id| id >= 0);
    let both = flat.colour.iter().zip(&round.colour).zip(hits);
    both.filter(|((flat, round), is_hit)| *is_hit && lit(round) && flat[0] == 0.0).count()
}

#[test]
fn a_soft_terminator_has_no_black_steps() {
    for rings in [6, 10, 20] {
        let (hard, soft) = (black_steps(&ball(rings, Terminator::Hard)), black_steps(&ball(rings, Terminator::Soft)));
        eprintln!("{rings} rings: {hard} hard, {soft} soft");
        assert!(soft * 4 < hard, "{rings} rings: {hard} hard, {soft} soft");
    }
}

/// The normals near the outline turn away from the eye; a light from before or from aside reaches it all the same.
#[test]
fn a_round_surface_is_lit_up_to_its_outline() {
    for (rings, light) in [4, 6, 12].into_iter().flat_map(|rings| {
        [[0.0, -4.0, 0.0], [3.0, -3.0, 3.0], [-40.0, -10.0, 10.0]].map(|light| (rings, DVec3::from_array(light)))
    }) {
        let steps = [Terminator::Hard, Terminator::Soft].map(|terminator| {
            let mut scene = ball(rings, terminator);
            scene.lights[0].position = light;
            black_steps(&scene)
        });
        eprintln!("{rings} rings, light at {light}: {steps:?}");
        // From where the eye is, a light reaches all that is seen.
        let is_at_eye = light.x == 0.0;
        assert!(
            if is_at_eye { steps[1] == 0 } else { steps[1] * 2 <= steps[0].max(2) },
            "{rings} rings, light at {light}: {steps:?}"
        );
    }
}

/// The corners of the ball are where the scene ends, and then far within it.
#[test]
fn a_soft_terminator_does_not_depend_on_how_far_the_scene_reaches() {
    let scene = ball(5, Terminator::Soft);
    let mut wider = scene.clone();
    add_sphere(&mut wider, DVec3::new(0.0, 40.0, 40.0), 0.5);
    let (alone, beside) = (image(&scene).0, image(&wider).0);
    let differing = alone.colour.iter().zip(&beside.colour).filter(|(a, b)| (a[0] - b[0]).abs() > 1e-2);
    assert!(differing.count() <= 10);
}

#[test]
fn sheets_are_no_bounces() {
    let mut scene = from_above();
    scene.materials.push(matt(DVec3::Y));
    square(&mut scene, 1.0, -2.0);
    scene.materials.push(sheet(DVec3::X, 0.0));
    // Small, as each pixel of each sheet is a ray with shadows of its own. More than there may be bounces, and as many as there may be sheets.
    for count in 1..=64 {
        square(&mut scene, 0.2, f64::from(count) * 0.01);
        if [1, 5, 20, 64].contains(&count) {
            assert_close(middle(&scene), DVec3::Y);
        }
    }
    square(&mut scene, 0.2, 1.0);
    assert_eq!(middle(&scene), DVec3::ZERO);
    // Behind a sheet a mirror reflects as often as it would without.
    let mut mirrors = from_above();
    mirrors.materials.push(Material { reflection: DVec3::splat(0.5), ..matt(DVec3::ZERO) });
    square(&mut mirrors, 1.0, 0.0);
    let plain = middle(&mirrors);
    mirrors.materials.push(sheet(DVec3::ZERO, 0.5));
    for z in [1.0, 1.5, 2.0] {
        square(&mut mirrors, 2.0, z);
    }
    assert_close(middle(&mirrors), plain * 0.5f64.powi(6));
}

#[test]
fn a_soft_terminator_changes_neither_flat_nor_curved_surfaces() {
    let mut scene = from_above();
    scene.materials.push(matt(DVec3::ONE));
    square(&mut scene, 2.0, -1.0);
    add_sphere(&mut scene, DVec3::ZERO, 0.7);
    let hard = image(&scene);
    scene.terminator = Terminator::Soft;
    assert_eq!(image(&scene), hard);
}
