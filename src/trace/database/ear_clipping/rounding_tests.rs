//! Polygons that touch themselves but for the rounding of their coordinates, as files have them.

use proptest::prelude::*;

use super::outline::Point;
use super::tests::{Random, flat, winding};
use super::*;

impl Random {
    fn unit(&mut self) -> f64 {
        self.below(1 << 20) as f64 / f64::from(1 << 20)
    }

    /// A square with rows of holes. In each row a bridge leads from the left side to the first hole, and from each
    /// to the next; on both sides of it are vertices, most of them on one side only.
    fn keyholes(&mut self, side: usize, rounds: usize) -> Vec<Point> {
        let size = 10.0 * side as f64;
        let mut points = vec![[0.0, 0.0], [size, 0.0], [size, size], [0.0, size]];
        for row in (0..side).rev() {
            let y = 10.0 * row as f64 + 3.0 + 4.0 * self.unit();
            self.bridge([0.0, y], row, 0, (side, rounds), &mut points);
        }
        points
    }

    fn bridge(
        &mut self,
        from: Point,
        row: usize,
        column: usize,
        (side, rounds): (usize, usize),
        points: &mut Vec<Point>,
    ) {
        points.push(from);
        if column == side {
            return;
        }
        // Clockwise from the left; an even number of corners, so that one is at the right.
        let corners = 2 * (2 + self.below(rounds));
        let centre = [10 * column + 5, 10 * row + 5].map(|x| x as f64);
        let hole: Vec<Point> = (0..corners)
            .map(|i| {
                let (sin, cos) = (std::f64::consts::PI * (1.0 - 2.0 * i as f64 / corners as f64)).sin_cos();
                let radius = 1.0 + 3.0 * self.unit();
                [centre[0] + radius * cos, centre[1] + radius * sin]
            })
            .collect();
        self.way(from, hole[0], points);
        points.extend(&hole[..corners / 2]);
        if column + 1 < side {
            self.bridge(hole[corners / 2], row, column + 1, (side, rounds), points);
        }
        points.extend(&hole[corners / 2..]);
        points.push(hole[0]);
        self.way(hole[0], from, points);
        points.push(from);
    }

    /// Up to three vertices between two.
    fn way(&mut self, from: Point, to: Point, points: &mut Vec<Point>) {
        let mut places: Vec<f64> = (0..self.below(4)).map(|_| 0.05 + 0.9 * self.unit()).collect();
        places.sort_by(f64::total_cmp);
        points.extend(places.iter().map(|t| [0, 1].map(|axis| from[axis] + t * (to[axis] - from[axis]))));
    }

    /// Turned and moved up to a distance, and then written with so many digits.
    fn written(&mut self, points: &[Point], distance: f64, digits: usize) -> Vec<Point> {
        let (sin, cos) = (self.unit() * std::f64::consts::TAU).sin_cos();
        let centre = [self.unit() * distance, self.unit() * distance];
        let turned = points.iter().map(|[x, y]| [cos * x - sin * y - centre[0], sin * x + cos * y - centre[1]]);
        let round = |x: f64| format!("{x:.*e}", digits - 1).parse().expect("a number");
        turned.map(|point| point.map(round)).collect()
    }
}

/// Every place that is not so close to an edge, relative to the extent, is covered as often as the polygon goes
/// around it.
fn check_places(points: &[Point], ears: &[Ear], close: f64, random: &mut Random) -> Result<(), TestCaseError> {
    let bound = |axis: usize| {
        let along = points.iter().map(|p| p[axis]);
        along.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), x| (lo.min(x), hi.max(x)))
    };
    let bounds = [bound(0), bound(1)];
    let extent = (bounds[0].1 - bounds[0].0).max(bounds[1].1 - bounds[1].0);
    let next = || points.iter().cycle().skip(1);
    for _ in 0..300 {
        let at = bounds.map(|(lo, hi)| lo + (hi - lo) * random.unit());
        if points.iter().zip(next()).any(|(&a, &b)| distance(a, b, at) < close * extent) {
            continue;
        }
        let covering = ears.iter().filter(|ear| winding(&ear.corners.map(|i| points[i as usize]), at) != 0);
        prop_assert_eq!(covering.count() as i32, winding(points, at).abs(), "at {:?} of {:?}", at, points);
    }
    Ok(())
}

