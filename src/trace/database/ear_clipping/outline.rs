//! A polygon seen along the largest component of its normal, so that it is counter-clockwise.

use std::cmp::Ordering;
use std::collections::VecDeque;

use glam::DVec3;
use robust::{Coord, orient2d};

pub(super) type Point = [f64; 2];

/// A bound on the rounding of each term of a normal, at coordinates of about 1.
const ROUNDING: f64 = 16.0 * f64::EPSILON;

/// Beside coordinates of about 1; none of its products is rounded to zero.
const NEGLIGIBLE: f64 = 1e-120;

pub(super) struct Outline {
    /// Scaled to about 1.
    pub(super) points: Vec<Point>,
    /// −1 where the points are clockwise.
    pub(super) sign: f64,
}

impl Outline {
    pub(super) fn new(vertices: &[DVec3]) -> Self {
        let scale = scale(vertices);
        let points =
            vertices.iter().map(|&vertex| (vertex * scale).map(|x| if x.abs() < NEGLIGIBLE { 0.0 } else { x }));
        // Newell's normal.
        let next = points.clone().skip(1).chain(points.clone().take(1));
        let normal = points.clone().zip(next).fold(DVec3::ZERO, |normal, (a, b)| {
            let (d, s) = (a - b, a + b);
            normal + DVec3::new(d.y * s.z, d.z * s.x, d.x * s.y)
        });
        let is_rounded_away = normal.abs().max_element() <= vertices.len() as f64 * ROUNDING;
        let (normal, size) = if is_rounded_away { balanced(points.clone()) } else { (normal, normal.abs()) };
        let axis = if size.x >= size.y && size.x >= size.z {
            0
        } else if size.y >= size.z {
            1
        } else {
            2
        };
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        Self { points: points.map(|p| [p[u], p[v]]).collect(), sign: if normal[axis] > 0.0 { 1.0 } else { -1.0 } }
    }

    pub(super) fn count(&self) -> u32 {
        self.points.len() as u32
    }

    pub(super) fn point(&self, vertex: u32) -> Point {
        self.points[vertex as usize]
    }

    /// Twice the signed area of a triangle, positive when it is counter-clockwise; rounded.
    #[inline]
    pub(super) fn area(&self, a: u32, b: u32, c: u32) -> f64 {
        let [[ax, ay], [bx, by], [cx, cy]] = [a, b, c].map(|i| self.point(i));
        self.sign * ((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))
    }

    /// The same with its exact sign: positive when `c` is to the left of the way from `a` to `b`.
    pub(super) fn turn(&self, a: u32, b: u32, c: u32) -> f64 {
        self.sign * turn(self.point(a), self.point(b), self.point(c))
    }

