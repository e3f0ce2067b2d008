//! Vectors of three numbers, or of three times several side by side, in f32 or f64.
//!
//! Sums are taken from the first component on, as glam does: both kernels give the same bits.

use super::simd::lanes::Lanes;

pub type V3<L> = [L; 3];

#[inline(always)]
pub fn splat<L: Lanes>(v: [L::Number; 3]) -> V3<L> {
    [L::splat(v[0]), L::splat(v[1]), L::splat(v[2])]
}

/// From three rows.
#[inline(always)]
pub fn load<L: Lanes, Row: AsRef<[L::Number]>>(rows: &[Row; 3], at: usize) -> V3<L> {
    [L::load(&rows[0].as_ref()[at..]), L::load(&rows[1].as_ref()[at..]), L::load(&rows[2].as_ref()[at..])]
}

#[inline(always)]
pub fn store<L: Lanes, Row: AsMut<[L::Number]>>(v: V3<L>, rows: &mut [Row; 3], at: usize) {
    v[0].store(&mut rows[0].as_mut()[at..]);
    v[1].store(&mut rows[1].as_mut()[at..]);
    v[2].store(&mut rows[2].as_mut()[at..]);
}

#[inline(always)]
pub fn add<L: Lanes>(a: V3<L>, b: V3<L>) -> V3<L> {
    [a[0].add(b[0]), a[1].add(b[1]), a[2].add(b[2])]
}

#[inline(always)]
pub fn sub<L: Lanes>(a: V3<L>, b: V3<L>) -> V3<L> {
    [a[0].sub(b[0]), a[1].sub(b[1]), a[2].sub(b[2])]
}

#[inline(always)]
pub fn scale<L: Lanes>(a: V3<L>, by: L) -> V3<L> {
    [a[0].mul(by), a[1].mul(by), a[2].mul(by)]
}

#[inline(always)]
pub fn mul<L: Lanes>(a: V3<L>, b: V3<L>) -> V3<L> {
    [a[0].mul(b[0]), a[1].mul(b[1]), a[2].mul(b[2])]
}

#[inline(always)]
pub fn div<L: Lanes>(a: V3<L>, by: L) -> V3<L> {
    [a[0].div(by), a[1].div(by), a[2].div(by)]
}

#[inline(always)]
pub fn dot<L: Lanes>(a: V3<L>, b: V3<L>) -> L {
    a[0].mul(b[0]).add(a[1].mul(b[1])).add(a[2].mul(b[2]))
}

#[inline(always)]
pub fn cross<L: Lanes>(a: V3<L>, b: V3<L>) -> V3<L> {
    [a[1].mul(b[2]).sub(b[1].mul(a[2])), a[2].mul(b[0]).sub(b[2].mul(a[0])), a[0].mul(b[1]).sub(b[0].mul(a[1]))]
}

#[inline(always)]
pub fn length<L: Lanes>(a: V3<L>) -> L {
    dot(a, a).sqrt()
}

/// Weighted by w, from the first on.
#[inline(always)]
pub fn weighted<L: Lanes>(v: [V3<L>; 3], w: [L; 3]) -> V3<L> {
    add(add(scale(v[0], w[0]), scale(v[1], w[1])), scale(v[2], w[2]))
}

/// Where the bit is set `a`, else `b`.
#[inline(always)]
pub fn select<L: Lanes>(bits: u32, a: V3<L>, b: V3<L>) -> V3<L> {
    [a[0].select(bits, b[0]), a[1].select(bits, b[1]), a[2].select(bits, b[2])]
}

/// Of unit length; `other` where that cannot be.
#[inline(always)]
pub fn normalise_or<L: Lanes<Number = f64>>(a: V3<L>, other: V3<L>) -> V3<L> {
    let by = L::splat(1.0).div(length(a));
    let can = by.lt(L::splat(f64::INFINITY)) & L::splat(0.0).lt(by);
    select(can, scale(a, by), other)
}

#[inline(always)]
pub fn normalise<L: Lanes<Number = f64>>(a: V3<L>) -> V3<L> {
    scale(a, L::splat(1.0).div(length(a)))
}