fn distance(a: Point, b: Point, at: Point) -> f64 {
    let ([dx, dy], [x, y]) = ([b[0] - a[0], b[1] - a[1]], [at[0] - a[0], at[1] - a[1]]);
    let square = dx * dx + dy * dy;
    let along = if square > 0.0 { ((dx * x + dy * y) / square).clamp(0.0, 1.0) } else { 0.0 };
    (x - along * dx).hypot(y - along * dy)
}

proptest! {
    #[test]
    fn holes_of_turned_and_rounded_polygons_are_not_covered(
        seed: u64, side in 1usize..5, rounds in 1usize..6, digits in prop::sample::select(vec![6, 7, 10, 16]),
    ) {
        let mut random = Random::new(seed);
        let points = random.keyholes(side, rounds);
        let points = random.written(&points, 30.0, digits);
        let cut = triangulate(&flat(&points));
        prop_assert_eq!(cut.flaw, None);
        prop_assert_eq!(cut.ears.len(), points.len() - 2);
        check_places(&points, &cut.ears, 1e-4, &mut random)?;
    }

    /// Far away, six digits are so few that a polygon crosses itself visibly.
    #[test]
    fn what_is_rounded_visibly_is_cut_up_to_that(seed: u64) {
        let mut random = Random::new(seed);
        let points = random.keyholes(4, 4);
        let points = random.written(&points, 500.0, 6);
        let cut = triangulate(&flat(&points));
        prop_assert_eq!(cut.ears.len(), points.len() - 2);
        check_places(&points, &cut.ears, 5e-3, &mut random)?;
    }
}

/// A vertex of a notch is this far from the wall behind it.
fn notched(depth: f64) -> Vec<Point> {
    let right = [[0.0, 0.0], [120.0, 0.0], [120.0, 120.0], [90.0, 120.0], [90.0, 20.0]];
    [&right[..], &[[60.0, depth], [60.0, 120.0], [30.0, 120.0], [30.0, 20.0]]].concat()
}

#[test]
fn what_crosses_itself_by_less_than_is_seen_is_cut_as_if_it_touched_itself() {
    let mut random = Random::new(1);
    for depth in [1e-3, 1e-9, 1e-14, 0.0, -1e-14, -1e-9, -1e-6, -1e-4, -1e-3] {
        let points = notched(depth);
        let cut = triangulate(&flat(&points));
        assert_eq!(cut.flaw, None, "{depth}");
        check_places(&points, &cut.ears, 1e-4, &mut random).unwrap_or_else(|error| panic!("{depth}: {error}"));
    }
    for depth in [-0.01, -1.0] {
        assert_eq!(triangulate(&flat(&notched(depth))).flaw, Some(Flaw::CrossesItself), "{depth}");
    }
}

#[test]
fn a_spike_that_crosses_a_wall_is_no_flaw() {
    let square = [[0.0, 0.0], [9.0, 0.0], [9.0, 9.0], [0.0, 9.0]];
    // Out of the square; and two that cross one another inside of it.
    let out: &[Point] = &[[0.0, 5.0], [12.0, 3.0], [0.0, 5.0]];
    let crossed: &[Point] = &[[0.0, 6.0], [7.0, 2.0], [0.0, 6.0], [0.0, 3.0], [6.0, 7.0], [0.0, 3.0]];
    let mut random = Random::new(1);
    for spikes in [out, crossed] {
        let points = [&square[..], spikes].concat();
        let cut = triangulate(&flat(&points));
        assert_eq!((cut.flaw, cut.ears.len()), (None, points.len() - 2), "{spikes:?}");
        check_places(&points, &cut.ears, 1e-4, &mut random).unwrap_or_else(|error| panic!("{spikes:?}: {error}"));
    }
}

#[test]
fn large_rounded_polygons_are_cut_as_well() {
    let mut random = Random::new(1);
    for side in [20, 60] {
        let points = random.keyholes(side, 6);
        let points = random.written(&points, 30.0, 7);
        let mut work = Work::default();
        let cut = work.triangulate(&flat(&points), steps_max(points.len()));
        assert_eq!((cut.flaw, cut.ears.len()), (None, points.len() - 2), "{} corners", points.len());
        check_places(&points, &cut.ears, 1e-4, &mut random).expect("every hole is empty");
        let unit = points.len() as f64 * (points.len() as f64).log2();
        assert!((work.snapping as f64) < 100.0 * unit, "{} corners: {} steps", points.len(), work.snapping);
    }
}
