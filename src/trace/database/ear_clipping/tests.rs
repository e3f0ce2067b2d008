use std::collections::HashMap;

use proptest::prelude::*;
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;

use super::outline::{Point, turn};
use super::*;

pub(super) fn flat(points: &[Point]) -> Vec<DVec3> {
    points.iter().map(|&[x, y]| DVec3::new(x, y, 1.0)).collect()
}

fn corners(vertices: &[DVec3]) -> Vec<[u32; 3]> {
    triangulate(vertices).ears.iter().map(|ear| ear.corners).collect()
}

fn covers(outline: &Outline, [a, b, c]: [u32; 3], q: u32) -> bool {
    [(a, b), (b, c), (c, a)].iter().all(|&(from, to)| outline.area(from, to, q) >= 0.0)
}

/// The definition, in cubic time: rescan from the first vertex after every cut. `None` where there is no ear.
fn plain_ear_clipping(vertices: &[DVec3]) -> Option<Vec<[u32; 3]>> {
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
        })?;
        ears.push(triangle(ear));
        left.remove(ear);
    }
    ears.push([left[0], left[1], left[2]]);
    Some(ears)
}

fn area(points: &[DVec3]) -> DVec3 {
    (1..points.len().max(2) - 1).map(|i| (points[i] - points[0]).cross(points[i + 1] - points[0])).sum()
}

/// How often a polygon goes around a point that is on none of its edges.
pub(super) fn winding(points: &[Point], at: Point) -> i32 {
    let next = points.iter().cycle().skip(1);
    points.iter().zip(next).fold(0, |winding, (&a, &b)| match (a[1] <= at[1], b[1] <= at[1]) {
        (true, false) if turn(a, b, at) > 0.0 => winding + 1,
        (false, true) if turn(a, b, at) < 0.0 => winding - 1,
        _ => winding,
    })
}

/// [`winding::is_once_around`] by its definition, for points with small whole coordinates.
fn is_once_around_by_definition(points: &[Point]) -> bool {
    let sign = if Outline::new(&flat(points)).sign > 0.0 { 1 } else { -1 };
    let edges: Vec<(Point, Point)> = points.iter().copied().zip(points.iter().copied().cycle().skip(1)).collect();
    let are_apart = |x: f64, y: f64| x * y < 0.0;
    let cross = |&(a, b): &(Point, Point), &(c, d): &(Point, Point)| {
        are_apart(turn(a, b, c), turn(a, b, d)) && are_apart(turn(c, d, a), turn(c, d, b))
    };
    if edges.iter().any(|e| edges.iter().any(|f| cross(e, f))) {
        return false;
    }
    // On both sides of every piece of an edge between two vertices.
    edges.iter().filter(|(a, b)| a != b).all(|&(a, b)| {
        let [dx, dy] = [b[0] - a[0], b[1] - a[1]];
        let along = |p: Point| ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / (dx * dx + dy * dy);
        let on = points.iter().filter(|&&p| turn(a, b, p) == 0.0).map(|&p| along(p));
        let mut on: Vec<f64> = on.filter(|t| (0.0..=1.0).contains(t)).collect();
        on.sort_by(f64::total_cmp);
        on.windows(2).filter(|pair| pair[1] - pair[0] > 1e-9).all(|pair| {
            let t = f64::midpoint(pair[0], pair[1]);
            [-1e-6, 1e-6].iter().all(|off| {
                let at = [a[0] + t * dx - off * dy, a[1] + t * dy + off * dx];
                (0..=1).contains(&(sign * winding(points, at)))
            })
        })
    })
}

/// Polygons of triangles in a mesh that hang together at edges. Whatever of them touches is not joined, so that
/// outlines have slits, holes, bridges, and vertices and edges that coincide.
pub(super) struct Random(Pcg32);

impl Random {
    pub(super) fn new(seed: u64) -> Self {
        Self(Pcg32::seed_from_u64(seed))
    }

    pub(super) fn below(&mut self, n: usize) -> usize {
        self.0.next_u32() as usize % n
    }

