//! A nest of needles above a mirror: triangles as long as the nest, the thinnest a millionth as wide.

use glam::DVec3;

use super::random::Random;
use super::{NO_SHINE, empty_scene, shine};
use crate::scene::{Material, Scene};

const PER_SIZE: u32 = 1000;
/// Width over length, evenly spread over the decades between.
const WIDTH_RATIOS_LOG10: [f64; 2] = [-6.0, -1.5];

pub(super) fn scene(size: u32) -> Scene {
    let lights = [[3.0, -3.0, 4.0], [-4.0, -1.0, 3.0]];
    let at = DVec3::new(0.0, 0.0, -0.1);
    let mut scene = empty_scene(DVec3::new(0.6, -3.6, 1.5), at, DVec3::Z, lights.map(DVec3::from));
    scene.set_material(Material::from_nff(DVec3::new(0.35, 0.4, 0.5), 0.5, 0.5, NO_SHINE, 0.0, 1.0));
    scene.add_polygon(&[[-3.0, -3.0], [3.0, -3.0], [3.0, 3.0], [-3.0, 3.0]].map(|[x, y]| DVec3::new(x, y, -1.1)));
    let mut random = Random::new(1);
    for i in 0..PER_SIZE * size {
        // A hundred materials are enough to distinguish needles.
        if i % (PER_SIZE * size / 100) == 0 {
            let colour = DVec3::new(1.0, random.between(0.35, 0.9), random.between(0.05, 0.4));
            scene.set_material(Material::from_nff(colour, 0.9, 0.1, shine(20.0), 0.0, 1.0));
        }
        let outwards = random.direction();
        let along = outwards.cross(random.direction()).normalize_or(outwards.any_orthonormal_vector());
        let across = (outwards + random.direction() * 0.5).cross(along).normalize_or_zero();
        let (centre, length) = (outwards * random.between(0.75, 1.0), random.between(0.8, 1.4));
        let [least, most] = WIDTH_RATIOS_LOG10;
        let width = length * libm::exp10(random.between(least, most));
        let blunt = centre - along * (length / 2.0);
        scene.add_polygon(&[
            blunt - across * (width / 2.0),
            blunt + across * (width / 2.0),
            centre + along * (length / 2.0),
        ]);
    }
    scene
}
