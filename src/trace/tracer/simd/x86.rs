//! The vector registers of x86-64.
//!
//! A value of these types is only ever made inside of a function that [`super::Simd::run`] calls once it knows that
//! the processor has the instructions: every `unsafe` here rests on that, and on lengths checked beside it.

use std::arch::x86_64::*;

use super::lanes::{Doubles, Lanes, MANTISSA, ONE, Singles, WHOLE};

macro_rules! instructions {
    ($($name:ident($($other:ident)?) $instruction:ident),*) => {$(
        #[inline(always)]
        fn $name(self $(, $other: Self)?) -> Self {
            // SAFETY: the processor has the instruction, see above.
            Self(unsafe { $instruction(self.0 $(, $other.0)?) })
        }
    )*};
}

macro_rules! registers {
    ($name:ident($register:ident) of $number:ident x $n:literal:
     $set1:ident, $loadu:ident, $storeu:ident, $add:ident, $sub:ident, $mul:ident, $div:ident, $sqrt:ident,
     $min:ident, $max:ident, $and:ident, $andnot:ident, $xor:ident,
     lt |$la:ident, $lb:ident| $lt:expr, le |$ea:ident, $eb:ident| $le:expr,
     select |$bits:ident, $a:ident, $b:ident| $select:expr) => {
        #[derive(Clone, Copy)]
        pub(super) struct $name($register);

        impl Lanes for $name {
            type Number = $number;
            const N: usize = $n;

            #[inline(always)]
            fn splat(number: $number) -> Self {
                // SAFETY: the processor has the instruction, see above.
                Self(unsafe { $set1(number) })
            }
            #[inline(always)]
            fn load(from: &[$number]) -> Self {
                let from = &from[..$n];
                // SAFETY: as above; as many numbers are there.
                Self(unsafe { $loadu(from.as_ptr()) })
            }
            #[inline(always)]
            fn store(self, to: &mut [$number]) {
                let to = &mut to[..$n];
                // SAFETY: as above; as many numbers are there.
                unsafe { $storeu(to.as_mut_ptr(), self.0) }
            }
            instructions!(add(other) $add, sub(other) $sub, mul(other) $mul, div(other) $div, sqrt() $sqrt);
            instructions!(min(other) $min, max(other) $max);
            #[inline(always)]
            fn abs(self) -> Self {
                // SAFETY: as above.
                Self(unsafe { $andnot($set1(-0.0), self.0) })
            }
            #[inline(always)]
            fn turned(self, sign: Self) -> Self {
                // SAFETY: as above.
                Self(unsafe { $xor(self.0, $and($set1(-0.0), sign.0)) })
            }
            #[inline(always)]
            fn lt(self, other: Self) -> u32 {
                let ($la, $lb) = (self.0, other.0);
                // SAFETY: as above.
                (unsafe { $lt }) as u32
            }
            #[inline(always)]
            fn le(self, other: Self) -> u32 {
                let ($ea, $eb) = (self.0, other.0);
                // SAFETY: as above.
                (unsafe { $le }) as u32
            }
            #[inline(always)]
            fn select(self, $bits: u32, other: Self) -> Self {
                let ($a, $b) = (self.0, other.0);
                // SAFETY: as above.
                Self(unsafe { $select })
            }
        }
    };
}

registers!(F32x4(__m128) of f32 x 4:
_mm_set1_ps, _mm_loadu_ps, _mm_storeu_ps, _mm_add_ps, _mm_sub_ps, _mm_mul_ps, _mm_div_ps, _mm_sqrt_ps,
_mm_min_ps, _mm_max_ps, _mm_and_ps, _mm_andnot_ps, _mm_xor_ps,
lt |a, b| _mm_movemask_ps(_mm_cmplt_ps(a, b)), le |a, b| _mm_movemask_ps(_mm_cmple_ps(a, b)),
select |bits, a, b| {
    let each = _mm_setr_epi32(1, 2, 4, 8);
    let mask = _mm_castsi128_ps(_mm_cmpeq_epi32(_mm_and_si128(_mm_set1_epi32(bits as i32), each), each));
    _mm_or_ps(_mm_and_ps(mask, a), _mm_andnot_ps(mask, b))
});

