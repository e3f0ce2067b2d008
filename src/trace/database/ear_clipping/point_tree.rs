//! Points in a plane, halved again and again along the longer side of their box, so that those in a triangle
//! are found without a look at most others.

use super::outline::{Outline, Point};

/// As many points are looked at one after the other.
const LEAF_POINTS_MAX: usize = 32;

/// A bound on the error of an area, relative to the sum of its two products' sizes.
const ERROR: f64 = 4.0 * f64::EPSILON;

pub(super) type Bounds = [Point; 2];

const NOTHING: Bounds = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];

/// The vertices of an outline that are left.
pub(super) struct PointTree {
    /// Leaf by leaf: the vertices, and their points. A removed one's point is not a number.
    slots: Vec<(u32, Point)>,
    /// Where each vertex is in `slots`.
    slot: Vec<u32>,
    /// Around the points of each node. The children of node i are 2i + 1 and 2i + 2, the leaves come last.
    bounds: Vec<Bounds>,
}

/// A counter-clockwise triangle to look for points in.
pub(super) struct Area {
    bounds: Bounds,
    /// Where each edge starts, and its direction, turned around where the outline is clockwise.
    edges: [(Point, Point); 3],
}

impl Area {
    /// `extent`: of the outline.
    pub(super) fn new(outline: &Outline, triangle: [u32; 3], extent: f64) -> Self {
        let corners @ [a, b, c] = triangle.map(|i| outline.point(i));
        let edge =
            |from: Point, to: Point| (from, [outline.sign * (to[0] - from[0]), outline.sign * (to[1] - from[1])]);
        // A rounded area may be 12 errors of the outline's size too large, so that a point seems to be within
        // all edges though it is this far outside of the triangle.
        let [first, second, third] = triangle;
        let slack = 12.0 * ERROR * extent * extent * extent / outline.area(first, second, third).abs();
        let mut bounds = around(corners.iter());
        for axis in 0..2 {
            bounds[0][axis] -= slack;
            bounds[1][axis] += slack;
        }
        Self { bounds, edges: [edge(a, b), edge(b, c), edge(c, a)] }
    }

    /// Whether a point is in the triangle or on its edge, rounded.
    #[inline]
    pub(super) fn covers(&self, [x, y]: Point) -> bool {
        let is_left_of = |([from_x, from_y], [dx, dy]): (Point, Point)| dx * (y - from_y) - dy * (x - from_x) >= 0.0;
        is_left_of(self.edges[0]) & is_left_of(self.edges[1]) & is_left_of(self.edges[2])
    }

    /// False where no point within these bounds is in the triangle, rounded or not: subtractions and products
    /// with a constant keep the order of what they round.
    fn may_reach(&self, [lo, hi]: &Bounds) -> bool {
        let [own_lo, own_hi] = self.bounds;
        if (0..2).any(|axis| hi[axis] < own_lo[axis] || lo[axis] > own_hi[axis]) {
            return false;
        }
        self.edges.iter().all(|&([x, y], [dx, dy])| {
            let left = dx * (if dx > 0.0 { hi[1] } else { lo[1] } - y);
            let right = dy * (if dy > 0.0 { lo[0] } else { hi[0] } - x);
            !(left - right < -ERROR * (left.abs() + right.abs()))
        })
    }
}

impl PointTree {
    pub(super) fn new(outline: &Outline) -> Self {
        let n = outline.points.len();
        let leaves = n.div_ceil(LEAF_POINTS_MAX).next_power_of_two();
        let mut tree = Self {
            slots: (0..).zip(outline.points.iter().copied()).collect(),
            slot: vec![0; n],
            bounds: vec![NOTHING; 2 * leaves - 1],
        };
        tree.arrange(0, 0, leaves);
        for (slot, &(vertex, _)) in tree.slots.iter().enumerate() {
            tree.slot[vertex as usize] = slot as u32;
        }
        tree
    }