    /// The points of a mesh, and for the edge from each vertex to another the one that makes a triangle with it.
    fn mesh(&mut self, side: usize, jitter: usize) -> (Vec<Point>, HashMap<(usize, usize), usize>) {
        let points = (0..side * side).map(|i| {
            [i % side, i / side].map(|cell| (cell * 8 + if jitter == 0 { 0 } else { self.below(jitter) }) as f64)
        });
        let points = points.collect();
        let mut third = HashMap::new();
        for i in (0..side * (side - 1)).filter(|i| i % side + 1 < side) {
            let (a, b, c, d) = (i, i + 1, i + side + 1, i + side);
            let halves = if self.below(2) == 0 { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] };
            for [a, b, c] in halves {
                third.extend([((a, b), c), ((b, c), a), ((c, a), b)]);
            }
        }
        (points, third)
    }

    /// A polygon that touches itself, and twice its area.
    fn touching(&mut self, side: usize, triangles: usize) -> (Vec<Point>, f64) {
        let jitter = self.below(4);
        let (points, third) = self.mesh(side, jitter);
        let mut edges: Vec<_> = third.keys().copied().collect();
        edges.sort_unstable();
        let (a, b) = edges[self.below(edges.len())];
        let mut outline = vec![a, b, third[&(a, b)]];
        let sorted = |mut triangle: [usize; 3]| {
            triangle.sort_unstable();
            triangle
        };
        let mut used = std::collections::HashSet::from([sorted([a, b, third[&(a, b)]])]);
        for _ in 0..4 * triangles {
            let i = self.below(outline.len());
            let (a, b) = (outline[i], outline[(i + 1) % outline.len()]);
            let Some(&c) = third.get(&(b, a)) else { continue };
            if used.len() < triangles && used.insert(sorted([a, b, c])) {
                outline.insert(i + 1, c);
            }
        }
        // Slits are closed, as far as they are.
        let closing = self.below(3) * outline.len();
        for _ in 0..closing {
            let (i, n) = (self.below(outline.len()), outline.len());
            if n > 6 && outline[i] == outline[(i + 2) % n] {
                outline.remove((i + 1) % n);
                outline.remove(if i + 1 < n { i } else { i - 1 });
            }
        }
        let area = |triangle: &[usize]| turn(points[triangle[0]], points[triangle[1]], points[triangle[2]]).abs();
        let area = used.iter().map(|triangle| area(triangle)).sum();
        // Spikes along edges of the mesh, vertices that are there twice.
        let spikes = self.below(3) * self.below(1 + outline.len() / 3);
        for _ in 0..spikes {
            let (i, kind) = (self.below(outline.len()), self.below(3));
            let at = outline[i];
            let neighbours: Vec<usize> = edges.iter().filter(|&&(a, _)| a == at).map(|&(_, b)| b).collect();
            let tip = if kind == 0 || neighbours.is_empty() { at } else { neighbours[self.below(neighbours.len())] };
            outline.splice(i..i, [at, tip]);
        }
        let mut outline: Vec<Point> = outline.into_iter().map(|vertex| points[vertex]).collect();
        for _ in 0..self.below(3) {
            let i = self.below(outline.len());
            let (a, b) = (outline[i], outline[(i + 1) % outline.len()]);
            outline.insert(i + 1, [f64::midpoint(a[0], b[0]), f64::midpoint(a[1], b[1])]);
        }
        let first = self.below(outline.len());
        outline.rotate_left(first);
        (outline, area)
    }
}

