//! Which vector instructions the fast kernel uses. All of them give the same bits.

pub mod lanes;
#[cfg(target_arch = "x86_64")]
mod x86;

use std::fmt;
use std::str::FromStr;

use lanes::{Doubles, Pair, Singles};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A set of vector instructions, from the least to the most.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Simd {
    /// None: plain code, on every processor.
    Scalar,
    Sse2,
    Avx2,
    /// F, DQ, BW and VL.
    Avx512,
}

impl Simd {
    pub const ALL: [Self; 4] = [Self::Scalar, Self::Sse2, Self::Avx2, Self::Avx512];

    pub const fn name(self) -> &'static str {
        match self {
            Self::Scalar => "scalar",
            Self::Sse2 => "sse2",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        }
    }

    /// Whether this processor has it.
    #[cfg(target_arch = "x86_64")]
    pub fn is_available(self) -> bool {
        match self {
            Self::Scalar | Self::Sse2 => true,
            Self::Avx2 => {
                is_x86_feature_detected!("avx2")
                    && is_x86_feature_detected!("bmi1")
                    && is_x86_feature_detected!("bmi2")
                    && is_x86_feature_detected!("popcnt")
                    && is_x86_feature_detected!("lzcnt")
            }
            Self::Avx512 => {
                Self::Avx2.is_available()
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512vl")
            }
        }
    }

    #[cfg(not(target_arch = "x86_64"))]
    pub fn is_available(self) -> bool {
        self == Self::Scalar
    }

    /// Those that this processor has.
    pub fn available() -> impl Iterator<Item = Self> {
        Self::ALL.into_iter().filter(|simd| simd.is_available())
    }

    /// The most that this processor has.
    pub fn best() -> Self {
        Self::available().last().unwrap_or(Self::Scalar)
    }
}

/// The registers of one set of instructions, filled up to widths that the kernel is written for.
pub trait Registers {
    type F8: Singles;
    type F16: Singles;
    type D8: Doubles;
}

/// Work that is written once for all registers. `run` and all that it calls on vectors must be `#[inline(always)]`:
/// only what ends up inside of [`Simd::run`]'s functions may use their instructions.
pub trait Task {
    type Output;
    fn run<R: Registers>(self) -> Self::Output;
}

struct Plain;

impl Registers for Plain {
    type F8 = Pair<Pair<Pair<f32>>>;
    type F16 = Pair<Pair<Pair<Pair<f32>>>>;
    type D8 = Pair<Pair<Pair<f64>>>;
}

#[cfg(target_arch = "x86_64")]
mod dispatch {
    use super::lanes::Pair;
    use super::x86::{F32x4, F32x8, F32x16, F64x2, F64x4, F64x8};
    use super::{Registers, Task};

    struct Sse2;
    struct Avx2;
    struct Avx512;

    impl Registers for Sse2 {
        type F8 = Pair<F32x4>;
        type F16 = Pair<Pair<F32x4>>;
        type D8 = Pair<Pair<F64x2>>;
    }

    impl Registers for Avx2 {
        type F8 = F32x8;
        type F16 = Pair<F32x8>;
        type D8 = Pair<F64x4>;
    }

    impl Registers for Avx512 {
        type F8 = F32x8;
        type F16 = F32x16;
        type D8 = F64x8;
    }

    #[target_feature(enable = "sse2")]
    pub(super) fn sse2<T: Task>(task: T) -> T::Output {
        task.run::<Sse2>()
    }

    #[target_feature(enable = "avx2,bmi1,bmi2,popcnt,lzcnt")]
    pub(super) fn avx2<T: Task>(task: T) -> T::Output {
        task.run::<Avx2>()
    }

    #[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl,avx2,bmi1,bmi2,popcnt,lzcnt")]
    pub(super) fn avx512<T: Task>(task: T) -> T::Output {
        task.run::<Avx512>()
    }
}

impl Simd {
    /// Runs a task with these instructions.
    ///
    /// # Panics
    /// This processor does not have them.
    #[inline]
    pub fn run<T: Task>(self, task: T) -> T::Output {
        assert!(self.is_available(), "this processor has no {self}");
        match self {
            Self::Scalar => task.run::<Plain>(),
            #[cfg(target_arch = "x86_64")]
            Self::Sse2 => {
                // SAFETY: it is available.
                unsafe { dispatch::sse2(task) }
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => {
                // SAFETY: it is available.
                unsafe { dispatch::avx2(task) }
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                // SAFETY: it is available.
                unsafe { dispatch::avx512(task) }
            }
            #[cfg(not(target_arch = "x86_64"))]
            _ => unreachable!("only scalar is available"),
        }
    }
}

impl fmt::Display for Simd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Simd {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let known = Self::ALL.into_iter().find(|simd| simd.name() == text);
        let simd = known.ok_or_else(|| format!("`{text}`: expected scalar, sse2, avx2 or avx512"))?;
        if simd.is_available() { Ok(simd) } else { Err(format!("this processor has no {simd}")) }
    }
}
