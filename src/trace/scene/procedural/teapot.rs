//! The Utah teapot, on a chequerboard or without it.

use std::str::FromStr;

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::teapot_patches::PATCHES;
use super::{empty_scene, shine};
use crate::scene::{Material, Scene};

/// What the teapot stands on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Board {
    /// A chequerboard of n² squares, as in SPD.
    #[default]
    Squares,
    /// Nothing: the paper counts the teapot's own 9120 triangles alone.
    None,
}

impl Board {
    /// As in files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Squares => "squares",
            Self::None => "none",
        }
    }
}

impl FromStr for Board {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let found = [Self::Squares, Self::None].into_iter().find(|board| board.name() == name);
        found.ok_or_else(|| "expected squares or none".to_owned())
    }
}

type Patch = [[[f64; 3]; 4]; 4];

/// Half the edge of the chequerboard.
const BOARD_HALF: f64 = 4.0;
/// A vertex this close to the axis is a cusp: the lid's knob, or the middle of the bottom.
const CUSP_DISTANCE: f64 = 1e-4;
/// Cusps above this are the lid's.
const CUSP_MIDDLE_Z: f64 = 1.5;

pub(super) fn scene(size: u32, board: Board) -> Scene {
    let lights = [[-3.1, 9.8, 12.1], [11.3, 5.1, 8.8]];
    let mut scene = empty_scene(DVec3::new(4.86, 7.2, 5.4), DVec3::ZERO, DVec3::Z, lights.map(DVec3::from));
    if board == Board::Squares {
        add_squares(&mut scene, size, 1, 1.0);
        add_squares(&mut scene, size, 0, 0.5);
    }
    scene.set_material(Material::from_nff(DVec3::new(1.0, 0.5, 0.1), 0.75, 0.25, shine(37.0), 0.0, 0.0));
    for patch in &PATCHES {
        add_patch(&mut scene, size, patch);
    }
    scene
}

/// The squares of one colour: those whose column and row have a sum of this parity.
fn add_squares(scene: &mut Scene, size: u32, parity: u32, grey: f64) {
    scene.set_material(Material::from_nff(DVec3::splat(grey), 0.5, 0.5, shine(30.0), 0.0, 0.0));
    let line = |i: u32| BOARD_HALF * (2.0 * f64::from(i) / f64::from(size) - 1.0);
    for column in 0..size {
        for row in (0..size).filter(|row| (column + row) % 2 == parity) {
            let corner = |i: u32, j: u32| DVec3::new(line(column + i), line(row + j), 0.0);
            scene.add_polygon(&[corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)]);
        }
    }
}

/// Size × size cells of two triangles each, but those that a cusp leaves no area.
fn add_patch(scene: &mut Scene, size: u32, patch: &Patch) {
    let line = |i: u32| f64::from(i) / f64::from(size);
    let mut here = (0..=size).map(|t| evaluate(patch, 0.0, line(t))).collect::<Vec<_>>();
    for s in 1..=size {
        let next = (0..=size).map(|t| evaluate(patch, line(s), line(t))).collect::<Vec<_>>();
        for t in 0..size as usize {
            add_triangle(scene, [here[t], here[t + 1], next[t + 1]]);
            add_triangle(scene, [next[t + 1], next[t], here[t]]);
        }
        here = next;
    }
}

#[derive(Clone, Copy)]
struct Vertex {
    point: DVec3,
    normal: DVec3,
    is_cusp: bool,
}

fn add_triangle(scene: &mut Scene, vertices: [Vertex; 3]) {
    if vertices.iter().filter(|vertex| vertex.is_cusp).count() < 2 {
        scene.add_smooth_polygon(&vertices.map(|vertex| vertex.point), &vertices.map(|vertex| vertex.normal));
    }
}

/// The surface at s (along the patch's rows) and t (along its columns), 0 to 1 each.
fn evaluate(patch: &Patch, s: f64, t: f64) -> Vertex {
    let (along_s, slope_s) = bernstein(s);
    let (along_t, slope_t) = bernstein(t);
    let sum = |s: [f64; 4], t: [f64; 4]| {
        let weighted = (0..16).map(|i| DVec3::from(patch[i / 4][i % 4]) * (s[i / 4] * t[i % 4]));
        weighted.sum::<DVec3>()
    };
    let point = sum(along_s, along_t);
    let is_cusp = point.x.abs() < CUSP_DISTANCE && point.y.abs() < CUSP_DISTANCE;
    let normal = if is_cusp {
        // One tangent is zero here.
        if point.z > CUSP_MIDDLE_Z { DVec3::Z } else { DVec3::NEG_Z }
    } else {
        sum(along_s, slope_t).cross(sum(slope_s, along_t)).normalize()
    };
    Vertex { point, normal, is_cusp }
}

/// The cubic Bernstein polynomials and their derivatives.
fn bernstein(x: f64) -> ([f64; 4], [f64; 4]) {
    let y = 1.0 - x;
    (
        [y * y * y, 3.0 * x * y * y, 3.0 * x * x * y, x * x * x],
        [-3.0 * y * y, 3.0 * y * (y - 2.0 * x), 3.0 * x * (2.0 * y - x), 3.0 * x * x],
    )
}