registers!(F64x2(__m128d) of f64 x 2:
_mm_set1_pd, _mm_loadu_pd, _mm_storeu_pd, _mm_add_pd, _mm_sub_pd, _mm_mul_pd, _mm_div_pd, _mm_sqrt_pd,
_mm_min_pd, _mm_max_pd, _mm_and_pd, _mm_andnot_pd, _mm_xor_pd,
lt |a, b| _mm_movemask_pd(_mm_cmplt_pd(a, b)), le |a, b| _mm_movemask_pd(_mm_cmple_pd(a, b)),
select |bits, a, b| {
    let each = _mm_setr_epi32(1, 1, 2, 2);
    let mask = _mm_castsi128_pd(_mm_cmpeq_epi32(_mm_and_si128(_mm_set1_epi32(bits as i32), each), each));
    _mm_or_pd(_mm_and_pd(mask, a), _mm_andnot_pd(mask, b))
});

registers!(F32x8(__m256) of f32 x 8:
_mm256_set1_ps, _mm256_loadu_ps, _mm256_storeu_ps, _mm256_add_ps, _mm256_sub_ps, _mm256_mul_ps, _mm256_div_ps,
_mm256_sqrt_ps, _mm256_min_ps, _mm256_max_ps, _mm256_and_ps, _mm256_andnot_ps, _mm256_xor_ps,
lt |a, b| _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(a, b)),
le |a, b| _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(a, b)),
select |bits, a, b| {
    let each = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
    let mask = _mm256_cmpeq_epi32(_mm256_and_si256(_mm256_set1_epi32(bits as i32), each), each);
    _mm256_blendv_ps(b, a, _mm256_castsi256_ps(mask))
});

registers!(F64x4(__m256d) of f64 x 4:
_mm256_set1_pd, _mm256_loadu_pd, _mm256_storeu_pd, _mm256_add_pd, _mm256_sub_pd, _mm256_mul_pd, _mm256_div_pd,
_mm256_sqrt_pd, _mm256_min_pd, _mm256_max_pd, _mm256_and_pd, _mm256_andnot_pd, _mm256_xor_pd,
lt |a, b| _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_LT_OQ>(a, b)),
le |a, b| _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_LE_OQ>(a, b)),
select |bits, a, b| {
    let each = _mm256_setr_epi64x(1, 2, 4, 8);
    let mask = _mm256_cmpeq_epi64(_mm256_and_si256(_mm256_set1_epi64x(i64::from(bits)), each), each);
    _mm256_blendv_pd(b, a, _mm256_castsi256_pd(mask))
});

registers!(F32x16(__m512) of f32 x 16:
    _mm512_set1_ps, _mm512_loadu_ps, _mm512_storeu_ps, _mm512_add_ps, _mm512_sub_ps, _mm512_mul_ps, _mm512_div_ps,
    _mm512_sqrt_ps, _mm512_min_ps, _mm512_max_ps, _mm512_and_ps, _mm512_andnot_ps, _mm512_xor_ps,
    lt |a, b| _mm512_cmp_ps_mask::<_CMP_LT_OQ>(a, b), le |a, b| _mm512_cmp_ps_mask::<_CMP_LE_OQ>(a, b),
    select |bits, a, b| _mm512_mask_mov_ps(b, bits as u16, a));

registers!(F64x8(__m512d) of f64 x 8:
    _mm512_set1_pd, _mm512_loadu_pd, _mm512_storeu_pd, _mm512_add_pd, _mm512_sub_pd, _mm512_mul_pd, _mm512_div_pd,
    _mm512_sqrt_pd, _mm512_min_pd, _mm512_max_pd, _mm512_and_pd, _mm512_andnot_pd, _mm512_xor_pd,
    lt |a, b| _mm512_cmp_pd_mask::<_CMP_LT_OQ>(a, b), le |a, b| _mm512_cmp_pd_mask::<_CMP_LE_OQ>(a, b),
    select |bits, a, b| _mm512_mask_mov_pd(b, bits as u8, a));

impl Singles for F32x4 {
    #[inline(always)]
    fn differ(self, other: Self) -> u32 {
        // SAFETY: as above.
        unsafe {
            let same = _mm_cmpeq_epi32(_mm_castps_si128(self.0), _mm_castps_si128(other.0));
            !(_mm_movemask_ps(_mm_castsi128_ps(same)) as u32) & 0xf
        }
    }
}

