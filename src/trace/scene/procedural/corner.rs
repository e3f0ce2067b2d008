//! A toy town in one corner of the root, and far away in the opposite one a moon, which makes the root large.

use std::f64::consts::TAU;

use glam::DVec3;

use super::random::Random;
use super::{NO_SHINE, empty_scene, shine};
use crate::scene::{Cone, Material, Scene, Sphere};

/// Along each axis. The eye sees it mirrored in the ground.
const MOON_AT: f64 = 300.0;
const MOON_RADIUS: f64 = 40.0;

pub(super) fn scene(size: u32) -> Scene {
    let lights = [[-3.0, -1.0, 4.0], [2.0, -4.0, 5.0], [-2.0, 4.0, 3.0]];
    let mut scene =
        empty_scene(DVec3::new(-2.8, -2.8, 1.6), DVec3::new(0.0, 0.0, 0.2), DVec3::Z, lights.map(DVec3::from));
    scene.set_material(Material::from_nff(DVec3::new(0.35, 0.5, 0.4), 0.5, 0.5, NO_SHINE, 0.0, 1.0));
    scene.add_polygon(&[[-2.5, -2.5], [2.5, -2.5], [2.5, 2.5], [-2.5, 2.5]].map(|[x, y]| DVec3::new(x, y, 0.0)));
    let mut random = Random::new(5);
    let width = 2.0 / f64::from(size);
    for y in 0..size {
        for x in 0..size {
            let at = |i: u32| (f64::from(i) + 0.5) * width - 1.0;
            let colour = DVec3::new(random.between(0.5, 1.0), random.between(0.3, 0.8), random.between(0.2, 0.6));
            scene.set_material(Material::from_nff(colour, 0.8, 0.2, shine(15.0), 0.0, 1.0));
            let plot = Plot { centre: DVec3::new(at(x), at(y), 0.0), width };
            match random.index(3) {
                0 => plot.build_tower(&mut scene, random.between(0.3, 0.8)),
                1 => plot.build_star(&mut scene, random.between(0.1, 0.5), 4 + random.index(4) as u32),
                _ => plot.build_house(&mut scene, random.between(0.1, 0.4)),
            }
        }
    }
    scene.set_material(Material::from_nff(DVec3::new(1.0, 0.95, 0.8), 1.0, 0.0, NO_SHINE, 0.0, 1.0));
    scene.spheres.push(Sphere { centre: DVec3::ONE * MOON_AT, radius: MOON_RADIUS, material: scene.material() });
    scene
}

/// The place of one building, which fills nine tenths of the width.
struct Plot {
    centre: DVec3,
    width: f64,
}

impl Plot {
    /// A cylinder, a spire, and a ball of glass on its tip.
    fn build_tower(&self, scene: &mut Scene, height: f64) {
        let (radius, material) = (self.width * 0.3, scene.material());
        let top = self.centre + DVec3::Z * height;
        let tip = top + DVec3::Z * (self.width * 0.9);
        let (base, base_radius, apex_radius) = (self.centre, radius, radius);
        scene.cones.push(Cone { base, base_radius, apex: top, apex_radius, material });
        scene.cones.push(Cone { base: top, base_radius: radius * 1.4, apex: tip, apex_radius: 0.0, material });
        scene.set_material(Material::from_nff(DVec3::new(0.8, 0.9, 1.0), 0.1, 0.2, shine(5.0), 0.7, 1.5));
        let (radius, material) = (self.width * 0.12, scene.material());
        scene.spheres.push(Sphere { centre: tip + DVec3::Z * radius, radius, material });
    }

    /// A star of so many points with upright walls.
    fn build_star(&self, scene: &mut Scene, height: f64, points: u32) {
        let corner = |i: u32| {
            let radius = self.width * if i.is_multiple_of(2) { 0.45 } else { 0.22 };
            let angle = TAU * f64::from(i % (2 * points)) / f64::from(2 * points);
            self.centre + DVec3::new(libm::cos(angle), libm::sin(angle), 0.0) * radius
        };
        let up = DVec3::Z * height;
        scene.add_polygon(&(0..2 * points).map(|i| corner(i) + up).collect::<Vec<_>>());
        for i in 0..2 * points {
            scene.add_polygon(&[corner(i), corner(i + 1), corner(i + 1) + up, corner(i) + up]);
        }
    }

    /// Two gables of five corners, two walls, two halves of a roof.
    fn build_house(&self, scene: &mut Scene, height: f64) {
        let half = self.width * 0.4;
        let at = |x: f64, y: f64, z: f64| self.centre + DVec3::new(x * half, y * half, z);
        let ridge = height + half * 0.8;
        for (side, turn) in [(-1.0, 1.0), (1.0, -1.0)] {
            let gable = [(-turn, 0.0), (turn, 0.0), (turn, height), (0.0, ridge), (-turn, height)];
            scene.add_polygon(&gable.map(|(x, z)| at(x, side, z)));
            let wall = [(turn, 0.0), (-turn, 0.0), (-turn, height), (turn, height)];
            scene.add_polygon(&wall.map(|(y, z)| at(side, y, z)));
            let roof = [(side, turn, height), (side, -turn, height), (0.0, -turn, ridge), (0.0, turn, ridge)];
            scene.add_polygon(&roof.map(|(x, y, z)| at(x, y, z)));
        }
    }
}
