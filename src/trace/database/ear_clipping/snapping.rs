//! Outlines that touch themselves but for the rounding of their coordinates, and so may cross themselves a little:
//! a copy is moved by as much, so that it touches itself exactly.
//!
//! Vertices that are close to one another are put at the same place, and edges are led through the vertices that
//! they pass closely (as in snap rounding, Hobby 1999). Only what is cut next is decided by that copy.

use super::clipping::Clipping;
use super::outline::{Outline, Point};
use super::point_tree::{Bounds, PointTree};
use super::winding;

/// Vertices that edges may be led through, per vertex of the outline.
const PASSED_MAX: usize = 4;

pub(super) struct Snapped {
    outline: Outline,
    /// Which vertex of the first outline each is; `None` for one that an edge is led through.
    own: Vec<Option<u32>>,
}

impl Snapped {
    /// What is moved by `tolerance` at the most; `None` when it takes more than `steps_max`, or is so intricate that
    /// edges pass very many vertices.
    pub(super) fn new(outline: &Outline, tolerance: f64, steps_max: u64, steps: &mut u64) -> Option<Self> {
        let n = outline.count();
        let tree = PointTree::new(outline);
        let places = places(outline, &tree, tolerance, steps_max, steps)?;
        let (mut points, mut own, mut passed) = (Vec::new(), Vec::new(), Vec::new());
        for vertex in 0..n {
            let [from, to] = [vertex, (vertex + 1) % n].map(|end| places[end as usize]);
            points.push(outline.point(from));
            own.push(Some(vertex));
            if from == to {
                continue;
            }
            let strip = Strip::new(outline.point(from), outline.point(to), tolerance);
            tree.walk(
                |bounds| strip.may_reach(bounds),
                steps,
                |other, point| {
                    if places[other as usize] == other && other != from && other != to {
                        passed.extend(strip.place(point).map(|place| (place, other)));
                    }
                    false
                },
            );
            if *steps > steps_max || points.len() + passed.len() > (1 + PASSED_MAX) * n as usize {
                return None;
            }
            passed.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            own.resize(own.len() + passed.len(), None);
            points.extend(passed.drain(..).map(|(_, other)| outline.point(other)));
        }
        Some(Self { outline: Outline { points, sign: outline.sign }, own })
    }

    /// Whether it goes once around all that it encloses, its spikes without width left out.
    pub(super) fn is_once_around(&self, steps_max: u64, steps: &mut u64) -> bool {
        winding::is_once_around(&self.outline.without_spikes(), steps_max, steps) && *steps <= steps_max
    }

    /// The triangles of the first outline; `None` when it takes more than `steps_max`.
    pub(super) fn triangles(&self, steps_max: u64, steps: &mut u64) -> Option<Vec<[u32; 3]>> {
        let mut clipping = Clipping::new(&self.outline);
        let is_done = clipping.run(steps_max.saturating_sub(*steps));
        *steps += clipping.steps;
        if !is_done {
            return None;
        }
        let mut mesh = Mesh { snapped: self, triangles: Vec::new(), at: vec![Vec::new(); self.own.len()] };
        clipping.triangles.iter().for_each(|&triangle| mesh.add(triangle));
        for vertex in (0..self.outline.count()).filter(|&vertex| self.own[vertex as usize].is_none()) {
            *steps += mesh.remove(vertex);
            if *steps > steps_max {
                return None;
            }
        }
        let corners = |triangle: &[u32; 3]| {
            let [a, b, c] = triangle.map(|vertex| self.own[vertex as usize]);
            Some([a?, b?, c?])
        };
        Some(mesh.triangles.iter().flatten().filter_map(corners).collect())
    }
}