impl Singles for F32x8 {
    #[inline(always)]
    fn differ(self, other: Self) -> u32 {
        // SAFETY: as above.
        unsafe {
            let same = _mm256_cmpeq_epi32(_mm256_castps_si256(self.0), _mm256_castps_si256(other.0));
            !(_mm256_movemask_ps(_mm256_castsi256_ps(same)) as u32) & 0xff
        }
    }
}

impl Singles for F32x16 {
    #[inline(always)]
    fn differ(self, other: Self) -> u32 {
        // SAFETY: as above.
        unsafe { u32::from(_mm512_cmpneq_epi32_mask(_mm512_castps_si512(self.0), _mm512_castps_si512(other.0))) }
    }
    #[inline(always)]
    fn least(self) -> f32 {
        // SAFETY: as above.
        unsafe { _mm512_reduce_min_ps(self.0) }
    }
}

macro_rules! doubles {
    ($name:ident of $n:literal:
     widen |$from:ident| $widen:expr, narrow |$number:ident, $to:ident| $narrow:expr,
     $bits:ident, $number_of:ident, $and:ident, $or:ident, $set1:ident, $right:ident, $left:ident) => {
        impl Doubles for $name {
            #[inline(always)]
            fn widen(from: &[f32]) -> Self {
                let $from = from[..$n].as_ptr();
                // SAFETY: as above; as many numbers are there.
                Self(unsafe { $widen })
            }
            #[inline(always)]
            fn narrow(self, to: &mut [f32]) {
                let ($number, $to) = (self.0, to[..$n].as_mut_ptr());
                // SAFETY: as above; as many numbers are there.
                unsafe { $narrow }
            }
            #[inline(always)]
            fn split(self) -> (Self, Self) {
                // SAFETY: as above.
                let (mantissa, exponent) = unsafe {
                    let bits = $bits(self.0);
                    let one = $or($and(bits, $set1((1 << MANTISSA) - 1)), $set1(ONE as i64));
                    let whole = $or($right::<{ MANTISSA as _ }>(bits), $set1(WHOLE.to_bits() as i64));
                    (Self($number_of(one)), Self($number_of(whole)).sub(Self::splat(WHOLE + 1023.0)))
                };
                let large = Self::splat(std::f64::consts::SQRT_2).lt(mantissa);
                let halved = (mantissa.mul(Self::splat(0.5)), exponent.add(Self::splat(1.0)));
                (halved.0.select(large, mantissa), halved.1.select(large, exponent))
            }
            #[inline(always)]
            fn scaled(self, exponent: Self) -> Self {
                let whole = exponent.add(Self::splat(WHOLE + 1023.0));
                // SAFETY: as above.
                self.mul(Self(unsafe { $number_of($left::<{ MANTISSA as _ }>($bits(whole.0))) }))
            }
        }
    };
}

// Two f32 are moved as 64 bits, whatever they mean.
doubles!(F64x2 of 2:
    widen |from| _mm_cvtps_pd(_mm_castsi128_ps(_mm_loadl_epi64(from.cast()))),
    narrow |number, to| _mm_storel_epi64(to.cast(), _mm_castps_si128(_mm_cvtpd_ps(number))),
    _mm_castpd_si128, _mm_castsi128_pd, _mm_and_si128, _mm_or_si128, _mm_set1_epi64x, _mm_srli_epi64, _mm_slli_epi64);

doubles!(F64x4 of 4:
    widen |from| _mm256_cvtps_pd(_mm_loadu_ps(from)), narrow |number, to| _mm_storeu_ps(to, _mm256_cvtpd_ps(number)),
    _mm256_castpd_si256, _mm256_castsi256_pd, _mm256_and_si256, _mm256_or_si256, _mm256_set1_epi64x,
    _mm256_srli_epi64, _mm256_slli_epi64);

doubles!(F64x8 of 8:
    widen |from| _mm512_cvtps_pd(_mm256_loadu_ps(from)), narrow |number, to| _mm256_storeu_ps(to, _mm512_cvtpd_ps(number)),
    _mm512_castpd_si512, _mm512_castsi512_pd, _mm512_and_si512, _mm512_or_si512, _mm512_set1_epi64,
    _mm512_srli_epi64, _mm512_slli_epi64);
