//! The volumes that decide a hit in whole numbers, where coordinates are coarse enough: some twenty times faster than
//! floating-point expansions, and as exact.

use super::exact::Vector;

/// Volumes spanned by a ray and a triangle, rounded once; their signs are exact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Volumes {
    /// det(direction, from − origin, to − origin) of the edges opposite to each corner.
    pub edges: [f64; 3],
    /// The sum of the three.
    pub determinant: f64,
    /// det(a − origin, b − origin, c − origin).
    pub triangle: f64,
}

/// Coordinates are taken in units of 2⁻³⁹: a difference of two has 41 bits then, three of them multiplied and six such
/// products summed have 126.
const UNITS: f64 = (1u64 << 39) as f64;

/// `None` where a coordinate is no whole number of units, or beyond ±2.
pub fn volumes(origin: Vector, direction: Vector, corners: [Vector; 3]) -> Option<Volumes> {
    let (origin, direction) = (whole(origin)?, whole(direction)?);
    let corner = |v: Vector| whole(v).map(|v| [v[0] - origin[0], v[1] - origin[1], v[2] - origin[2]]);
    let (a, b, c) = (corner(corners[0])?, corner(corners[1])?, corner(corners[2])?);
    let edges = [dot(direction, cross(b, c)), dot(direction, cross(c, a)), dot(direction, cross(a, b))];
    let triangle = dot(a, cross(b, c));
    let rounded = |volume: i128| volume as f64 / (UNITS * UNITS * UNITS);
    Some(Volumes {
        edges: edges.map(rounded),
        determinant: rounded(edges[0] + edges[1] + edges[2]),
        triangle: rounded(triangle),
    })
}

fn whole(v: Vector) -> Option<[i128; 3]> {
    let mut numbers = [0; 3];
    for (number, x) in numbers.iter_mut().zip(v) {
        let units = f64::from(x) * UNITS;
        // Saturates; what is not a number is 0 and differs.
        let nearest = units as i64;
        if !(nearest as f64 == units && units.abs() <= 2.0 * UNITS) {
            return None;
        }
        *number = i128::from(nearest);
    }
    Some(numbers)
}

fn cross(a: [i128; 3], b: [i128; 3]) -> [i128; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn dot(a: [i128; 3], b: [i128; 3]) -> i128 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg32;

    use super::*;
    use crate::tracer::primitives::exact::{ExactSum, add_side, volume};

    #[test]
    fn volumes_are_those_of_exact_sums() {
        let mut random = Pcg32::seed_from_u64(9);
        let mut compared = 0;
        for i in 0..20_000 {
            // Coarse ones make for many that are zero.
            let steps = [8.0, 1024.0, 4e9][i % 3];
            let mut number =
                || ((f64::from(random.next_u32()) / f64::from(u32::MAX) * 2.0 - 1.0) * steps).round() / steps;
            let mut vector = || [number() as f32, number() as f32, number() as f32];
            let (origin, direction, [a, b, c]) = (vector(), vector(), [vector(), vector(), vector()]);
            let Some(found) = volumes(origin, direction, [a, b, c]) else { continue };
            compared += 1;
            let mut all = ExactSum::default();
            let near = |a: f64, b: f64| (a - b).abs() <= 1e-15 * b.abs();
            for (edge, (from, to)) in found.edges.into_iter().zip([(b, c), (c, a), (a, b)]) {
                let mut sum = ExactSum::default();
                add_side(&mut sum, origin, direction, from, to);
                add_side(&mut all, origin, direction, from, to);
                assert!(near(edge, sum.value()), "{edge} {}", sum.value());
            }
            assert!(near(found.determinant, all.value()) && near(found.triangle, volume(origin, [a, b, c])));
        }
        assert!(compared > 15_000, "{compared}");
    }

    #[test]
    fn the_largest_volumes_fit_and_the_finest_are_left() {
        let far = [[1.0, -1.0, 1.0], [-1.0, 1.0, 1.0], [1.0, 1.0, -1.0]];
        let found = volumes([-1.0; 3], [1.0; 3], far).expect("whole numbers");
        assert_eq!(found.triangle, volume([-1.0; 3], far));
        assert_eq!(volumes([1e-30, 0.0, 0.0], [1.0; 3], far), None);
        assert_eq!(volumes([0.0; 3], [f32::NAN, 0.0, 1.0], far), None);
        assert_eq!(volumes([0.0; 3], [1e20, 0.0, 1.0], far), None);
    }
}