/// For each vertex the one at whose place it is put.
fn places(outline: &Outline, tree: &PointTree, tolerance: f64, steps_max: u64, steps: &mut u64) -> Option<Vec<u32>> {
    const NONE: u32 = u32::MAX;
    let mut places = vec![NONE; outline.points.len()];
    for vertex in 0..outline.count() {
        if places[vertex as usize] != NONE {
            continue;
        }
        let [x, y] = outline.point(vertex);
        let may_reach = |[lo, hi]: &Bounds| {
            lo[0] <= x + tolerance && hi[0] >= x - tolerance && lo[1] <= y + tolerance && hi[1] >= y - tolerance
        };
        tree.walk(may_reach, steps, |other, point| {
            let is_close = length([point[0] - x, point[1] - y]) <= tolerance;
            if is_close && places[other as usize] == NONE {
                places[other as usize] = vertex;
            }
            false
        });
        if *steps > steps_max {
            return None;
        }
    }
    Some(places)
}

/// All that is closer to an edge than some width.
struct Strip {
    from: Point,
    /// Of length 1.
    along: Point,
    length: f64,
    width: f64,
}

impl Strip {
    fn new(from: Point, to: Point, width: f64) -> Self {
        let [dx, dy] = [to[0] - from[0], to[1] - from[1]];
        let length = length([dx, dy]);
        Self { from, along: [dx / length, dy / length], length, width }
    }

    /// How far along the edge a point is, if it is in the strip.
    fn place(&self, [x, y]: Point) -> Option<f64> {
        let ([x, y], [dx, dy]) = ([x - self.from[0], y - self.from[1]], self.along);
        let place = dx * x + dy * y;
        ((dx * y - dy * x).abs() <= self.width && place > 0.0 && place < self.length).then_some(place)
    }

    /// False where no point within these bounds is in the strip.
    fn may_reach(&self, [lo, hi]: &Bounds) -> bool {
        let [dx, dy] = self.along;
        let half = [0, 1].map(|axis| (hi[axis] - lo[axis]) / 2.0);
        let [x, y] = [0, 1].map(|axis| lo[axis] + half[axis] - self.from[axis]);
        let is_close = |distance: f64, size: f64| distance.abs() <= size + 2.0 * self.width;
        is_close(dx * y - dy * x, dx.abs() * half[1] + dy.abs() * half[0])
            && is_close(
                dx * x + dy * y - self.length / 2.0,
                dx.abs() * half[0] + dy.abs() * half[1] + self.length / 2.0,
            )
    }
}

/// Triangles from which the vertices are removed that edges were led through.
struct Mesh<'a> {
    snapped: &'a Snapped,
    triangles: Vec<Option<[u32; 3]>>,
    /// Those at each such vertex; some may be removed by now.
    at: Vec<Vec<u32>>,
}

impl Mesh<'_> {
    fn add(&mut self, triangle: [u32; 3]) {
        for corner in triangle {
            if self.snapped.own[corner as usize].is_none() {
                self.at[corner as usize].push(self.triangles.len() as u32);
            }
        }
        self.triangles.push(Some(triangle));
    }

    /// Cuts what is around a vertex again, with a straight edge past it. What that costs, in steps.
    fn remove(&mut self, vertex: u32) -> u64 {
        let mut ring = Vec::new();
        for triangle in std::mem::take(&mut self.at[vertex as usize]) {
            let corners = self.triangles[triangle as usize].take();
            ring.extend(corners.into_iter().flatten().filter(|&corner| corner != vertex));
        }
        // From the next vertex to the previous one. All are seen from this one, so what turns left there is an ear.
        let n = self.snapped.outline.count();
        ring.sort_unstable_by_key(|&corner| (corner + n - vertex) % n);
        ring.dedup();
        let mut chain: Vec<u32> = Vec::new();
        for &corner in &ring {
            while let [.., a, b] = chain[..]
                && self.snapped.outline.turn(a, b, corner) > 0.0
            {
                self.add([a, b, corner]);
                chain.pop();
            }
            chain.push(corner);
        }
        // The rest is as narrow as the edge was moved.
        while let [.., a, b] = chain[..]
            && chain.len() > 2
        {
            self.add([chain[0], a, b]);
            chain.pop();
        }
        ring.len() as u64
    }
}

fn length([x, y]: Point) -> f64 {
    (x * x + y * y).sqrt()
}
