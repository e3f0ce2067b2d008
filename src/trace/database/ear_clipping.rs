//! Planar polygons to triangles by ear clipping (Meisters 1975), seen along the largest component of
//! Newell's normal.
//!
//! The triangles of a polygon are numbered in the order in which ears are cut, so that order is a part of
//! what this promises: the first ear in vertex order is cut, always. A convex quadrilateral is the one
//! exception, it is cut from vertex 0 to vertex 2.
//!
//! Every cut takes a triangle off the outline, and the triangle's winding number off the outline's. So the
//! triangles cover each point as often as the outline goes around it, unless one of them is clockwise. None is
//! where an outline touches itself, such as one with a hole that is joined by a bridge; see `Clipping`.

mod clipping;
mod exhaustive;
mod outline;
mod point_tree;
mod sequence;
mod snapping;
mod winding;

use glam::DVec3;

use clipping::Clipping;
use outline::Outline;
use snapping::Snapped;

/// Work that a polygon may take, in looks at a vertex or at a group of them: some seconds, or where it is very large,
/// some milliseconds per hundred vertices.
fn steps_max(count: usize) -> u64 {
    (1 << 27).max((count as u64) << 11)
}

/// A clockwise triangle is not seen when it is narrower, relative to the polygon's extent.
const INVISIBLE: f64 = power_of_two(-20);

/// How far vertices are moved to where they may be meant, relative to the polygon's extent: the first distance that
/// gives an outline that does not cross itself is taken. Twice the diagonal of half of the last of six digits is
/// less than the third.
const ROUNDINGS: [f64; 5] =
    [power_of_two(-32), power_of_two(-20), power_of_two(-16), power_of_two(-13), power_of_two(-10)];

/// A polygon that needs larger ones crosses itself.
const ROUNDING_MAX: f64 = ROUNDINGS[2];

/// How wide a clockwise triangle may be, relative to how far its vertices were moved.
const SLACK: f64 = 4.0;

const fn power_of_two(exponent: i64) -> f64 {
    f64::from_bits(((1023 + exponent) as u64) << 52)
}

/// A triangle of a polygon.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ear {
    /// Indices of the polygon's vertices, in the polygon's orientation.
    pub corners: [u32; 3],
    /// Bit i: the edge from corner i to the next one is inside the polygon, not an edge of it.
    pub interior_edges: u8,
}

/// What a polygon is cut into.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Cut {
    /// n − 2 for n vertices, or none where the polygon is left out.
    pub ears: Vec<Ear>,
    pub flaw: Option<Flaw>,
}

/// What is wrong with a polygon.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flaw {
    /// It goes around some points twice or clockwise. Its triangles may overlap and reach out of it.
    CrossesItself,
    /// All vertices are on one line, or it goes back the way that it came.
    WithoutArea,
    /// It would take too long, and is left out.
    TooIntricate,
}

/// Cuts a polygon; fewer than three vertices give no triangle.
pub fn triangulate(vertices: &[DVec3]) -> Cut {
    Work::default().triangulate(vertices, steps_max(vertices.len()))
}

/// Whether three vertices are not on one line.
pub fn has_area(vertices: &[DVec3; 3]) -> bool {
    outline::has_area(vertices)
}

impl Ear {
    /// What a polygon of three vertices is cut into.
    pub const WHOLE: Self = Self { corners: [0, 1, 2], interior_edges: 0 };

    fn new(corners: [u32; 3], count: u32) -> Self {
        let is_interior = |i: usize| u8::from(corners[(i + 1) % 3] != (corners[i] + 1) % count);
        let interior_edges = is_interior(0) | is_interior(1) << 1 | is_interior(2) << 2;
        Self { corners, interior_edges }
    }
}

/// What it took to cut a polygon, in steps.
#[derive(Clone, Copy, Debug, Default)]
struct Work {
    sweep: u64,
    clipping: u64,
    /// All about outlines that are moved.
    snapping: u64,
}

impl Work {
    fn triangulate(&mut self, vertices: &[DVec3], steps_max: u64) -> Cut {
        let count = vertices.len() as u32;
        if count < 3 {
            return Cut::default();
        }
        let outline = Outline::new(vertices);
        let ear = |corners| Ear::new(corners, count);
        let (ears, crosses_itself) = if count == 3 {
            (vec![Ear::WHOLE], false)
        } else if count == 4 && outline.turns_left_only() {
            (vec![ear([0, 1, 2]), ear([0, 2, 3])], false)
        } else if outline.is_strictly_convex() {
            // Vertex 0 is an ear, then vertex 1, …: a fan around the last one, until three are left.
            let fan = (0..count - 3).map(|i| [count - 1, i, i + 1]);
            (fan.chain([[count - 3, count - 2, count - 1]]).map(ear).collect(), false)
        } else {
            let Some((triangles, crosses_itself)) = self.clip(&outline, steps_max) else {
                return Cut { ears: Vec::new(), flaw: Some(Flaw::TooIntricate) };
            };
            (triangles.into_iter().map(ear).collect(), crosses_itself)
        };
        let is_flat = |ear: &Ear| {
            let [a, b, c] = ear.corners;
            outline.turn(a, b, c) == 0.0
        };
        let flaw = if crosses_itself {
            Some(Flaw::CrossesItself)
        } else {
            ears.iter().all(is_flat).then_some(Flaw::WithoutArea)
        };
        Cut { ears, flaw }
    }

    /// The triangles of any outline, and whether it crosses itself; `None` when it takes more than `steps_max`.
    fn clip(&mut self, outline: &Outline, steps_max: u64) -> Option<(Vec<[u32; 3]>, bool)> {
        let is_once_around = winding::is_once_around(outline, steps_max, &mut self.sweep);
        if self.sweep > steps_max {
            return None;
        }
        let mut clipping = Clipping::new(outline);
        let is_done = clipping.run(steps_max);
        self.clipping = clipping.steps;
        let clipped = is_done.then_some(clipping.triangles);
        let is_right = |triangles: &Vec<_>, width: f64| outline.clockwise_width(triangles) <= width * outline.extent();
        let right = clipped.as_ref().filter(|triangles| is_right(triangles, INVISIBLE));
        if is_once_around && right.is_some() {
            return Some((clipped?, false));
        }
        let mut snap = |rounding: f64| {
            let snapped = Snapped::new(outline, rounding * outline.extent(), steps_max, &mut self.snapping)?;
            if !snapped.is_once_around(steps_max, &mut self.snapping) {
                return None;
            }
            // The first triangles are kept where they can be.
            let triangles = right.cloned().or_else(|| snapped.triangles(steps_max, &mut self.snapping))?;
            is_right(&triangles, SLACK * rounding.max(INVISIBLE)).then_some((triangles, rounding > ROUNDING_MAX))
        };
        let snapped = ROUNDINGS.into_iter().find_map(&mut snap);
        if snapped.as_ref().is_some_and(|&(_, crosses_itself)| !crosses_itself) {
            return snapped;
        }
        let best = if right.is_none() { exhaustive::triangles(outline) } else { None };
        Some((best.or(snapped.map(|(triangles, _)| triangles)).or(clipped)?, true))
    }
}

#[cfg(test)]
mod large_tests;
#[cfg(test)]
mod rounding_tests;
#[cfg(test)]
mod tests;
