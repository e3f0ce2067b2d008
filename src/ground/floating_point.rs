//! The floating-point environment: an image is the same to the bit only where every operation rounds to nearest and
//! numbers below the normal range are not replaced by zero.
//!
//! The environment is found out by calculating, on any architecture: what matters is what this very program computes,
//! not how a register is named. Threads inherit the environment of the thread that starts them.

use std::hint::black_box;

/// How this program calculates, where that is not the default.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum Unusual {
    #[error("numbers are not rounded to the nearest")]
    Rounding,
    /// Flush-to-zero or denormals-are-zero: `-ffast-math` in a library sets them for the whole process.
    #[error("numbers below the normal range are taken for zero")]
    NoSubnormals,
    /// Such as x87 registers of 64 bits of precision, where they are in use.
    #[error("numbers are rounded twice, to another precision first")]
    Precision,
}

/// # Errors
/// The environment is not the default one.
pub fn check() -> Result<(), Unusual> {
    // 1 + `little` and 1 - `little` / 2 are nearest to 1; rounding upwards, downwards or towards zero changes one of them.
    let rounds_to_nearest = |little: f64| {
        let (one, little) = (black_box(1.0_f64), black_box(little));
        black_box(one + little) == 1.0 && black_box(one - little / 2.0) == 1.0 && black_box(-one - little) == -1.0
    };
    let rounds_to_nearest_f32 = |little: f32| {
        let (one, little) = (black_box(1.0_f32), black_box(little));
        black_box(one + little) == 1.0 && black_box(one - little / 2.0) == 1.0 && black_box(-one - little) == -1.0
    };
    if !rounds_to_nearest(f64::EPSILON / 4.0) || !rounds_to_nearest_f32(f32::EPSILON / 4.0) {
        return Err(Unusual::Rounding);
    }
    // Results below the normal range, then operands.
    let results = black_box(f64::MIN_POSITIVE) * 0.5 != 0.0 && black_box(f32::MIN_POSITIVE) * 0.5 != 0.0;
    let operands = black_box(f64::from_bits(1)) * f64::MAX != 0.0 && black_box(f32::from_bits(1)) * f32::MAX != 0.0;
    if !results || !operands {
        return Err(Unusual::NoSubnormals);
    }
    // A little more than half of a last place: rounded once it goes up; by way of x87's precision it becomes a half, and
    // then goes down to even.
    let half_and_a_bit = black_box(f64::EPSILON / 2.0) + black_box(f64::EPSILON / 8192.0);
    if black_box(1.0_f64) + half_and_a_bit != 1.0 + f64::EPSILON {
        return Err(Unusual::Precision);
    }
    Ok(())
}
