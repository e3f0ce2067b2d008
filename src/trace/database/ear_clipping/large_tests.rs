//! Large polygons of many shapes: what cutting them costs, in steps.

use super::outline::{Point, turn};
use super::tests::{Random, flat, polar};
use super::*;

/// Polygons of about n vertices that are hard to cut.
fn large_polygons(n: usize) -> Vec<(&'static str, Vec<Point>)> {
    let (half, quarter) = (n / 2, n / 4);
    // Teeth so thin and long that every tip's triangle is next to many others.
    let teeth = (0..half).rev().flat_map(|i| [[i as f64 + 0.5, 1e3], [i as f64, 0.0]]);
    let comb: Vec<Point> = [[0.0, -1.0], [half as f64, -1.0]].into_iter().chain(teeth).collect();
    let turned = comb.iter().map(|[x, y]| [0.8 * x - 0.6 * y, 0.6 * x + 0.8 * y]).collect();
    let lying = comb.iter().map(|&[x, y]| [-y, x]).collect();
    let tooth = |i: f64| [[i + 0.9, 0.0], [i + 0.9, 5.0], [i + 0.4, 5.0], [i + 0.4, 0.0]];
    let teeth = (0..quarter).rev().flat_map(|i| tooth(i as f64));
    let square_comb = [[0.0, -0.2], [quarter as f64, -0.2]].into_iter().chain(teeth).collect();
    let turns = |i: usize, width: f64| {
        let angle = i as f64 / half as f64 * 100.0 * std::f64::consts::TAU;
        let (sin, cos) = angle.sin_cos();
        [(angle + 10.0 - width) * cos, (angle + 10.0 - width) * sin]
    };
    let spiral = (0..half).map(|i| turns(i, 0.0)).chain((0..half).rev().map(|i| turns(i, 3.0))).collect();
    let circle = polar(half - 1, |_| 1.0);
    let ring = (0..half).map(|i| circle[i % (half - 1)]);
    let hole = ring.clone().rev().map(|[x, y]| [0.8 * x, 0.8 * y]);
    let ring = ring.chain(hole).collect();
    let window = |x: f64| [[x, 0.0], [x, 1.0], [x, 2.0], [x + 0.5, 2.0], [x + 0.5, 1.0], [x, 1.0], [x, 0.0]];
    let windows = (0..n / 7).flat_map(|i| window(i as f64 + 0.25));
    let end = (n / 7) as f64;
    let windows = [[0.0, 0.0]].into_iter().chain(windows).chain([[end, 0.0], [end, 3.0], [0.0, 3.0]]).collect();
    let radii: Vec<f64> = {
        let mut random = Random::new(1);
        (0..n).map(|_| 1.0 + random.below(1000) as f64 / 100.0).collect()
    };
    vec![
        ("comb", comb),
        ("turned comb", turned),
        ("lying comb", lying),
        ("square comb", square_comb),
        ("spiral", spiral),
        ("star", polar(n, |i| if i % 2 == 0 { 1.0 } else { 10.0 })),
        ("any star", polar(n, |i| radii[i])),
        ("ring", ring),
        ("windows", windows),
    ]
}

#[test]
fn large_polygons_are_cut_in_little_more_than_linear_time() {
    for n in [1_000, 10_000, 100_000] {
        for (name, points) in large_polygons(n) {
            let mut work = Work::default();
            let cut = work.triangulate(&flat(&points), u64::MAX);
            assert_eq!((cut.flaw, cut.ears.len()), (None, points.len() - 2), "{name} of {n}");
            let area = |[a, b, c]: [u32; 3]| turn(points[a as usize], points[b as usize], points[c as usize]);
            let areas: Vec<f64> = cut.ears.iter().map(|ear| area(ear.corners)).collect();
            let (sum, sizes) = (areas.iter().sum::<f64>(), areas.iter().map(|area| area.abs()).sum::<f64>());
            assert!((sum - sizes).abs() <= 1e-12 * sizes, "{name} of {n}: clockwise triangles");
            let unit = points.len() as f64 * (points.len() as f64).log2();
            assert!((work.sweep as f64) < 8.0 * unit, "{name} of {n}: {} steps to sweep", work.sweep);
            assert!((work.clipping as f64) < 40.0 * unit, "{name} of {n}: {} steps to clip", work.clipping);
        }
    }
}
