//! Ear by ear, from an outline to its triangles.

use std::collections::BTreeSet;

use super::outline::{Outline, Point, is_straight, turn};
use super::point_tree::{Area, PointTree};

/// What it costs to look at a vertex again, in steps (measured, when caches are cold).
const REVISIT_STEPS: u64 = 16;

/// The next of a vertex that is cut off.
const GONE: u32 = u32::MAX;

/// An ear is a vertex that turns left, with no other vertex in its triangle or on its edge. A polygon that does
/// not touch itself always has one; the first is cut.
///
/// Where there is none, the polygon touches itself, and one of the following is cut: the first tip of a spike
/// without width, whose neighbours are in the same direction or one of them at the same place; else the first that
/// turns left and into whose triangle no edge leads, though some may be on its edges; else the one with the smallest
/// triangle. That is one in the middle of a straight line, or the polygon crosses itself, perhaps by no more
/// than the rounding of a coordinate.
pub(super) struct Clipping<'a> {
    outline: &'a Outline,
    extent: f64,
    /// The vertices that are left.
    tree: PointTree,
    previous: Vec<u32>,
    next: Vec<u32>,
    left: u32,
    ears: Candidates,
    /// From when there was no ear for the first time.
    touching: Option<Touching>,
    pub(super) triangles: Vec<[u32; 3]>,
    pub(super) steps: u64,
}

/// What may be cut of a polygon that touches itself. Signs are exact.
struct Touching {
    spikes: BTreeSet<u32>,
    ears: Candidates,
    /// All vertices that are left, by the size of their triangle.
    by_size: BTreeSet<(u64, u32)>,
    size: Vec<u64>,
}

/// The vertices that may be ears, and for each other one why it is none, so that it is looked at again only when
/// that reason is gone: a neighbour, or a vertex in its triangle.
struct Candidates {
    vertices: BTreeSet<u32>,
    /// The vertex that was found in the triangle of each.
    blocker: Vec<u32>,
    /// Those that each vertex blocks; some may have another blocker by now.
    blocked: Vec<Vec<u32>>,
}

impl<'a> Clipping<'a> {
    pub(super) fn new(outline: &'a Outline) -> Self {
        let n = outline.count();
        Self {
            outline,
            extent: outline.extent(),
            tree: PointTree::new(outline),
            previous: (0..n).map(|i| (i + n - 1) % n).collect(),
            next: (0..n).map(|i| (i + 1) % n).collect(),
            left: n,
            ears: Candidates::new(n, (0..n).collect()),
            touching: None,
            triangles: Vec::with_capacity(n as usize - 2),
            steps: 0,
        }
    }

    /// False when it is given up, for it takes more than `steps_max`.
    pub(super) fn run(&mut self, steps_max: u64) -> bool {
        while self.left > 3 {
            let vertex = self.find(steps_max);
            if self.steps > steps_max {
                return false;
            }
            self.cut(vertex);
        }
        // What remains is written from its lowest vertex on.
        self.triangles.push(self.triangle(self.next[self.first_left() as usize]));
        true
    }

    /// What is cut next, or any vertex when it takes too long.
    fn find(&mut self, steps_max: u64) -> u32 {
        while let Some(vertex) = self.ears.vertices.pop_first() {
            if self.is_ear(vertex) || self.steps > steps_max {
                return vertex;
            }
        }
        if self.touching.is_none() {
            self.touching = Some(Touching::new(self.outline.count()));
            for vertex in 0..self.outline.count() {
                if self.next[vertex as usize] != GONE {
                    self.classify(vertex);
                }
            }
        }
        if let Some(spike) = self.touching.as_mut().and_then(|touching| touching.spikes.pop_first()) {
            return spike;
        }
        while let Some(vertex) = self.touching.as_mut().and_then(|touching| touching.ears.vertices.pop_first()) {
            if self.is_touched_ear(vertex) || self.steps > steps_max {
                return vertex;
            }
        }
        let smallest = self.touching.as_ref().and_then(|touching| touching.by_size.first().copied());
        smallest.map_or_else(|| self.first_left(), |(_, vertex)| vertex)
    }

    fn is_ear(&mut self, vertex: u32) -> bool {
        let triangle @ [a, b, c] = self.triangle(vertex);
        if self.outline.area(a, b, c) <= 0.0 {
            return false;
        }
        let area = Area::new(self.outline, triangle, self.extent);
        let is_in = |other: u32, point: Point| area.covers(point) && !triangle.contains(&other);
        let blocker = self.tree.find(&area, &mut self.steps, is_in);
        self.ears.is_free(vertex, blocker)
    }

