//! Four numbers side by side: SSE, which every x86-64 processor has, and plain arrays elsewhere. No operation
//! rounds differently from its scalar form, so that the bits are the same everywhere.

use std::ops::{Add, Div, Mul, Sub};

#[cfg(target_arch = "x86_64")]
type Register = std::arch::x86_64::__m128;
#[cfg(not(target_arch = "x86_64"))]
type Register = [f32; 4];

/// Four f32.
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub struct F32x4(Register);

/// All bits of a lane, or none.
pub type Mask = F32x4;

impl F32x4 {
    #[inline(always)]
    pub fn new(lanes: [f32; 4]) -> Self {
        Self(bytemuck::cast(lanes))
    }

    #[inline(always)]
    pub fn splat(value: f32) -> Self {
        Self::new([value; 4])
    }

    /// A vector, and zero.
    #[inline(always)]
    pub fn axes([x, y, z]: [f32; 3]) -> Self {
        Self::new([x, y, z, 0.0])
    }

    #[inline(always)]
    pub fn mask(lanes: [u32; 4]) -> Mask {
        Self(bytemuck::cast(lanes))
    }

    #[inline(always)]
    pub fn to_array(self) -> [f32; 4] {
        bytemuck::cast(self.0)
    }

    /// The smallest of the first three lanes, of numbers.
    #[inline(always)]
    pub fn min_axis(self) -> f32 {
        let two = self.min(self.shuffle::<0b11_10_10_01>());
        two.min(self.shuffle::<0b11_10_01_10>()).to_array()[0]
    }

    /// The largest of the first three lanes, of numbers.
    #[inline(always)]
    pub fn max_axis(self) -> f32 {
        let two = self.max(self.shuffle::<0b11_10_10_01>());
        two.max(self.shuffle::<0b11_10_01_10>()).to_array()[0]
    }
}

impl Default for F32x4 {
    fn default() -> Self {
        Self::splat(0.0)
    }
}

/// Calls an intrinsic that takes no pointers.
#[cfg(target_arch = "x86_64")]
macro_rules! sse {
    ($intrinsic:ident $(::<$lanes:ident>)? ($($operand:expr),*)) => {
        // SAFETY: SSE and SSE2 are a part of x86-64.
        unsafe { std::arch::x86_64::$intrinsic $(::<$lanes>)? ($($operand),*) }
    };
}

#[cfg(target_arch = "x86_64")]
impl F32x4 {
    /// `self` where it is less, else `other`.
    #[inline(always)]
    pub fn min(self, other: Self) -> Self {
        Self(sse!(_mm_min_ps(self.0, other.0)))
    }

    /// `self` where it is greater, else `other`.
    #[inline(always)]
    pub fn max(self, other: Self) -> Self {
        Self(sse!(_mm_max_ps(self.0, other.0)))
    }

    #[inline(always)]
    pub fn abs(self) -> Self {
        Self(sse!(_mm_andnot_ps(Self::splat(-0.0).0, self.0)))
    }

    #[inline(always)]
    pub fn less(self, other: Self) -> Mask {
        Self(sse!(_mm_cmplt_ps(self.0, other.0)))
    }

    #[inline(always)]
    pub fn less_or_equal(self, other: Self) -> Mask {
        Self(sse!(_mm_cmple_ps(self.0, other.0)))
    }

    #[inline(always)]
    pub fn and(self, other: Mask) -> Mask {
        Self(sse!(_mm_and_ps(self.0, other.0)))
    }

    /// As a mask: `yes` where it is set, else `no`.
    #[inline(always)]
    pub fn select(self, yes: Self, no: Self) -> Self {
        let (yes, no) = (sse!(_mm_and_ps(self.0, yes.0)), sse!(_mm_andnot_ps(self.0, no.0)));
        Self(sse!(_mm_or_ps(yes, no)))
    }

    /// Bit i: the sign of lane i, which is set where a mask is.
    #[inline(always)]
    pub fn signs(self) -> u32 {
        sse!(_mm_movemask_ps(self.0)) as u32
    }

    /// Two bits of `LANES` a lane, the first one's lowest: which lane of `self` it gets.
    #[inline(always)]
    pub fn shuffle<const LANES: i32>(self) -> Self {
        Self(sse!(_mm_shuffle_ps::<LANES>(self.0, self.0)))
    }

    /// Lane i of row j of the result is lane j of row i.
    #[inline(always)]
    pub fn transpose([a, b, c, d]: [Self; 4]) -> [Self; 4] {
        let (ab, cd) = (sse!(_mm_unpacklo_ps(a.0, b.0)), sse!(_mm_unpacklo_ps(c.0, d.0)));
        let (ab_upper, cd_upper) = (sse!(_mm_unpackhi_ps(a.0, b.0)), sse!(_mm_unpackhi_ps(c.0, d.0)));
        [
            Self(sse!(_mm_movelh_ps(ab, cd))),
            Self(sse!(_mm_movehl_ps(cd, ab))),
            Self(sse!(_mm_movelh_ps(ab_upper, cd_upper))),
            Self(sse!(_mm_movehl_ps(cd_upper, ab_upper))),
        ]
    }

