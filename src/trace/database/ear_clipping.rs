//! Planar polygons to triangles by ear clipping (Meisters 1975), seen along the largest component of
//! Newell's normal.
//!
//! The triangles of a polygon are numbered in the order in which ears are cut, so that order is a part of
//! what this promises: the first ear in vertex order is cut, always. A convex quadrilateral is the one
//! exception, it is cut from vertex 0 to vertex 2.

use std::collections::BTreeSet;

use glam::DVec3;

/// Work that one polygon may take, in comparisons of a vertex with a triangle: some seconds. Every polygon
/// of up to 2,200 vertices is within it, convex ones of any size are, and so is a comb of 10,000.
pub const COMPARISONS_MAX: u64 = 1 << 28;

/// What it costs to look at a vertex again, in comparisons (measured, when caches are cold).
const REVISIT_COMPARISONS: u64 = 16;

/// A triangle of a polygon.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ear {
    /// Indices of the polygon's vertices, in the polygon's orientation.
    pub corners: [u32; 3],
    /// Bit i: the edge from corner i to the next one is inside the polygon, not an edge of it.
    pub interior_edges: u8,
    /// Cut where there was no ear left: the polygon touches or crosses itself, or has no area.
    pub is_forced: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("its outline of {vertices} vertices is too intricate to be cut into triangles, expected a simpler one")]
pub struct TooIntricate {
    pub vertices: usize,
}

/// Cuts a polygon of n vertices into n − 2 triangles; fewer than three vertices give none.
///
/// # Errors
/// It takes more than [`COMPARISONS_MAX`].
pub fn triangulate(vertices: &[DVec3]) -> Result<Vec<Ear>, TooIntricate> {
    let count = vertices.len() as u32;
    let ear = |corners| Ear::new(corners, count);
    if count <= 3 {
        return Ok(if count == 3 { vec![Ear::WHOLE] } else { Vec::new() });
    }
    let outline = Outline::new(vertices);
    if count == 4 && outline.turns().all(|turn| turn >= 0.0) {
        return Ok(vec![ear([0, 1, 2]), ear([0, 2, 3])]);
    }
    if outline.is_strictly_convex() {
        // Vertex 0 is an ear, then vertex 1, …: a fan around the last one, until three are left.
        let fan = (0..count - 3).map(|i| [count - 1, i, i + 1]);
        return Ok(fan.chain([[count - 3, count - 2, count - 1]]).map(ear).collect());
    }
    Clipping::new(outline).run(COMPARISONS_MAX)
}

impl Ear {
    /// What a polygon of three vertices is cut into.
    pub const WHOLE: Self = Self { corners: [0, 1, 2], interior_edges: 0, is_forced: false };

    fn new(corners: [u32; 3], count: u32) -> Self {
        let is_interior = |i: usize| u8::from(corners[(i + 1) % 3] != (corners[i] + 1) % count);
        let interior_edges = is_interior(0) | is_interior(1) << 1 | is_interior(2) << 2;
        Self { corners, interior_edges, is_forced: false }
    }
}

/// A polygon projected along the largest component of its normal, so that it is counter-clockwise.
struct Outline {
    points: Vec<[f64; 2]>,
    sign: f64,
}

impl Outline {
    fn new(vertices: &[DVec3]) -> Self {
        let next = vertices.iter().cycle().skip(1);
        let normal = vertices.iter().zip(next).fold(DVec3::ZERO, |normal, (&a, &b)| {
            let (d, s) = (a - b, a + b);
            normal + DVec3::new(d.y * s.z, d.z * s.x, d.x * s.y)
        });
        let size = normal.abs();
        let axis = if size.x >= size.y && size.x >= size.z {
            0
        } else if size.y >= size.z {
            1
        } else {
            2
        };
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        Self {
            points: vertices.iter().map(|p| [p[u], p[v]]).collect(),
            sign: if normal[axis] > 0.0 { 1.0 } else { -1.0 },
        }
    }

    /// Twice the signed area of a triangle, positive when it is counter-clockwise.
    #[inline]
    fn area(&self, a: u32, b: u32, c: u32) -> f64 {
        let [[ax, ay], [bx, by], [cx, cy]] = [a, b, c].map(|i| self.points[i as usize]);
        self.sign * ((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))
    }