    /// Whether no edge leads into the triangle of a vertex that turns left.
    fn is_touched_ear(&mut self, vertex: u32) -> bool {
        let triangle = self.triangle(vertex);
        let [a, b, c] = triangle.map(|i| self.outline.point(i));
        let area = Area::new(self.outline, triangle, self.extent);
        let is_left = |(from, to): (Point, Point), point: Point| self.outline.sign * turn(from, to, point);
        let edges = [(a, b), (b, c), (c, a)];
        let leads_in = |other: u32, point: Point| {
            let sides = edges.map(|edge| is_left(edge, point));
            // An end that is in the triangle, or one on its edges, from where the way to a neighbour is into it.
            sides.iter().all(|&side| side >= 0.0)
                && [self.previous[other as usize], self.next[other as usize]].into_iter().any(|neighbour| {
                    let neighbour = self.outline.point(neighbour);
                    edges.iter().zip(sides).all(|(&edge, side)| side > 0.0 || is_left(edge, neighbour) > 0.0)
                })
        };
        let blocker = self.tree.find(&area, &mut self.steps, leads_in);
        self.touching.as_mut().is_some_and(|touching| touching.ears.is_free(vertex, blocker))
    }

    fn first_left(&self) -> u32 {
        (0..self.outline.count()).find(|&v| self.next[v as usize] != GONE).unwrap_or(0)
    }

    fn triangle(&self, vertex: u32) -> [u32; 3] {
        [self.previous[vertex as usize], vertex, self.next[vertex as usize]]
    }

    fn cut(&mut self, vertex: u32) {
        let triangle @ [before, _, after] = self.triangle(vertex);
        self.triangles.push(triangle);
        self.next[before as usize] = after;
        self.previous[after as usize] = before;
        self.next[vertex as usize] = GONE;
        self.tree.remove(vertex);
        self.left -= 1;
        let is_left = |vertex: u32| self.next[vertex as usize] != GONE;
        self.steps += self.ears.release(vertex, is_left);
        self.ears.vertices.remove(&vertex);
        self.ears.vertices.extend([before, after]);
        if let Some(touching) = &mut self.touching {
            touching.forget(vertex);
            // The edges of the neighbours are others now.
            for blocker in triangle {
                self.steps += touching.ears.release(blocker, is_left);
            }
            self.classify(before);
            self.classify(after);
        }
    }

    /// Finds the place of a vertex among those that touch others.
    fn classify(&mut self, vertex: u32) {
        let Some(touching) = &mut self.touching else { return };
        let [a, b, c] = [self.previous[vertex as usize], vertex, self.next[vertex as usize]];
        let turn = self.outline.turn(a, b, c);
        let [a, b, c] = [a, b, c].map(|i| self.outline.point(i));
        touching.forget(vertex);
        // Bits of positive numbers are in their order.
        let size = turn.abs().to_bits();
        touching.size[vertex as usize] = size;
        touching.by_size.insert((size, vertex));
        if turn > 0.0 {
            touching.ears.vertices.insert(vertex);
        } else if turn == 0.0 && !is_straight(a, b, c) {
            touching.spikes.insert(vertex);
        }
    }
}

impl Touching {
    fn new(count: u32) -> Self {
        let ears = Candidates::new(count, BTreeSet::new());
        Self { spikes: BTreeSet::new(), ears, by_size: BTreeSet::new(), size: vec![0; count as usize] }
    }

    fn forget(&mut self, vertex: u32) {
        self.spikes.remove(&vertex);
        self.ears.vertices.remove(&vertex);
        self.ears.blocker[vertex as usize] = GONE;
        self.by_size.remove(&(self.size[vertex as usize], vertex));
    }
}

impl Candidates {
    fn new(count: u32, vertices: BTreeSet<u32>) -> Self {
        Self { vertices, blocker: vec![GONE; count as usize], blocked: vec![Vec::new(); count as usize] }
    }

    /// Whether there is no blocker; one is written down.
    fn is_free(&mut self, vertex: u32, blocker: Option<u32>) -> bool {
        if let Some(blocker) = blocker {
            self.blocker[vertex as usize] = blocker;
            self.blocked[blocker as usize].push(vertex);
        }
        blocker.is_none()
    }

    /// Those that a vertex blocks may be ears again. What that costs, in steps.
    fn release(&mut self, blocker: u32, is_left: impl Fn(u32) -> bool) -> u64 {
        let blocked = std::mem::take(&mut self.blocked[blocker as usize]);
        let before = self.vertices.len();
        self.vertices.extend(blocked.iter().filter(|&&v| is_left(v) && self.blocker[v as usize] == blocker));
        blocked.len() as u64 + REVISIT_STEPS * (self.vertices.len() - before) as u64
    }
}