    /// Distributes the points of a node, which has `leaves` leaves from `first` on.
    fn arrange(&mut self, node: usize, first: usize, leaves: usize) {
        let [start, middle, end] = [first, first + leaves / 2, first + leaves].map(|leaf| self.start(leaf));
        let bounds @ [lo, hi] = around(self.slots[start..end].iter().map(|(_, point)| point));
        self.bounds[node] = bounds;
        if leaves == 1 {
            return;
        }
        let axis = usize::from(hi[1] - lo[1] > hi[0] - lo[0]);
        self.slots[start..end]
            .select_nth_unstable_by(middle - start, |(v, p), (w, q)| p[axis].total_cmp(&q[axis]).then(v.cmp(w)));
        self.arrange(2 * node + 1, first, leaves / 2);
        self.arrange(2 * node + 2, first + leaves / 2, leaves / 2);
    }

    fn leaves(&self) -> usize {
        self.bounds.len().div_ceil(2)
    }

    /// The first slot of a leaf.
    fn start(&self, leaf: usize) -> usize {
        leaf * self.slots.len() / self.leaves()
    }

    /// A vertex in an area of which `is_sought` is true. `steps` counts the nodes and points looked at.
    #[inline]
    pub(super) fn find(&self, area: &Area, steps: &mut u64, is_sought: impl Fn(u32, Point) -> bool) -> Option<u32> {
        self.walk(|bounds| area.may_reach(bounds), steps, is_sought)
    }

    /// The first vertex of which `is_last` is true; it is asked about all in the nodes of which `may_reach` is true.
    #[inline]
    pub(super) fn walk(
        &self,
        may_reach: impl Fn(&Bounds) -> bool,
        steps: &mut u64,
        mut is_last: impl FnMut(u32, Point) -> bool,
    ) -> Option<u32> {
        // Two nodes of every level at the most.
        let mut rest = [0; 64];
        let mut count = 1;
        while count > 0 {
            count -= 1;
            let node = rest[count];
            *steps += 1;
            if !may_reach(&self.bounds[node]) {
                continue;
            }
            match (node + 1).checked_sub(self.leaves()) {
                None => {
                    rest[count] = 2 * node + 2;
                    rest[count + 1] = 2 * node + 1;
                    count += 2;
                }
                Some(leaf) => {
                    let slots = &self.slots[self.start(leaf)..self.start(leaf + 1)];
                    *steps += slots.len() as u64;
                    if let Some(&(vertex, _)) = slots.iter().find(|&&(vertex, point)| is_last(vertex, point)) {
                        return Some(vertex);
                    }
                }
            }
        }
        None
    }

    /// From now on it is not found.
    pub(super) fn remove(&mut self, vertex: u32) {
        let slot = self.slot[vertex as usize] as usize;
        self.slots[slot].1 = [f64::NAN; 2];
        let leaf = ((slot + 1) * self.leaves() - 1) / self.slots.len();
        let mut node = self.leaves() - 1 + leaf;
        let points = &self.slots[self.start(leaf)..self.start(leaf + 1)];
        let mut bounds = around(points.iter().map(|(_, point)| point));
        while self.bounds[node] != bounds {
            self.bounds[node] = bounds;
            if node == 0 {
                break;
            }
            node = (node - 1) / 2;
            let [[a, b], [c, d]] = [self.bounds[2 * node + 1], self.bounds[2 * node + 2]];
            bounds = [[a[0].min(c[0]), a[1].min(c[1])], [b[0].max(d[0]), b[1].max(d[1])]];
        }
    }
}

fn around<'a>(points: impl Iterator<Item = &'a Point>) -> Bounds {
    // Neither takes what is not a number.
    points.fold(NOTHING, |[lo, hi], &[x, y]| [[lo[0].min(x), lo[1].min(y)], [hi[0].max(x), hi[1].max(y)]])
}
