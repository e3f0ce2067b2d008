//! A hill of spheres that wind up to its tip, each a little smaller than the one before: over nine decades.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::{NO_SHINE, empty_scene, shine};
use crate::scene::{Material, Scene, Sphere};

const PER_SIZE: u32 = 1000;
const DECADES: f64 = 9.0;
/// Of the hill, height over distance from the axis.
const SLOPE: f64 = 0.6;

pub(super) fn scene(size: u32) -> Scene {
    let lights = [[2.5, -2.0, 3.0], [-3.0, -1.5, 2.5], [0.0, 3.0, 2.0]];
    let mut scene =
        empty_scene(DVec3::new(0.0, -2.1, 1.8), DVec3::new(0.0, -0.07, -0.35), DVec3::Z, lights.map(DVec3::from));
    scene.set_material(Material::from_nff(DVec3::new(0.4, 0.45, 0.5), 0.4, 0.6, NO_SHINE, 0.0, 1.0));
    let ground = [[-3.0, -3.0], [3.0, -3.0], [3.0, 3.0], [-3.0, 3.0]];
    scene.add_polygon(&ground.map(|[x, y]| DVec3::new(x, y, -0.7)));
    const COLOURS: [[f64; 3]; 4] = [[0.9, 0.25, 0.1], [1.0, 0.7, 0.2], [0.2, 0.5, 0.35], [0.85, 0.85, 0.8]];
    let first = scene.materials.len() as u32;
    scene.materials.extend(COLOURS.map(|c| Material::from_nff(c.into(), 0.75, 0.25, shine(20.0), 0.0, 1.0)));

    let count = PER_SIZE * size;
    let golden_angle = PI * (3.0 - 5f64.sqrt());
    let decades_a_step = DECADES / f64::from(count - 1);
    // Of the unrolled hill, in units of the distance from the axis: a step's share is a square of this side.
    let spacing = (TAU * (1.0 + SLOPE * SLOPE).sqrt() * decades_a_step * std::f64::consts::LN_10).sqrt();
    for i in 0..count {
        let distance = libm::exp10(-decades_a_step * f64::from(i));
        let angle = golden_angle * f64::from(i);
        let centre = DVec3::new(libm::cos(angle), libm::sin(angle), -SLOPE) * distance;
        // Arms: every so many steps, spheres are above one another.
        let material = first + i % 34 % COLOURS.len() as u32;
        scene.spheres.push(Sphere { centre, radius: distance * spacing * 0.55, material });
    }
    scene
}