    /// The first vertex from `start` on that lies in a counter-clockwise triangle of other vertices, or on
    /// its edge. This is where the time goes: no branches but one.
    fn first_in(&self, triangle: [u32; 3], start: u32) -> Option<u32> {
        let [a, b, c] = triangle.map(|i| self.points[i as usize]);
        let edges = [(a, b), (b, c), (c, a)].map(|(from, to)| (from, [to[0] - from[0], to[1] - from[1]]));
        let is_left_of = |([x, y], [dx, dy]): ([f64; 2], [f64; 2]), q: [f64; 2]| {
            self.sign * (dx * (q[1] - y) - dy * (q[0] - x)) >= 0.0
        };
        let covers = |q| is_left_of(edges[0], q) & is_left_of(edges[1], q) & is_left_of(edges[2], q);
        let points = self.points.iter().enumerate().skip(start as usize);
        points.filter(|&(_, &q)| covers(q)).map(|(i, _)| i as u32).find(|i| !triangle.contains(i))
    }

    /// No triangle covers this vertex any more.
    fn remove(&mut self, vertex: u32) {
        self.points[vertex as usize] = [f64::NAN; 2];
    }

    fn is_left(&self, vertex: u32) -> bool {
        !self.points[vertex as usize][0].is_nan()
    }

    fn turns(&self) -> impl Iterator<Item = f64> {
        let n = self.points.len() as u32;
        (0..n).map(move |i| self.area((i + n - 1) % n, i, (i + 1) % n))
    }

    /// Every turn is to the left, and the edges turn around once: their direction along the first axis
    /// changes its sign twice (a star also turns left only, but goes around more often).
    fn is_strictly_convex(&self) -> bool {
        let next = self.points.iter().cycle().skip(1);
        let mut signs = self.points.iter().zip(next).map(|(a, b)| b[0] - a[0]).filter(|&d| d != 0.0).map(|d| d > 0.0);
        let Some(first) = signs.next() else { return false };
        let (changes, last) = signs.fold((0, first), |(changes, last), sign| (changes + u32::from(sign != last), sign));
        changes + u32::from(last != first) == 2 && self.turns().all(|turn| turn > 0.0)
    }
}

/// The vertices that are left, and for each why it is no ear, so that it is looked at again only when that
/// reason is gone: a neighbour, or the vertex found in its triangle.
struct Clipping {
    outline: Outline,
    previous: Vec<u32>,
    next: Vec<u32>,
    left: u32,
    /// Vertices that may be ears; all others that are left are known to be none.
    candidates: BTreeSet<u32>,
    /// For each vertex the first one that is left and lies in its triangle, as far as it was searched.
    blocker: Vec<u32>,
    /// For each vertex those that it blocks; some may have another blocker by now.
    blocked: Vec<Vec<u32>>,
    comparisons: u64,
    ears: Vec<Ear>,
}

impl Clipping {
    fn new(outline: Outline) -> Self {
        let n = outline.points.len() as u32;
        Self {
            outline,
            previous: (0..n).map(|i| (i + n - 1) % n).collect(),
            next: (0..n).map(|i| (i + 1) % n).collect(),
            left: n,
            candidates: (0..n).collect(),
            blocker: vec![0; n as usize],
            blocked: vec![Vec::new(); n as usize],
            comparisons: 0,
            ears: Vec::with_capacity(n as usize - 2),
        }
    }

    fn run(mut self, comparisons_max: u64) -> Result<Vec<Ear>, TooIntricate> {
        let mut first = 0;
        while self.left > 3 {
            match self.candidates.pop_first() {
                Some(vertex) if self.is_ear(vertex) => self.cut(vertex, false),
                Some(_) => {}
                None => {
                    first = self.first_left_from(first);
                    self.cut(self.next[first as usize], true);
                }
            }
            if self.comparisons > comparisons_max {
                return Err(TooIntricate { vertices: self.outline.points.len() });
            }
        }
        // What remains is written from its lowest vertex on.
        let last = self.next[self.first_left_from(first) as usize];
        self.push(last, false);
        Ok(self.ears)
    }

    fn first_left_from(&self, vertex: u32) -> u32 {
        (vertex..).find(|&v| self.outline.is_left(v)).unwrap_or(vertex)
    }

    fn triangle(&self, vertex: u32) -> [u32; 3] {
        [self.previous[vertex as usize], vertex, self.next[vertex as usize]]
    }