    /// With the last lane of `other`, of which the last two are the same.
    #[inline(always)]
    pub fn with_last(self, other: Self) -> Self {
        let last_two = sse!(_mm_unpackhi_ps(self.0, other.0));
        Self(sse!(_mm_movelh_ps(self.0, last_two)))
    }
}

#[cfg(not(target_arch = "x86_64"))]
impl F32x4 {
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self(std::array::from_fn(|i| f(self.0[i], other.0[i])))
    }

    fn compare(self, other: Self, f: impl Fn(&f32, &f32) -> bool) -> Mask {
        Self::mask(std::array::from_fn(|i| if f(&self.0[i], &other.0[i]) { u32::MAX } else { 0 }))
    }

    fn bits(self) -> [u32; 4] {
        self.0.map(f32::to_bits)
    }

    pub fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }

    pub fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }

    pub fn abs(self) -> Self {
        Self(self.0.map(f32::abs))
    }

    pub fn less(self, other: Self) -> Mask {
        self.compare(other, f32::lt)
    }

    pub fn less_or_equal(self, other: Self) -> Mask {
        self.compare(other, f32::le)
    }

    pub fn and(self, other: Mask) -> Mask {
        let (a, b) = (self.bits(), other.bits());
        Self::mask(std::array::from_fn(|i| a[i] & b[i]))
    }

    pub fn select(self, yes: Self, no: Self) -> Self {
        let mask = self.bits();
        Self(std::array::from_fn(|i| if mask[i] != 0 { yes.0[i] } else { no.0[i] }))
    }

    pub fn signs(self) -> u32 {
        (0..4).fold(0, |signs, i| signs | self.bits()[i] >> 31 << i)
    }

    pub fn shuffle<const LANES: i32>(self) -> Self {
        Self(std::array::from_fn(|i| self.0[(LANES >> (2 * i) & 3) as usize]))
    }

    pub fn transpose(rows: [Self; 4]) -> [Self; 4] {
        std::array::from_fn(|j| Self(std::array::from_fn(|i| rows[i].0[j])))
    }

    pub fn with_last(self, other: Self) -> Self {
        Self([self.0[0], self.0[1], self.0[2], other.0[3]])
    }
}

macro_rules! arithmetic {
    ($($operator:ident::$function:ident, $intrinsic:ident;)*) => {$(
        impl $operator for F32x4 {
            type Output = Self;

            #[cfg(target_arch = "x86_64")]
            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                Self(sse!($intrinsic(self.0, other.0)))
            }

            #[cfg(not(target_arch = "x86_64"))]
            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                self.zip(other, $operator::$function)
            }
        }
    )*};
}

arithmetic! {
    Add::add, _mm_add_ps;
    Sub::sub, _mm_sub_ps;
    Mul::mul, _mm_mul_ps;
    Div::div, _mm_div_ps;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_do_what_scalars_do() {
        let (a, b) = ([1.0, -2.0, 0.5, f32::INFINITY], [3.0, -2.0, -0.25, 1e30]);
        let (x, y) = (F32x4::new(a), F32x4::new(b));
        let each = |f: fn(f32, f32) -> f32| std::array::from_fn::<f32, 4, _>(|i| f(a[i], b[i]));
        assert_eq!((x + y).to_array(), each(|a, b| a + b));
        assert_eq!((x - y).to_array(), each(|a, b| a - b));
        assert_eq!((x * y).to_array(), each(|a, b| a * b));
        assert_eq!((x / y).to_array(), each(|a, b| a / b));
        assert_eq!((x.min(y).to_array(), x.max(y).to_array()), (each(f32::min), each(f32::max)));
        assert_eq!(x.abs().to_array(), a.map(f32::abs));
        assert_eq!((x.less(y).signs(), x.less_or_equal(y).signs()), (0b0001, 0b0011));
        assert_eq!(x.less_or_equal(y).and(y.less(F32x4::splat(0.0))).signs(), 0b0010);
        assert_eq!(F32x4::mask([u32::MAX, 0, 0, u32::MAX]).select(x, y).to_array(), [a[0], b[1], b[2], a[3]]);
        assert_eq!(x.shuffle::<0b00_11_01_10>().to_array(), [a[2], a[1], a[3], a[0]]);
        assert_eq!(x.with_last(F32x4::splat(7.0)).to_array(), [a[0], a[1], a[2], 7.0]);
        assert_eq!((x.min_axis(), x.max_axis()), (-2.0, 1.0));
        let rows = F32x4::transpose([x, y, F32x4::splat(5.0), F32x4::axes([6.0, 7.0, 8.0])]).map(F32x4::to_array);
        assert_eq!(rows[0], [a[0], b[0], 5.0, 6.0]);
        assert_eq!(rows[3], [a[3], b[3], 5.0, 0.0]);
    }

    /// Where neither is less, and where one is not a number, it is the second.
    #[test]
    fn what_is_not_a_number_gives_way() {
        let (nan, one) = (F32x4::splat(f32::NAN), F32x4::splat(1.0));
        assert_eq!((nan.min(one).to_array(), nan.max(one).to_array()), ([1.0; 4], [1.0; 4]));
        assert_eq!((nan.less(one).signs(), nan.less_or_equal(nan).signs()), (0, 0));
    }
}