/// Everything that is promised of a polygon that does not cross itself; its coordinates are small whole numbers.
fn check_cut(points: &[Point], twice_area: f64, random: &mut Random) -> Result<(), TestCaseError> {
    let cut = triangulate(&flat(points));
    prop_assert_eq!(cut.flaw, (twice_area == 0.0).then_some(Flaw::WithoutArea));
    prop_assert_eq!(cut.ears.len(), points.len() - 2);
    let triangles: Vec<[Point; 3]> = cut.ears.iter().map(|ear| ear.corners.map(|i| points[i as usize])).collect();
    let sign = Outline::new(&flat(points)).sign;
    let areas: Vec<f64> = triangles.iter().map(|&[a, b, c]| sign * turn(a, b, c)).collect();
    prop_assert!(areas.iter().all(|&area| area >= 0.0), "a clockwise triangle");
    prop_assert_eq!(areas.iter().sum::<f64>(), twice_area);
    for _ in 0..20 {
        let at = [0, 1].map(|_| random.below(1 << 20) as f64 / f64::from(1 << 14) + 1e-7);
        let covering = triangles.iter().filter(|triangle| winding(*triangle, at) != 0).count();
        prop_assert_eq!(covering as i32, winding(points, at).abs(), "at {:?}", at);
    }
    // n edges of its own, and two sides of n − 3 inner ones.
    let interior: u32 = cut.ears.iter().map(|ear| ear.interior_edges.count_ones()).sum();
    prop_assert_eq!(interior as usize, 2 * (points.len() - 3));
    Ok(())
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
    let square = triangulate(&flat(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])).ears;
    assert_eq!(square.iter().map(|ear| ear.interior_edges).collect::<Vec<_>>(), [0b100, 0b001]);
    let triangle = triangulate(&flat(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])).ears;
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

#[test]
fn a_polygon_that_would_take_too_long_is_left_out() {
    // A star that goes around thousands of times, so that every ear is blocked again and again.
    let star: Vec<Point> = (0..20_000)
        .map(|i| {
            let (sin, cos) = (f64::from(i) * 2.4).sin_cos();
            [cos * (1.0 + f64::from(i % 7)), sin * (1.0 + f64::from(i % 5))]
        })
        .collect();
    // Back and forth over one line, so that at every vertex thousands of edges touch.
    let mut random = Random::new(1);
    let line: Vec<Point> = (0..20_000).map(|_| [random.below(1 << 20) as f64; 2]).collect();
    for points in [star, line] {
        let cut = Work::default().triangulate(&flat(&points), 1 << 20);
        assert_eq!(cut, Cut { ears: Vec::new(), flaw: Some(Flaw::TooIntricate) });
    }
}

#[test]
fn polygons_without_area_are_cut_and_reported() {
    let line = [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0], [1.5, 0.0]];
    // Its triangles with vertex 0 have none in any plane.
    let spikes = [[1.0, 0.0], [0.0, 1.0], [1.0, 0.0], [0.0, 0.0], [2.0, 0.0]];
    for vertices in [flat(&[[1.0, 1.0]; 9]), flat(&line), flat(&line[..4]), flat(&line[..3]), flat(&spikes)] {
        let cut = triangulate(&vertices);
        assert_eq!(cut.ears.len(), vertices.len() - 2);
        assert_eq!(cut.flaw, Some(Flaw::WithoutArea));
        assert!(cut.ears.iter().all(|ear| area(&ear.corners.map(|i| vertices[i as usize])) == DVec3::ZERO));
    }
    assert_eq!(triangulate(&[]), Cut::default());
    assert_eq!(triangulate(&[DVec3::ONE; 2]), Cut::default());
}

