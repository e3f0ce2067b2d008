//! The sphereflake: a sphere that carries nine of a third of its radius, each of which does the same.

use std::f64::consts::TAU;

use glam::{DMat3, DVec3};

use super::{NO_SHINE, empty_scene, shine};
use crate::scene::{Material, Scene, Sphere};

const CHILD_RATIO: f64 = 1.0 / 3.0;

pub(super) fn scene(size: u32) -> Scene {
    let lights = [[4.0, 3.0, 2.0], [1.0, -4.0, 4.0], [-3.0, 1.0, 5.0]];
    let mut scene = empty_scene(DVec3::new(2.1, 1.3, 1.7), DVec3::ZERO, DVec3::Z, lights.map(DVec3::from));
    scene.set_material(Material::from_nff(DVec3::new(1.0, 0.75, 0.33), 0.8, 0.0, NO_SHINE, 0.0, 1.0));
    scene.add_polygon(
        &[[12.0, 12.0], [-12.0, 12.0], [-12.0, -12.0], [12.0, -12.0]].map(|[x, y]| DVec3::new(x, y, -0.5)),
    );
    scene.set_material(Material::from_nff(DVec3::new(1.0, 0.9, 0.7), 0.5, 0.5, shine(37.0), 0.0, 1.0));
    add_ball(&mut scene, size, &directions(), DVec3::ZERO, 0.5, DVec3::Z);
    scene
}

/// A sphere, and what it carries on the side that is turned to `outwards` (unit).
fn add_ball(scene: &mut Scene, levels: u32, directions: &[DVec3; 9], centre: DVec3, radius: f64, outwards: DVec3) {
    scene.spheres.push(Sphere { centre, radius, material: scene.material() });
    if levels == 0 {
        return;
    }
    let turned = rotation_from_z(outwards);
    for &direction in directions {
        let direction = turned * direction;
        let child = centre + direction * (radius * (1.0 + CHILD_RATIO));
        add_ball(scene, levels - 1, directions, child, radius * CHILD_RATIO, direction);
    }
}

/// Where a sphere that is turned to +z carries its children: six around its equator, three above.
fn directions() -> [DVec3; 9] {
    let d = 0.5f64.sqrt();
    // The corner (1, 1, −1) of a cube is turned down, by an angle whose sine is 2/√6.
    let sine = 2.0 / 6.0f64.sqrt();
    let tilt = rotation(DVec3::new(d, -d, 0.0), (1.0 - sine * sine).sqrt(), sine);
    let three = [DVec3::new(d, d, 0.0), DVec3::new(d, 0.0, -d), DVec3::new(0.0, d, -d)].map(|v| tilt * v);
    std::array::from_fn(|i| {
        let angle = (i / 3) as f64 * TAU / 3.0;
        rotation(DVec3::Z, libm::cos(angle), libm::sin(angle)) * three[i % 3]
    })
}

/// The smallest rotation that takes +z to a unit vector; half a turn around y for −z.
fn rotation_from_z(to: DVec3) -> DMat3 {
    // Balls do hang straight down, but for rounding, which must not choose the axis.
    const SINE_MIN: f64 = 1e-9;
    let axis = DVec3::Z.cross(to);
    let sine = axis.length();
    if sine > SINE_MIN {
        rotation(axis / sine, to.z, sine)
    } else {
        DMat3::from_diagonal(DVec3::new(to.z.signum(), 1.0, to.z.signum()))
    }
}

/// Around a unit axis, counter-clockwise seen from its tip (Rodrigues).
fn rotation(axis: DVec3, cosine: f64, sine: f64) -> DMat3 {
    let turn = |v: DVec3| v * cosine + axis.cross(v) * sine + axis * (axis.dot(v) * (1.0 - cosine));
    DMat3::from_cols(turn(DVec3::X), turn(DVec3::Y), turn(DVec3::Z))
}
