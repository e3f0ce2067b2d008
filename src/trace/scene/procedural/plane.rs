//! A Julia set in triangles of one plane, which is where the root is divided first.

use glam::DVec3;

use super::{empty_scene, shine};
use crate::scene::{Material, Scene};

/// Along an edge of a plane of size 1; each square is cut into four triangles around its centre.
const SQUARES: u32 = 5;

/// Of z → z² + c.
const C: [f64; 2] = [-0.8, 0.156];
const ITERATIONS_MAX: usize = 40;

/// Colour and Ks: the first is for points that stay, the others in turn for those that leave.
const PALETTE: [([f64; 3], f64); 6] = [
    ([0.9, 0.9, 1.0], 0.7),
    ([0.05, 0.1, 0.35], 0.3),
    ([0.1, 0.35, 0.6], 0.2),
    ([0.95, 0.9, 0.75], 0.1),
    ([0.95, 0.6, 0.1], 0.1),
    ([0.5, 0.1, 0.05], 0.2),
];

pub(super) fn scene(size: u32) -> Scene {
    let lights = [[-0.6, 1.3, 0.6], [0.9, 0.4, 0.5], [-0.3, -0.9, 0.5]];
    let mut scene = empty_scene(DVec3::new(0.5, -1.6, 1.7), DVec3::ZERO, DVec3::Z, lights.map(DVec3::from));
    let material = |(colour, ks)| Material::from_nff(DVec3::from(colour), 1.0 - ks, ks, shine(12.0), 0.0, 1.0);
    scene.materials = PALETTE.map(material).into();
    let squares = SQUARES * size;
    let triangles = 4 * squares as usize * squares as usize;
    scene.polygons.reserve_exact(triangles);
    scene.vertices.reserve_exact(3 * triangles);
    let corner = |i: u32| f64::from(i) * 2.0 / f64::from(squares) - 1.0;
    for y in 0..squares {
        for x in 0..squares {
            let (left, right, low, high) = (corner(x), corner(x + 1), corner(y), corner(y + 1));
            let square = [[left, low], [right, low], [right, high], [left, high]].map(|[x, y]| DVec3::new(x, y, 0.0));
            let centre = (square[0] + square[2]) / 2.0;
            for side in 0..4 {
                let triangle = [square[side], square[(side + 1) % 4], centre];
                scene.add_polygon_of(&triangle, colour_at((triangle[0] + triangle[1] + centre) / 3.0));
            }
        }
    }
    scene
}

/// Which of the palette.
fn colour_at(point: DVec3) -> u32 {
    let [mut x, mut y] = [point.x * 1.6, point.y * 1.6];
    for i in 0..ITERATIONS_MAX {
        [x, y] = [x * x - y * y + C[0], 2.0 * x * y + C[1]];
        if x * x + y * y > 4.0 {
            return (1 + i % (PALETTE.len() - 1)) as u32;
        }
    }
    0
}