proptest! {
    #[test]
    fn any_points_are_cut_as_the_definition_says(points in prop::collection::vec((0i8..12, 0i8..12), 5..60)) {
        let vertices: Vec<DVec3> = points.iter().map(|&(x, y)| DVec3::new(x.into(), y.into(), 0.0)).collect();
        let cut = triangulate(&vertices);
        prop_assert_eq!(cut.ears.len(), vertices.len() - 2);
        // Where the last triangle is clockwise, the polygon crosses itself, and is cut another way.
        let is_right = |triangles: &Vec<_>| Outline::new(&vertices).clockwise_width(triangles) == 0.0;
        if let Some(expected) = plain_ear_clipping(&vertices).filter(is_right) {
            prop_assert_eq!(corners(&vertices), expected);
        }
    }

    #[test]
    fn a_star_shaped_polygon_is_covered_once(radii in prop::collection::vec(0.1f64..10.0, 4..80)) {
        let n = radii.len() as f64;
        let vertices: Vec<DVec3> = radii.iter().enumerate().map(|(i, &radius)| {
            let (sin, cos) = (i as f64 / n * std::f64::consts::TAU).sin_cos();
            DVec3::new(radius * cos, radius * sin, 0.5 * radius * cos)
        }).collect();
        let Cut { ears, flaw } = triangulate(&vertices);
        prop_assert_eq!(flaw, None);
        let whole = area(&vertices);
        let parts: Vec<DVec3> = ears.iter().map(|ear| area(&ear.corners.map(|i| vertices[i as usize]))).collect();
        prop_assert!(parts.iter().all(|part| part.dot(whole) > 0.0), "a triangle of the other orientation");
        prop_assert!((parts.iter().sum::<DVec3>() - whole).length() < 1e-9 * whole.length());
        // n edges of its own, and two sides of n − 3 inner ones.
        let interior: u32 = ears.iter().map(|ear| ear.interior_edges.count_ones()).sum();
        prop_assert_eq!(interior as usize, 2 * (vertices.len() - 3));
    }

    #[test]
    fn a_polygon_that_touches_itself_is_covered_once(seed: u64, side in 2usize..7, triangles in 1usize..60) {
        let mut random = Random::new(seed);
        let (points, area) = random.touching(side, triangles);
        check_cut(&points, area, &mut random)?;
        let clockwise: Vec<Point> = points.iter().rev().copied().collect();
        check_cut(&clockwise, area, &mut random)?;
    }

    #[test]
    fn what_goes_around_once_is_found_as_the_definition_says(
        points in prop::collection::vec((0i8..5, 0i8..5), 4..11),
    ) {
        let points: Vec<Point> = points.iter().map(|&(x, y)| [x.into(), y.into()]).collect();
        let is_once_around = is_once_around_by_definition(&points);
        prop_assert_eq!(winding::is_once_around(&Outline::new(&flat(&points)), u64::MAX, &mut 0), is_once_around);
        let outline = Outline::new(&flat(&points));
        let best = exhaustive::triangles(&outline);
        let has_triangles = best.is_some_and(|triangles| outline.clockwise_width(&triangles) == 0.0);
        if is_once_around && has_triangles {
            let normal = area(&flat(&points));
            check_cut(&points, normal.z.abs(), &mut Random::new(0))?;
        }
    }
}

/// A square with a square hole that a bridge joins to it.
const KEYHOLE: [Point; 10] = [
    [-2.0, -2.0],
    [2.0, -2.0],
    [2.0, 2.0],
    [-2.0, 2.0],
    [-2.0, -2.0],
    [-1.0, -1.0],
    [-1.0, 1.0],
    [1.0, 1.0],
    [1.0, -1.0],
    [-1.0, -1.0],
];

#[test]
fn holes_are_not_covered() {
    // Two holes at the ends of one bridge, a hole with a corner in common with the outline, and a spike.
    let square = [[0.0, 0.0], [9.0, 0.0], [9.0, 9.0], [0.0, 9.0]];
    let holes: [&[Point]; 4] = [
        &[[0.0, 0.0], [3.0, 3.0], [2.0, 4.0], [3.0, 5.0], [4.0, 4.0], [3.0, 3.0]],
        &[[0.0, 0.0], [3.0, 3.0], [2.0, 5.0], [3.0, 3.0], [6.0, 6.0], [6.0, 7.0], [7.0, 6.0], [6.0, 6.0], [3.0, 3.0]],
        &[[0.0, 0.0], [1.0, 2.0], [2.0, 1.0]],
        &[[0.0, 0.0], [-3.0, -1.0], [0.0, 0.0], [0.0, 0.0], [1.0, 2.0], [2.0, 1.0], [0.0, 0.0], [2.0, 8.0]],
    ];
    let mut random = Random::new(1);
    check_cut(&KEYHOLE, 24.0, &mut random).expect("a square with a hole");
    for (hole, twice_area) in holes.iter().zip([158.0, 161.0, 159.0, 159.0]) {
        let points = [&square[..], hole].concat();
        check_cut(&points, twice_area, &mut random).unwrap_or_else(|error| panic!("{hole:?}: {error}"));
    }
}

