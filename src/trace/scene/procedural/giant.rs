//! Tents on a mirror to the horizon: one triangle a million times as large as all others.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::random::Random;
use super::{empty_scene, shine};
use crate::scene::{Material, Scene};

const TENTS_PER_SIZE: u32 = 64;
const RATIO: f64 = 1e6;
/// Where tents stand, in their own widths from the middle.
const DISTANCES_LOG10: [f64; 2] = [0.4, 3.5];

pub(super) fn scene(size: u32) -> Scene {
    let lights = [[30.0, -20.0, 40.0], [-30.0, -10.0, 20.0]];
    let at = DVec3::new(0.0, 0.0, 0.4);
    let mut scene = empty_scene(DVec3::new(0.0, -11.0, 2.5), at, DVec3::Z, lights.map(DVec3::from));
    scene.set_material(Material::from_nff(DVec3::new(0.3, 0.5, 0.35), 0.4, 0.6, shine(10.0), 0.0, 1.0));
    // Its box has the tents in the middle, where coordinates are finest.
    let giant = [[-1.0, -1.0], [1.0, -1.0], [0.0, 1.0]];
    scene.add_polygon(&giant.map(|[x, y]| DVec3::new(x, y, 0.0) * (RATIO / 2.0)));
    let mut random = Random::new(3);
    let tents = TENTS_PER_SIZE * size;
    let [least, most] = DISTANCES_LOG10;
    for i in 0..tents {
        let colour = DVec3::new(random.between(0.6, 1.0), random.between(0.2, 0.8), random.between(0.1, 0.5));
        scene.set_material(Material::from_nff(colour, 0.85, 0.15, shine(20.0), 0.0, 1.0));
        let distance = libm::exp10(least + (most - least) * (f64::from(i) + 0.5) / f64::from(tents));
        let angle = PI * (3.0 - 5f64.sqrt()) * f64::from(i);
        let foot = DVec3::new(libm::cos(angle), libm::sin(angle), 0.0) * distance;
        let (turn, height) = (random.between(0.0, TAU), random.between(0.6, 1.4));
        let corner = |i: u32| {
            let angle = turn + f64::from(i) * TAU / 4.0;
            foot + DVec3::new(libm::cos(angle), libm::sin(angle), 0.0) * 0.5f64.sqrt()
        };
        for side in 0..4 {
            scene.add_polygon(&[corner(side), corner(side + 1), foot + DVec3::Z * height]);
        }
    }
    scene
}
