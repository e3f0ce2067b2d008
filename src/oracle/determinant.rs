//! Determinants of f32 vectors, exact: their signs, and their values to the last place.
//!
//! J. R. Shewchuk, *Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric Predicates*, 1997.

use glam::DVec3;
use robust::{Coord3D, orient3d};

pub type Vector = [f32; 3];

/// A sum of f64 numbers without rounding: parts that do not overlap, the smallest first.
#[derive(Clone, Debug, Default)]
pub struct ExactSum {
    parts: Vec<f64>,
}

impl ExactSum {
    fn add(&mut self, number: f64) {
        let mut carried = number;
        let mut kept = 0;
        for i in 0..self.parts.len() {
            let part = self.parts[i];
            let sum = carried + part;
            let of_part = sum - carried;
            let error = (carried - (sum - of_part)) + (part - of_part);
            carried = sum;
            if error != 0.0 {
                self.parts[kept] = error;
                kept += 1;
            }
        }
        self.parts.truncate(kept);
        if carried != 0.0 {
            self.parts.push(carried);
        }
    }

    /// The product of two f32 has 48 bits; in halves of 26 and 27 its products with a third one are exact.
    fn add_product(&mut self, sign: f64, a: f32, b: f32, c: f32) {
        let product = sign * (f64::from(a) * f64::from(b));
        let upper = f64::from_bits(product.to_bits() & !((1 << 27) - 1));
        self.add(upper * f64::from(c));
        self.add((product - upper) * f64::from(c));
    }

    /// Adds `sign`·det(a, b, c).
    pub fn add_determinant(&mut self, sign: f64, a: Vector, b: Vector, c: Vector) {
        for (i, j, k) in [(0, 1, 2), (1, 2, 0), (2, 0, 1)] {
            self.add_product(sign, a[i], b[j], c[k]);
            self.add_product(-sign, a[i], b[k], c[j]);
        }
    }

    /// Rounded to the nearest but for the last place; its sign is that of the sum.
    pub fn value(&self) -> f64 {
        self.parts.iter().sum()
    }
}

/// Adds det(direction, a − origin, b − origin): on which side the ray passes the edge from a to b.
pub fn add_side(sum: &mut ExactSum, origin: Vector, direction: Vector, a: Vector, b: Vector) {
    sum.add_determinant(1.0, direction, a, b);
    sum.add_determinant(-1.0, direction, a, origin);
    sum.add_determinant(-1.0, direction, origin, b);
}

/// det(a − origin, b − origin, c − origin).
pub fn volume(origin: Vector, [a, b, c]: [Vector; 3]) -> f64 {
    let mut sum = ExactSum::default();
    sum.add_determinant(1.0, a, b, c);
    sum.add_determinant(-1.0, origin, b, c);
    sum.add_determinant(-1.0, a, origin, c);
    sum.add_determinant(-1.0, a, b, origin);
    sum.value()
}

/// The sign, −1, 0 or 1, of what [`add_side`] adds: by `orient3d` where both differences fit into f64, which is
/// nearly always, else by the exact sum.
pub fn side(origin: Vector, direction: Vector, a: Vector, b: Vector) -> i32 {
    let determinant = match (difference(a, origin), difference(b, origin)) {
        (Some(a), Some(b)) => {
            orient3d(coord(DVec3::from(direction.map(f64::from))), coord(a), coord(b), coord(DVec3::ZERO))
        }
        _ => {
            let mut sum = ExactSum::default();
            add_side(&mut sum, origin, direction, a, b);
            sum.value()
        }
    };
    i32::from(determinant > 0.0) - i32::from(determinant < 0.0)
}

/// a − b where that is exact in f64.
fn difference(a: Vector, b: Vector) -> Option<DVec3> {
    let (a, b) = (DVec3::from(a.map(f64::from)), DVec3::from(b.map(f64::from)));
    let difference = a - b;
    // Two numbers whose rounded difference gives back both lost nothing.
    (difference + b == a && a - difference == b).then_some(difference)
}

fn coord(v: DVec3) -> Coord3D<f64> {
    Coord3D { x: v.x, y: v.y, z: v.z }
}

#[cfg(test)]
mod tests {
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg32;

    use super::*;

    #[test]
    fn the_exact_sum_and_orient3d_agree_on_nearly_degenerate_edges() {
        let mut random = Pcg32::seed_from_u64(9);
        let mut unit = || random.next_u32() as i32 as f32 / i32::MAX as f32;
        let mut signs = [0; 3];
        for i in 0..20_000 {
            let mut vector = || [unit(), unit(), unit()];
            let (origin, a, b) = (vector(), vector(), vector());
            // Towards a point of the edge, exactly in the ray's plane where the sums are exact.
            let share = [0.0, 0.5, 1.0, 0.3][i % 4];
            let direction: Vector = std::array::from_fn(|k| a[k] + (b[k] - a[k]) * share - origin[k]);
            let mut sum = ExactSum::default();
            add_side(&mut sum, origin, direction, a, b);
            let exact = i32::from(sum.value() > 0.0) - i32::from(sum.value() < 0.0);
            assert_eq!(side(origin, direction, a, b), exact, "{origin:?} {direction:?} {a:?} {b:?}");
            signs[(exact + 1) as usize] += 1;
        }
        assert!(signs.iter().all(|&count| count > 10), "{signs:?}");
    }

    #[test]
    fn numbers_far_apart_are_not_lost() {
        let mut sum = ExactSum::default();
        for number in [1e30, 1.0, 1e-30, -1e30, -1.0] {
            sum.add(number);
        }
        assert_eq!(sum.value(), 1e-30);
        // The difference of these has more than 53 bits: the plane through them misses the axis by 1e-30.
        let side_of = |x| side([0.5, 0.0, 0.0], [0.0, 0.0, 1.0], [x, 1.0, 0.0], [0.5, -1.0, 1.0]);
        assert_eq!(
            [side_of(0.5 - 1e-7), side_of(0.5), side_of(0.5 + 1e-7)],
            [-side_of(0.5 + 1e-7), 0, side_of(0.5 + 1e-7)]
        );
        assert_eq!(side([0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [1e-30, 1.0, 0.5], [-1e-30, -1.0, 0.5]), 0);
        assert_ne!(side([0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [1e-30, 1.0, 0.5], [1e-30, -1.0, 0.5]), 0);
    }

    #[test]
    fn a_unit_corner_has_volume_one() {
        let corner = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        assert_eq!(volume([0.0; 3], corner), 1.0);
        assert_eq!(volume([1.0, 0.0, 0.0], corner), 0.0);
    }
}
