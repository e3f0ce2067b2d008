//! Determinants of f32 vectors without rounding, for what f64 cannot decide.
//!
//! J. R. Shewchuk, *Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric Predicates*, 1997.

pub type Vector = [f32; 3];

/// A sum of f64 numbers without rounding: parts that do not overlap, the smallest first.
#[derive(Clone, Debug)]
pub struct ExactSum {
    parts: [f64; Self::ADDITIONS],
    count: usize,
}

impl Default for ExactSum {
    fn default() -> Self {
        Self { parts: [0.0; Self::ADDITIONS], count: 0 }
    }
}

impl ExactSum {
    /// Every addition makes one part more at most: there are three sides to a triangle, three determinants to a side,
    /// six products to a determinant, added in two halves each.
    const ADDITIONS: usize = 3 * 3 * 6 * 2;

    fn add(&mut self, number: f64) {
        let mut carried = number;
        let mut kept = 0;
        for i in 0..self.count {
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
        if carried != 0.0 {
            self.parts[kept] = carried;
            kept += 1;
        }
        self.count = kept;
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
        self.parts[..self.count].iter().sum()
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_far_apart_are_not_lost() {
        let mut sum = ExactSum::default();
        for number in [1e30, 1.0, 1e-30, -1e30, -1.0] {
            sum.add(number);
        }
        assert_eq!(sum.value(), 1e-30);
    }

    #[test]
    fn a_unit_corner_has_volume_one() {
        let corner = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        assert_eq!(volume([0.0; 3], corner), 1.0);
        assert_eq!(volume([1.0, 0.0, 0.0], corner), 0.0);
    }
}
