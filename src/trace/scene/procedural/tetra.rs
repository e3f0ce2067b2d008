//! A pyramid of tetrahedra (Glassner 1984, Kay and Kajiya 1986).

use glam::DVec3;

use super::{NO_SHINE, empty_scene};
use crate::scene::{Material, Scene};

/// The corners of a cube that span a tetrahedron.
const CORNERS: [DVec3; 4] =
    [DVec3::new(-1.0, -1.0, 1.0), DVec3::new(-1.0, 1.0, -1.0), DVec3::new(1.0, -1.0, -1.0), DVec3::new(1.0, 1.0, 1.0)];

/// Counter-clockwise, seen from outside.
const FACES: [[usize; 3]; 4] = [[0, 1, 2], [3, 2, 1], [2, 3, 0], [1, 0, 3]];

pub(super) fn scene(size: u32) -> Scene {
    let mut scene = empty_scene(
        DVec3::new(1.022846, -3.177154, -2.174512),
        DVec3::new(-0.004103, -0.004103, 0.216539),
        DVec3::new(-0.816497, -0.816497, 0.816497),
        [DVec3::new(2.0, -18.0, -5.0)],
    );
    scene.set_material(Material::from_nff(DVec3::new(1.0, 0.2, 0.2), 1.0, 0.0, NO_SHINE, 0.0, 0.0));
    add_tetrahedra(&mut scene, size, DVec3::ZERO, 1.0);
    scene
}

/// `4^(levels − 1)` tetrahedra in a cube of so much half an edge.
fn add_tetrahedra(scene: &mut Scene, levels: u32, centre: DVec3, half: f64) {
    if levels > 1 {
        for corner in CORNERS {
            add_tetrahedra(scene, levels - 1, centre + corner * (half / 2.0), half / 2.0);
        }
        return;
    }
    for face in FACES {
        scene.add_polygon(&face.map(|i| centre + CORNERS[i] * half));
    }
}
