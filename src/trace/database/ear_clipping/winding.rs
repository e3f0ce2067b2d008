//! Whether an outline goes once around all that it encloses: a line sweeps over the plane (Shamos and Hoey
//! 1976), and the winding number is kept on both sides of every edge that is on it.
//!
//! An outline that touches itself is no obstacle: vertices may be on edges, and edges on one another.

use std::cmp::Ordering;

use super::outline::{Outline, Point, compare, turn};
use super::sequence::Sequence;

/// What it costs to find an edge's place among others at the same point, in steps: exact signs that are close to
/// zero take long.
const TOUCH_STEPS: u64 = 8;

/// Whether no two edges cross, and all winding numbers are 0 or 1; false when it takes more than `steps_max`.
/// `steps` counts the edges looked at: some for each end of an edge, and those that touch one another there.
pub(super) fn is_once_around(outline: &Outline, steps_max: u64, steps: &mut u64) -> bool {
    Sweep::new(outline).run(steps_max, steps)
}

struct Sweep<'a> {
    outline: &'a Outline,
    /// Each from its left end to its right one; edge i starts or ends at vertex i.
    edges: Vec<(Point, Point)>,
    /// How much larger the winding number is above each edge than below it.
    rises: Vec<i64>,
    /// The winding number above each edge on the line.
    above: Vec<i64>,
    /// The edges on the line, from below.
    line: Sequence,
}

impl<'a> Sweep<'a> {
    fn new(outline: &'a Outline) -> Self {
        let n = outline.points.len();
        let next = outline.points.iter().cycle().skip(1);
        let is_forward = |a: Point, b: Point| compare(a, b).is_lt();
        let ends = outline.points.iter().zip(next).map(|(&a, &b)| if is_forward(a, b) { (a, b) } else { (b, a) });
        let edges: Vec<_> = ends.collect();
        let rises = outline.points.iter().zip(&edges).map(
            |(a, (left, _))| {
                if (a == left) == (outline.sign > 0.0) { 1 } else { -1 }
            },
        );
        Self { rises: rises.collect(), above: vec![0; n], line: Sequence::new(n), outline, edges }
    }

    fn run(mut self, steps_max: u64, steps: &mut u64) -> bool {
        let n = self.outline.count();
        let mut vertices: Vec<u32> = (0..n).collect();
        let point = |&vertex: &u32| self.outline.point(vertex);
        vertices.sort_unstable_by(|a, b| compare(point(a), point(b)).then(a.cmp(b)));
        let outline = self.outline;
        let events = vertices.chunk_by(|&a, &b| outline.point(a) == outline.point(b));
        let mut starting = Vec::new();
        for event in events {
            let at = outline.point(event[0]);
            let mut ending = 0;
            starting.clear();
            for edge in event.iter().flat_map(|&vertex| [(vertex + n - 1) % n, vertex]) {
                let (left, right) = self.edges[edge as usize];
                match (left == at, right == at) {
                    (true, false) => starting.push(edge),
                    (false, _) => ending += 1,
                    // It has no length.
                    (true, true) => {}
                }
            }
            if !self.pass(at, ending, &mut starting, steps) || *steps > steps_max {
                return false;
            }
        }
        true
    }

    /// Takes the line over a point where `ending` edges end and others start. False where it is no longer once
    /// around.
    fn pass(&mut self, at: Point, ending: usize, starting: &mut Vec<u32>, steps: &mut u64) -> bool {
        let edges = &self.edges;
        let side = |edge: u32| turn(edges[edge as usize].0, edges[edge as usize].1, at);
        let (below, rest) = self.line.split(self.line.all(), steps, |edge| side(edge) > 0.0);
        let (touched, above) = self.line.split(rest, steps, |edge| side(edge) >= 0.0);
        let (before, mut ended) = (starting.len(), 0);
        self.line.walk(touched, |edge| match edges[edge as usize].1 == at {
            true => ended += 1,
            false => starting.push(edge),
        });
        *steps += TOUCH_STEPS * (starting.len() + ended) as u64;
        // From here on, all go to the right.
        let turn_from_here = |e: u32, f: u32| turn(at, edges[e as usize].1, edges[f as usize].1);
        // Two that go on are on one another, or they cross here.
        if ended != ending || starting[before..].windows(2).any(|pair| turn_from_here(pair[0], pair[1]) != 0.0) {
            return false;
        }
        starting.sort_unstable_by(|&e, &f| {
            0.0.partial_cmp(&turn_from_here(e, f)).unwrap_or(Ordering::Equal).then(e.cmp(&f))
        });
        let (lower, upper) = (self.line.last(below), self.line.first(above));
        let mut winding = lower.map_or(0, |edge| self.above[edge as usize]);
        for (i, &edge) in starting.iter().enumerate() {
            winding += self.rises[edge as usize];
            self.above[edge as usize] = winding;
            let is_highest = starting.get(i + 1).is_none_or(|&next| turn_from_here(edge, next) != 0.0);
            if is_highest && !(0..=1).contains(&winding) {
                return false;
            }
        }
        let crossed = match (starting.first(), starting.last()) {
            (Some(&lowest), Some(&highest)) => self.cross(lower, Some(lowest)) || self.cross(Some(highest), upper),
            _ => self.cross(lower, upper),
        };
        self.line.join(below, starting, above);
        !crossed
    }

    /// Whether two neighbours have a point in common that is an end of neither.
    fn cross(&self, lower: Option<u32>, upper: Option<u32>) -> bool {
        let (Some(lower), Some(upper)) = (lower, upper) else { return false };
        let ((a, b), (c, d)) = (self.edges[lower as usize], self.edges[upper as usize]);
        let are_apart = |x: f64, y: f64| x > 0.0 && y < 0.0 || x < 0.0 && y > 0.0;
        are_apart(turn(a, b, c), turn(a, b, d)) && are_apart(turn(c, d, a), turn(c, d, b))
    }
}