#[test]
fn the_size_of_coordinates_does_not_matter() {
    let expected = triangulate(&flat(&KEYHOLE));
    for power in [-1000, -500, 500, 1000] {
        let size = 2.0f64.powi(power);
        assert_eq!(triangulate(&flat(&KEYHOLE).iter().map(|&v| v * size).collect::<Vec<_>>()), expected, "2^{power}");
    }
}

#[test]
fn what_crosses_itself_is_cut_and_reported() {
    let pentagram = [0u8, 2, 4, 1, 3].map(|i| {
        let (sin, cos) = (f64::from(i) * 0.4 * std::f64::consts::PI).sin_cos();
        [cos, sin]
    });
    let twice = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].repeat(2);
    let polygons: [&[Point]; 5] = [
        // Two bow ties, the parts of the second as large as each other.
        &[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [2.0, 2.0]],
        &[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]],
        &pentagram,
        &twice,
        // No edges cross, but it goes through a vertex to its other side.
        &[[0.0, 0.0], [2.0, 0.0], [4.0, 0.0], [4.0, 2.0], [2.0, 0.0], [2.0, -2.0], [0.0, -2.0]],
    ];
    for points in polygons {
        let turned = |v: DVec3| DVec3::new(v.y + v.x, v.x - v.y, v.x);
        for vertices in [flat(points), flat(points).into_iter().map(turned).collect()] {
            let cut = triangulate(&vertices);
            assert_eq!(cut.flaw, Some(Flaw::CrossesItself), "{points:?}");
            assert_eq!(cut.ears.len(), points.len() - 2);
        }
    }
}

proptest! {
    #[test]
    fn a_plane_does_not_matter(seed: u64, side in 2usize..5, triangles in 1usize..30) {
        let (points, area) = Random::new(seed).touching(side, triangles);
        prop_assume!(area > 0.0);
        let expected = triangulate(&flat(&points));
        let planes: [fn(Point) -> DVec3; 4] = [
            |[u, v]| DVec3::new(5.0, u, v),
            |[u, v]| DVec3::new(v, 5.0, u),
            |[u, v]| DVec3::new(u + v, u - v, 3.0 * u),
            |[u, v]| DVec3::new(-u, v, 2.0 * u - v),
        ];
        for plane in planes {
            let vertices: Vec<DVec3> = points.iter().map(|&point| plane(point)).collect();
            prop_assert_eq!(&triangulate(&vertices), &expected);
        }
    }

    /// Turned by any angle, what was on a line is so no more: a polygon that touched itself may cross itself by a
    /// rounding error. That changes next to nothing.
    #[test]
    fn rounded_coordinates_are_cut_as_well(seed: u64, angle in 0.0f64..7.0, triangles in 1usize..30) {
        let (points, twice_area) = Random::new(seed).touching(5, triangles);
        prop_assume!(points.len() <= 100);
        let (sin, cos) = angle.sin_cos();
        let points: Vec<Point> = points.iter().map(|[x, y]| [cos * x - sin * y, sin * x + cos * y]).collect();
        let cut = triangulate(&flat(&points));
        let area = |ear: &Ear| {
            let [a, b, c] = ear.corners.map(|i| points[i as usize]);
            turn(a, b, c).abs()
        };
        let sum: f64 = cut.ears.iter().map(area).sum();
        prop_assert!((sum - twice_area).abs() <= 1e-9 * twice_area, "{sum}, expected {twice_area}");
    }

    /// More than one leaf of the tree.
    #[test]
    fn many_vertices_are_cut_as_the_definition_says(radii in prop::collection::vec(1u16..1000, 100..250)) {
        let points: Vec<Point> = polar(radii.len(), |i| f64::from(radii[i]));
        prop_assert_eq!(Some(corners(&flat(&points))), plain_ear_clipping(&flat(&points)));
    }
}

pub(super) fn polar(n: usize, radius: impl Fn(usize) -> f64) -> Vec<Point> {
    let point = |i: usize| {
        let (sin, cos) = (i as f64 / n as f64 * std::f64::consts::TAU).sin_cos();
        [radius(i) * cos, radius(i) * sin]
    };
    (0..n).map(point).collect()
}
