//! Numbers side by side: one source for every set of vector instructions, and for none.
//!
//! Each operation is that of IEEE 754 in each lane, so that a lane's bits do not depend on how many there are.
//! Comparisons give a bit a lane, lane 0 the lowest.

/// `N` numbers.
pub trait Lanes: Copy {
    type Number: Copy;
    const N: usize;

    fn splat(number: Self::Number) -> Self;
    /// The first `N` of a slice that has as many.
    fn load(from: &[Self::Number]) -> Self;
    fn store(self, to: &mut [Self::Number]);
    fn add(self, other: Self) -> Self;
    fn sub(self, other: Self) -> Self;
    fn mul(self, other: Self) -> Self;
    fn div(self, other: Self) -> Self;
    fn sqrt(self) -> Self;
    /// `other` where one is not a number.
    fn min(self, other: Self) -> Self;
    fn max(self, other: Self) -> Self;
    fn abs(self) -> Self;
    /// With the sign turned where `sign` is negative.
    fn turned(self, sign: Self) -> Self;
    /// False where one is not a number.
    fn lt(self, other: Self) -> u32;
    fn le(self, other: Self) -> u32;
    /// Own lanes where the bit is set, else those of `other`.
    fn select(self, bits: u32, other: Self) -> Self;
}

/// Single precision.
pub trait Singles: Lanes<Number = f32> {
    /// Where the bits differ, whatever they mean.
    fn differ(self, other: Self) -> u32;

    /// The least of all lanes.
    #[inline(always)]
    fn least(self) -> f32 {
        let mut numbers = [f32::INFINITY; 16];
        self.store(&mut numbers[..Self::N]);
        let mut least = numbers[0];
        for number in numbers {
            least = if number < least { number } else { least };
        }
        least
    }

    /// The greatest of all lanes.
    #[inline(always)]
    fn most(self) -> f32 {
        -Self::splat(0.0).sub(self).least()
    }
}

/// Double precision.
pub trait Doubles: Lanes<Number = f64> {
    /// The first `N` of a slice, exactly.
    fn widen(from: &[f32]) -> Self;
    /// Rounded to the nearest.
    fn narrow(self, to: &mut [f32]);
    /// Of positive normal numbers, the mantissa from 1/√2 to √2 and the exponent.
    fn split(self) -> (Self, Self);
    /// Times 2 to the power of whole numbers within ±1000.
    fn scaled(self, exponent: Self) -> Self;
}

/// Bits of a double's mantissa.
pub(super) const MANTISSA: u32 = 52;
/// Bits of 1.0.
pub(super) const ONE: u64 = 1.0f64.to_bits();
/// Whole numbers added to it are in its lowest bits.
pub(super) const WHOLE: f64 = (1u64 << MANTISSA) as f64;

macro_rules! operators {
    ($($name:ident $operator:tt),*) => {$(
        #[inline(always)]
        fn $name(self, other: Self) -> Self {
            self $operator other
        }
    )*};
}

macro_rules! scalar {
    ($number:ident) => {
        impl Lanes for $number {
            type Number = $number;
            const N: usize = 1;

            #[inline(always)]
            fn splat(number: $number) -> Self {
                number
            }
            #[inline(always)]
            fn load(from: &[$number]) -> Self {
                from[0]
            }
            #[inline(always)]
            fn store(self, to: &mut [$number]) {
                to[0] = self;
            }
            operators!(add +, sub -, mul *, div /);
            #[inline(always)]
            fn sqrt(self) -> Self {
                $number::sqrt(self)
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                if self < other { self } else { other }
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                if self > other { self } else { other }
            }
            #[inline(always)]
            fn abs(self) -> Self {
                $number::abs(self)
            }
            #[inline(always)]
            fn turned(self, sign: Self) -> Self {
                if sign.is_sign_negative() { -self } else { self }
            }
            #[inline(always)]
            fn lt(self, other: Self) -> u32 {
                u32::from(self < other)
            }
            #[inline(always)]
            fn le(self, other: Self) -> u32 {
                u32::from(self <= other)
            }
            #[inline(always)]
            fn select(self, bits: u32, other: Self) -> Self {
                if bits & 1 == 1 { self } else { other }
            }
        }
    };
}

