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

#[cfg(test)]
#[cfg(target_arch = "x86_64")]
mod tests {
    use std::arch::asm;
    use std::thread;

    use super::*;
    use crate::image_file::FrameBuffer;
    use crate::picture::ImageSettings;
    use crate::preparation::{self, Fallback, Prepared};
    use crate::render::{self, Kernel, Settings};
    use crate::scene::SceneSource;
    use crate::tracer::bvh8::Bvh8;
    use crate::tracer::octree::Octree;
    use crate::tracer::simd::Simd;

    const FLUSH_TO_ZERO: u32 = 1 << 15;
    const DENORMALS_ARE_ZERO: u32 = 1 << 6;
    const ROUND: u32 = 13;

    /// On a thread of its own, whose MXCSR has these bits too.
    fn with<T: Send>(bits: u32, work: impl FnOnce() -> T + Send) -> T {
        thread::scope(|scope| {
            let worker = scope.spawn(|| {
                let mut mxcsr = 0_u32;
                // SAFETY: the register is written to memory of our own.
                unsafe { asm!("stmxcsr [{}]", in(reg) &raw mut mxcsr, options(nostack)) };
                mxcsr |= bits;
                // SAFETY: bits of the rounding mode, or of subnormal numbers, are valid; the thread ends with them.
                unsafe { asm!("ldmxcsr [{}]", in(reg) &raw const mxcsr, options(nostack)) };
                work()
            });
            worker.join().expect("no panic")
        })
    }

    #[test]
    fn each_unusual_environment_is_found() {
        assert_eq!(with(0, check), Ok(()));
        for mode in 1..=3 {
            assert_eq!(with(mode << ROUND, check), Err(Unusual::Rounding), "{mode}");
        }
        assert_eq!(with(FLUSH_TO_ZERO, check), Err(Unusual::NoSubnormals));
        assert_eq!(with(DENORMALS_ARE_ZERO, check), Err(Unusual::NoSubnormals));
    }

    /// A mirroring sphere in the dark, whose highlight fades to nothing: why subnormal numbers matter to an image.
    #[test]
    fn subnormal_numbers_are_part_of_the_image() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("dark.nff");
        let view = "b 0 0 0\nv\nfrom 0 0 5\nat 0 0 0\nup 0 1 0\nangle 45\nhither 1\nresolution 64 64\n";
        std::fs::write(&path, format!("{view}l 1 1 5\nf 1 1 1 0 1 200 0 0\ns 0 0 0 1\n")).expect("writable folder");
        let source: SceneSource = path.to_str().expect("UTF-8").parse().expect("a file's name");
        let image = |_: &_| Ok(ImageSettings::new(64, 64, 4, 0.0).expect("possible"));
        let prepared = preparation::prepare(&source, Octree::DEFAULT, &Fallback::default(), image).expect("small");
        let bvh = Bvh8::build(&prepared.database);
        for kernel in [Kernel::Single { mailbox: true }, Kernel::Packets(&bvh, Simd::best())] {
            let usual = with(0, || render(&prepared, kernel));
            assert_ne!(usual, with(FLUSH_TO_ZERO, || render(&prepared, kernel)), "{kernel:?}");
            assert_eq!(usual, with(0, || render(&prepared, kernel)), "{kernel:?}");
        }
    }

    fn render(prepared: &Prepared, kernel: Kernel<'_>) -> String {
        let settings = Settings { threads: 1, aov: Default::default(), kernel };
        let rendered = render::render(&prepared.database, &prepared.view, settings, |_| {});
        FrameBuffer::sha256(&rendered.expect("a small image").frame)
    }
}
