//! Interlocked gears, some of glass, above a ground that mirrors.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::{NO_SHINE, empty_scene, shine};
use crate::scene::{Material, Scene};

const TEETH: u32 = 36;
/// Of a gear's radius: the tips end a little inside it, so that no two gears share a surface.
const TIP_RATIO: f64 = 0.995;
const ROOT_RATIO: f64 = 0.9;
const THICKNESS_MAX: f64 = 0.1;
/// Where a tooth's outline bends, in tooth pitches; the first two are at the tip, the others at the root.
const BENDS: [f64; 4] = [-0.19, 0.19, 0.3, 0.7];

pub(super) fn scene(size: u32) -> Scene {
    let lights = [[2.0, 4.0, 4.0], [-2.0, 4.0, 3.0], [2.0, -2.5, 2.5], [-1.0, -4.0, 2.0], [-1.111, -2.121, 2.626]];
    let mut scene = empty_scene(DVec3::new(-1.1, -2.1, 2.6), DVec3::ZERO, DVec3::Z, lights.map(DVec3::from));
    scene.set_material(Material::from_nff(DVec3::new(1.0, 0.85, 0.7), 0.3, 0.6, shine(37.0), 0.0, 0.0));
    scene.add_polygon(&[[2.0, 2.0], [-2.0, 2.0], [-2.0, -2.0], [2.0, -2.0]].map(|[x, y]| DVec3::new(x, y, 0.0)));

    let n = f64::from(size);
    // Neighbours overlap by the depth of a tooth; all of them fill the square from −1 to 1.
    let radius = 1.0 / (n - (n - 1.0) * (1.0 - ROOT_RATIO) / 2.0);
    let pitch = radius * (1.0 + ROOT_RATIO);
    let thickness = THICKNESS_MAX.min(1.0 / (2.0 * n));
    for iz in 0..size {
        for iy in 0..size {
            for ix in 0..size {
                let place = |i: u32| radius - 1.0 + f64::from(i) * pitch;
                scene.set_material(material(ix, iy, iz));
                let gear = Gear {
                    centre: DVec3::new(place(ix), place(iy), 1.0 - f64::from(iz) / n),
                    // Every other one is turned by half a tooth, so that they mesh.
                    turn: PI * f64::from((ix + iy + iz) % 2) / f64::from(TEETH),
                    radius,
                    thickness,
                };
                gear.add_to(&mut scene);
            }
        }
    }
    scene
}

/// A colour from the place alone, with its strongest component at 1; every fifth gear or so is of glass.
fn material(ix: u32, iy: u32, iz: u32) -> Material {
    let component = |steps: u32, sevenths: f64| 0.01 + (f64::from(steps + 1) * sevenths / 7.0).fract();
    let colour = DVec3::new(
        component(ix * 3 + iy * 2 + iz, 5.0),
        component(iy * 3 + iz * 2 + ix, 3.0),
        component(iz * 3 + ix * 2 + iy, 2.0),
    );
    let colour = colour / colour.max_element();
    if (ix * 4 + iy * 2 + iz).is_multiple_of(5) {
        Material::from_nff(colour, 0.2, 0.0, NO_SHINE, 0.8, 1.1)
    } else {
        Material::from_nff(colour, 1.0, 0.0, NO_SHINE, 0.0, 0.0)
    }
}

struct Gear {
    /// Of the upper face.
    centre: DVec3,
    /// Radians.
    turn: f64,
    radius: f64,
    thickness: f64,
}

impl Gear {
    fn add_to(&self, scene: &mut Scene) {
        let down = DVec3::new(0.0, 0.0, self.thickness);
        let top = self.outline(1.0);
        scene.add_polygon(&top);
        for (&here, &next) in top.iter().zip(top.iter().cycle().skip(1)) {
            scene.add_polygon(&[here, here - down, next - down, next]);
        }
        let bottom: Vec<DVec3> = self.outline(-1.0).into_iter().map(|corner| corner - down).collect();
        scene.add_polygon(&bottom);
    }

    /// The upper face's corners, counter-clockwise for a direction of 1, clockwise for −1.
    fn outline(&self, direction: f64) -> Vec<DVec3> {
        let tooth_angle = TAU / f64::from(TEETH);
        let corner = |tooth: u32, bend: usize| {
            let ratio = if bend < 2 { TIP_RATIO } else { ROOT_RATIO };
            let angle = self.turn + direction * tooth_angle * (f64::from(tooth) + BENDS[bend]);
            self.centre + self.radius * ratio * DVec3::new(libm::cos(angle), libm::sin(angle), 0.0)
        };
        (0..TEETH)
            .flat_map(|tooth| (0..BENDS.len()).map(move |bend| (tooth, bend)))
            .map(|(t, b)| corner(t, b))
            .collect()
    }
}