    /// The largest difference of two coordinates.
    pub(super) fn extent(&self) -> f64 {
        let side = |axis: usize| {
            let along = self.points.iter().map(|p| p[axis]);
            let (lo, hi) = along.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), x| (lo.min(x), hi.max(x)));
            hi - lo
        };
        side(0).max(side(1))
    }

    /// How wide the widest clockwise one of some triangles is.
    pub(super) fn clockwise_width(&self, triangles: &[[u32; 3]]) -> f64 {
        let width = |&[a, b, c]: &[u32; 3]| {
            let turn = self.turn(a, b, c);
            let side = |from: u32, to: u32| {
                let ([x, y], [to_x, to_y]) = (self.point(from), self.point(to));
                ((to_x - x) * (to_x - x) + (to_y - y) * (to_y - y)).sqrt()
            };
            if turn < 0.0 { -turn / side(a, b).max(side(b, c)).max(side(c, a)) } else { 0.0 }
        };
        triangles.iter().map(width).fold(0.0, f64::max)
    }

    /// What remains when the tips of spikes without width are cut off. It goes as often around every point.
    pub(super) fn without_spikes(&self) -> Self {
        let mut points: VecDeque<Point> = VecDeque::new();
        let is_tip = |[a, b, c]: [Point; 3]| turn(a, b, c) == 0.0 && !is_straight(a, b, c);
        for &point in &self.points {
            points.push_back(point);
            while let n @ 3.. = points.len()
                && is_tip([points[n - 3], points[n - 2], points[n - 1]])
            {
                points.remove(n - 2);
            }
        }
        // Around the first one.
        while let n @ 3.. = points.len() {
            if is_tip([points[n - 2], points[n - 1], points[0]]) {
                points.pop_back();
            } else if is_tip([points[n - 1], points[0], points[1]]) {
                points.pop_front();
            } else {
                break;
            }
        }
        Self { points: points.into(), sign: self.sign }
    }

    pub(super) fn turns_left_only(&self) -> bool {
        self.areas().all(|area| area >= 0.0)
    }

    /// Every turn is to the left, and the edges turn around once: their direction along the first axis
    /// changes its sign twice (a star also turns left only, but goes around more often).
    pub(super) fn is_strictly_convex(&self) -> bool {
        let next = self.points.iter().cycle().skip(1);
        let mut signs = self.points.iter().zip(next).map(|(a, b)| b[0] - a[0]).filter(|&d| d != 0.0).map(|d| d > 0.0);
        let Some(first) = signs.next() else { return false };
        let (changes, last) = signs.fold((0, first), |(changes, last), sign| (changes + u32::from(sign != last), sign));
        changes + u32::from(last != first) == 2 && self.areas().all(|area| area > 0.0)
    }

    /// Of the triangles at every vertex with its neighbours.
    fn areas(&self) -> impl Iterator<Item = f64> {
        let n = self.count();
        (0..n).map(move |i| self.area((i + n - 1) % n, i, (i + 1) % n))
    }
}

/// The normal, and the size that it would have were no part of the polygon the other way around: what is seen of
/// a polygon whose parts cancel out, such as a bow tie's, or which is small and far away.
fn balanced(mut points: impl Iterator<Item = DVec3> + Clone) -> (DVec3, DVec3) {
    let Some(first) = points.next() else { return Default::default() };
    let ways = points.map(|point| point - first);
    let areas = ways.clone().zip(ways.clone().skip(1)).map(|(a, b)| a.cross(b));
    let (normal, size): (DVec3, DVec3) =
        areas.fold(Default::default(), |(normal, size), area| (normal + area, size + area.abs()));
    if size != DVec3::ZERO {
        return (normal, size);
    }
    // There are only spikes; any plane that they are in.
    let longest = ways.clone().max_by(|a, b| a.length_squared().total_cmp(&b.length_squared())).unwrap_or_default();
    (normal, ways.map(|way| way.cross(longest).abs()).sum())
}

/// A power of two that makes the largest coordinate about 1, so that no product overflows.
fn scale(vertices: &[DVec3]) -> f64 {
    let largest = vertices.iter().fold(0.0f64, |largest, v| largest.max(v.abs().max_element()));
    let exponent = (largest.to_bits() >> 52).clamp(1, 2045);
    f64::from_bits((2046 - exponent) << 52)
}

/// Positive when `c` is to the left of the way from `a` to `b`, zero when it is on it: exact.
pub(super) fn turn(a: Point, b: Point, c: Point) -> f64 {
    let [a, b, c] = [a, b, c].map(|[x, y]| Coord { x, y });
    orient2d(a, b, c)
}

/// From left to right, and from below where neither is to the left.
pub(super) fn compare(a: Point, b: Point) -> Ordering {
    // Equal zeros of either sign.
    let order = |a: f64, b: f64| a.partial_cmp(&b).unwrap_or(Ordering::Equal);
    order(a[0], b[0]).then(order(a[1], b[1]))
}

/// Whether the way from `a` over `b` to `c`, which are on one line, goes on in the same direction.
pub(super) fn is_straight(a: Point, b: Point, c: Point) -> bool {
    compare(a, b).is_ne() && compare(a, b) == compare(b, c)
}

pub(super) fn has_area(vertices: &[DVec3; 3]) -> bool {
    let scale = scale(vertices);
    let [a, b, c] = vertices.map(|vertex| vertex * scale);
    [(0, 1), (1, 2), (2, 0)].into_iter().any(|(u, v)| turn([a[u], a[v]], [b[u], b[v]], [c[u], c[v]]) != 0.0)
}