scalar!(f32);
scalar!(f64);

impl Singles for f32 {
    #[inline(always)]
    fn differ(self, other: Self) -> u32 {
        u32::from(self.to_bits() != other.to_bits())
    }
}

impl Doubles for f64 {
    #[inline(always)]
    fn widen(from: &[f32]) -> Self {
        Self::from(from[0])
    }
    #[inline(always)]
    fn narrow(self, to: &mut [f32]) {
        to[0] = self as f32;
    }
    #[inline(always)]
    fn split(self) -> (Self, Self) {
        let bits = self.to_bits();
        let mantissa = Self::from_bits(bits & ((1 << MANTISSA) - 1) | ONE);
        let exponent = Self::from_bits(bits >> MANTISSA | WHOLE.to_bits()) - (WHOLE + 1023.0);
        let large = mantissa.gt(&std::f64::consts::SQRT_2);
        if large { (mantissa * 0.5, exponent + 1.0) } else { (mantissa, exponent) }
    }
    #[inline(always)]
    fn scaled(self, exponent: Self) -> Self {
        self * Self::from_bits((exponent + (WHOLE + 1023.0)).to_bits() << MANTISSA)
    }
}

/// Twice as many.
#[derive(Clone, Copy)]
pub struct Pair<L>(L, L);

#[cfg(test)]
impl<L> Pair<L> {
    pub(in crate::tracer) fn of(lower: L, upper: L) -> Self {
        Self(lower, upper)
    }
    pub(in crate::tracer) fn lower(self) -> L {
        self.0
    }
}

/// What is done with each half by itself.
macro_rules! halves {
    ($($name:ident($($other:ident)?)),*) => {$(
        #[inline(always)]
        fn $name(self $(, $other: Self)?) -> Self {
            Self(self.0.$name($($other.0)?), self.1.$name($($other.1)?))
        }
    )*};
}

/// Comparisons of each half by itself.
macro_rules! bits_of_halves {
    ($($name:ident),*) => {$(
        #[inline(always)]
        fn $name(self, other: Self) -> u32 {
            self.0.$name(other.0) | self.1.$name(other.1) << L::N
        }
    )*};
}

impl<L: Lanes> Lanes for Pair<L> {
    type Number = L::Number;
    const N: usize = 2 * L::N;

    #[inline(always)]
    fn splat(number: L::Number) -> Self {
        Self(L::splat(number), L::splat(number))
    }
    #[inline(always)]
    fn load(from: &[L::Number]) -> Self {
        let (lower, upper) = from.split_at(L::N);
        Self(L::load(lower), L::load(upper))
    }
    #[inline(always)]
    fn store(self, to: &mut [L::Number]) {
        let (lower, upper) = to.split_at_mut(L::N);
        self.0.store(lower);
        self.1.store(upper);
    }
    halves!(add(other), sub(other), mul(other), div(other), sqrt(), min(other), max(other), abs(), turned(sign));
    bits_of_halves!(lt, le);
    #[inline(always)]
    fn select(self, bits: u32, other: Self) -> Self {
        Self(self.0.select(bits, other.0), self.1.select(bits >> L::N, other.1))
    }
}

impl<L: Singles> Singles for Pair<L> {
    bits_of_halves!(differ);
}

impl<L: Doubles> Doubles for Pair<L> {
    #[inline(always)]
    fn widen(from: &[f32]) -> Self {
        let (lower, upper) = from.split_at(L::N);
        Self(L::widen(lower), L::widen(upper))
    }
    #[inline(always)]
    fn narrow(self, to: &mut [f32]) {
        let (lower, upper) = to.split_at_mut(L::N);
        self.0.narrow(lower);
        self.1.narrow(upper);
    }
    #[inline(always)]
    fn split(self) -> (Self, Self) {
        let (lower, upper) = (self.0.split(), self.1.split());
        (Self(lower.0, upper.0), Self(lower.1, upper.1))
    }
    halves!(scaled(exponent));
}
