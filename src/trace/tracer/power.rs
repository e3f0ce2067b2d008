//! Powers for Phong's highlight, in as many lanes as there are; the same bits in each.

use super::simd::lanes::Doubles;

/// `base`ⁿ for a positive base, between 2⁻¹⁰⁰⁰ and 2¹⁰⁰⁰: to a few 10⁻¹⁰ of it, and n times 10⁻¹¹, a tenth of what
/// f32 holds.
#[inline(always)]
pub fn power<L: Doubles>(base: L, n: L) -> L {
    let exponent = logarithm(base).mul(n);
    // What is not a number becomes the bound.
    exponential(exponent.min(L::splat(1000.0)).max(L::splat(-1000.0)))
}

/// log₂ of a positive number: of its mantissa m by the series of artanh((m − 1)/(m + 1)).
#[inline(always)]
fn logarithm<L: Doubles>(x: L) -> L {
    let (mantissa, exponent) = x.split();
    let one = L::splat(1.0);
    let s = mantissa.sub(one).div(mantissa.add(one));
    let square = s.mul(s);
    let mut sum = L::splat(1.0 / 11.0);
    for odd in [9.0, 7.0, 5.0, 3.0, 1.0] {
        sum = sum.mul(square).add(L::splat(1.0 / odd));
    }
    exponent.add(s.mul(sum).mul(L::splat(2.0 * std::f64::consts::LOG2_E)))
}

/// 2^x for |x| up to 1000: its whole part into the exponent, e^(f·ln 2) of the rest by its series.
#[inline(always)]
fn exponential<L: Doubles>(x: L) -> L {
    // Adding this leaves no place for a fraction.
    let whole_only = L::splat(1.5 * (1u64 << 52) as f64);
    let whole = x.add(whole_only).sub(whole_only);
    let f = x.sub(whole).mul(L::splat(std::f64::consts::LN_2));
    let mut sum = L::splat(1.0 / 362_880.0);
    for factorial in [40_320.0, 5_040.0, 720.0, 120.0, 24.0, 6.0, 2.0, 1.0, 1.0] {
        sum = sum.mul(f).add(L::splat(1.0 / factorial));
    }
    sum.scaled(whole)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracer::simd::lanes::Pair;

    #[test]
    fn powers_are_those_of_libm() {
        for i in 1..2000 {
            let base = f64::from((f64::from(i) / 1990.0) as f32);
            for n in [0.0, 0.5, 1.0, 3.0, 10.0, 27.5, 100.0, 1000.0] {
                let expected = libm::pow(base, n);
                let error = (power(base, n) / expected - 1.0).abs();
                assert!(expected < 1e-300 || error < 5e-10 + n * 3e-11, "{base} to the {n}: off by {error}");
            }
        }
    }

    #[test]
    fn the_ends_are_what_they_should_be() {
        assert_eq!(power(1.0, 50.0), 1.0);
        assert_eq!(power(0.3, 0.0), 1.0);
        assert_eq!(power(1e-30, 1e30) as f32, 0.0);
        assert_eq!(power(1.001, 1e30) as f32, f32::INFINITY);
        assert!(power(f64::from(f32::MIN_POSITIVE), 1.0) > 0.0);
    }

    #[test]
    fn lanes_do_not_change_the_bits() {
        let power_of = |base, n| power(Pair::of(base, 0.5), Pair::of(n, 3.0)).lower();
        for i in 1..500 {
            let (base, n) = (f64::from(i) / 400.0, f64::from(i % 37));
            assert_eq!(power_of(base, n).to_bits(), power(base, n).to_bits());
        }
    }
}