    fn is_ear(&mut self, vertex: u32) -> bool {
        let triangle @ [a, b, c] = self.triangle(vertex);
        if self.outline.area(a, b, c) <= 0.0 {
            return false;
        }
        // What lies before the last blocker was found outside, and nothing moves.
        let (start, count) = (self.blocker[vertex as usize], self.outline.points.len() as u32);
        let blocker = self.outline.first_in(triangle, start);
        self.comparisons += u64::from(blocker.unwrap_or(count) - start);
        let Some(blocker) = blocker else { return true };
        self.blocker[vertex as usize] = blocker;
        self.blocked[blocker as usize].push(vertex);
        false
    }

    fn push(&mut self, vertex: u32, is_forced: bool) {
        let ear = Ear::new(self.triangle(vertex), self.outline.points.len() as u32);
        self.ears.push(Ear { is_forced, ..ear });
    }

    fn cut(&mut self, vertex: u32, is_forced: bool) {
        self.push(vertex, is_forced);
        let [before, _, after] = self.triangle(vertex);
        self.next[before as usize] = after;
        self.previous[after as usize] = before;
        self.outline.remove(vertex);
        self.left -= 1;
        self.candidates.remove(&vertex);
        for neighbour in [before, after] {
            self.blocker[neighbour as usize] = 0;
            self.candidates.insert(neighbour);
        }
        for blocked in std::mem::take(&mut self.blocked[vertex as usize]) {
            if self.outline.is_left(blocked) && self.blocker[blocked as usize] == vertex {
                self.comparisons += REVISIT_COMPARISONS;
                self.candidates.insert(blocked);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn flat(points: &[[f64; 2]]) -> Vec<DVec3> {
        points.iter().map(|&[x, y]| DVec3::new(x, y, 1.0)).collect()
    }

    fn corners(vertices: &[DVec3]) -> Vec<[u32; 3]> {
        triangulate(vertices).expect("within the bound").iter().map(|ear| ear.corners).collect()
    }

    fn covers(outline: &Outline, [a, b, c]: [u32; 3], q: u32) -> bool {
        [(a, b), (b, c), (c, a)].iter().all(|&(from, to)| outline.area(from, to, q) >= 0.0)
    }

    /// The definition, in cubic time: rescan from the first vertex after every cut.
    fn plain_ear_clipping(vertices: &[DVec3]) -> Vec<[u32; 3]> {
        let outline = Outline::new(vertices);
        let mut left: Vec<u32> = (0..vertices.len() as u32).collect();
        let mut ears = Vec::new();
        while left.len() > 3 {
            let n = left.len();
            let triangle = |i: usize| [left[(i + n - 1) % n], left[i], left[(i + 1) % n]];
            let ear = (0..n).find(|&i| {
                let [a, b, c] = triangle(i);
                outline.area(a, b, c) > 0.0
                    && !left.iter().any(|q| ![a, b, c].contains(q) && covers(&outline, [a, b, c], *q))
            });
            let ear = ear.unwrap_or(1);
            ears.push(triangle(ear));
            left.remove(ear);
        }
        ears.push([left[0], left[1], left[2]]);
        ears
    }

    fn area(points: &[DVec3]) -> DVec3 {
        (1..points.len() - 1).map(|i| (points[i] - points[0]).cross(points[i + 1] - points[0])).sum()
    }

    #[test]
    fn small_polygons_are_cut_as_the_reference_tools_do() {
        let square = flat(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]);
        assert_eq!(corners(&square[..3]), [[0, 1, 2]]);
        assert_eq!(corners(&square), [[0, 1, 2], [0, 2, 3]]);
        let pentagon = flat(&[[0.0, 0.0], [2.0, 0.0], [3.0, 1.0], [1.0, 3.0], [-1.0, 1.0]]);
        assert_eq!(corners(&pentagon), [[4, 0, 1], [4, 1, 2], [2, 3, 4]]);
        // An arrowhead: vertex 3 is reflex, vertex 0 sees past it, 1 does not.
        let arrowhead = flat(&[[0.0, 0.0], [4.0, 4.0], [0.0, 8.0], [1.0, 4.0]]);
        assert_eq!(corners(&arrowhead), [[3, 0, 1], [1, 2, 3]]);
    }

    #[test]
    fn every_axis_and_both_orientations_keep_the_polygons_order() {
        let l_shape = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];
        let expected = corners(&flat(&l_shape));
        let turned: [fn([f64; 2]) -> DVec3; 4] = [
            |[u, v]| DVec3::new(5.0, u, v),
            |[u, v]| DVec3::new(v, 5.0, u),
            |[u, v]| DVec3::new(u, v, 0.25 * u),
            |[u, v]| DVec3::new(-u, v, 5.0),
        ];
        for turn in turned {
            assert_eq!(corners(&l_shape.map(turn)), expected);
        }
    }

    #[test]
    fn interior_edges_are_those_that_the_polygon_lacks() {
        let square = triangulate(&flat(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])).expect("a square");
        assert_eq!(square.iter().map(|ear| ear.interior_edges).collect::<Vec<_>>(), [0b100, 0b001]);
        let triangle = triangulate(&flat(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])).expect("a triangle");
        assert_eq!(triangle[0].interior_edges, 0);
    }

    #[test]
    fn a_convex_polygon_of_a_million_vertices_is_a_fan() {
        let n = 1_000_000;
        let circle: Vec<DVec3> = (0..n)
            .map(|i| {
                // On a parabola and back over its chord: exactly convex in floating point.
                let x = f64::from(i) - f64::from(n) / 2.0;
                DVec3::new(x, x * x, 0.0)
            })
            .collect();
        let cut = corners(&circle);
        assert_eq!(cut.len(), n as usize - 2);
        assert_eq!(cut[1000], [n as u32 - 1, 1000, 1001]);
    }

    /// Teeth so thin and long that every tip's triangle holds many others.
    fn comb(teeth: u32) -> Vec<DVec3> {
        let mut points = vec![[0.0, -1.0], [f64::from(teeth), -1.0]];
        for i in (0..teeth).rev() {
            points.push([f64::from(i) + 0.5, 1e3]);
            points.push([f64::from(i), 0.0]);
        }
        flat(&points)
    }

    #[test]
    fn a_polygon_that_would_take_too_long_is_refused() {
        // A star that goes around thousands of times, so that every ear is blocked again and again.
        let star: Vec<[f64; 2]> = (0..20_000)
            .map(|i| {
                let (sin, cos) = (f64::from(i) * 2.4).sin_cos();
                [cos * (1.0 + f64::from(i % 7)), sin * (1.0 + f64::from(i % 5))]
            })
            .collect();
        let refused = Clipping::new(Outline::new(&flat(&star))).run(1 << 20);
        assert_eq!(refused, Err(TooIntricate { vertices: 20_000 }));
        assert!(
            triangulate(&comb(5_000)).is_ok_and(|ears| ears.len() == 10_000 && !ears.iter().any(|ear| ear.is_forced))
        );
    }

    #[test]
    fn polygons_without_area_end() {
        for vertices in [flat(&[[1.0, 1.0]; 9]), flat(&[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0], [1.5, 0.0]])] {
            let ears = triangulate(&vertices).expect("within the bound");
            assert_eq!(ears.len(), vertices.len() - 2);
            assert!(ears.iter().any(|ear| ear.is_forced));
        }
        assert!(triangulate(&[]).is_ok_and(|ears| ears.is_empty()));
        assert!(triangulate(&[DVec3::ONE; 2]).is_ok_and(|ears| ears.is_empty()));
    }

    proptest! {
        #[test]
        fn any_points_are_cut_as_the_definition_says(points in prop::collection::vec((0i8..12, 0i8..12), 5..60)) {
            let vertices: Vec<DVec3> = points.iter().map(|&(x, y)| DVec3::new(x.into(), y.into(), 0.0)).collect();
            prop_assert_eq!(corners(&vertices), plain_ear_clipping(&vertices));
        }

        #[test]
        fn a_star_shaped_polygon_is_covered_once(radii in prop::collection::vec(0.1f64..10.0, 4..80)) {
            let n = radii.len() as f64;
            let vertices: Vec<DVec3> = radii.iter().enumerate().map(|(i, &radius)| {
                let (sin, cos) = (i as f64 / n * std::f64::consts::TAU).sin_cos();
                DVec3::new(radius * cos, radius * sin, 0.5 * radius * cos)
            }).collect();
            let ears = triangulate(&vertices).expect("within the bound");
            prop_assert!(!ears.iter().any(|ear| ear.is_forced));
            let whole = area(&vertices);
            let parts: Vec<DVec3> = ears.iter().map(|ear| area(&ear.corners.map(|i| vertices[i as usize]))).collect();
            prop_assert!(parts.iter().all(|part| part.dot(whole) > 0.0), "a triangle of the other orientation");
            prop_assert!((parts.iter().sum::<DVec3>() - whole).length() < 1e-9 * whole.length());
            // n edges of its own, and two sides of n − 3 inner ones.
            let interior: u32 = ears.iter().map(|ear| ear.interior_edges.count_ones()).sum();
            prop_assert_eq!(interior as usize, 2 * (vertices.len() - 3));
        }
    }
}
