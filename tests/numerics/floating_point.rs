//! The environment that the bits of an image need, and what another one does to them.

use std::arch::asm;
use std::thread;

use ground::floating_point::{Unusual, check};
use trace::image_file::FrameBuffer;
use trace::picture::ImageSettings;
use trace::preparation::{self, Prepared, ViewChoices};
use trace::render::{self, Kernel, Settings};
use trace::scene::SceneSource;
use trace::tracer::bvh8::Bvh8;
use trace::tracer::octree::Octree;
use trace::tracer::simd::Simd;

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
    let prepared = preparation::prepare(&source, Octree::DEFAULT, &ViewChoices::default(), image).expect("small");
    let bvh = Bvh8::build(&prepared.database);
    for kernel in [Kernel::Single { mailbox: true }, Kernel::Packets(&bvh, Simd::best())] {
        let usual = with(0, || render(&prepared, kernel));
        assert_ne!(usual, with(FLUSH_TO_ZERO, || render(&prepared, kernel)), "{kernel:?}");
        assert_eq!(usual, with(0, || render(&prepared, kernel)), "{kernel:?}");
    }
}

fn render(prepared: &Prepared, kernel: Kernel<'_>) -> String {
    let settings = Settings { threads: 1, aov: Default::default(), kernel };
    let rendered =
        render::render(&prepared.database, &prepared.view, settings, |_| std::ops::ControlFlow::Continue(()));
    FrameBuffer::sha256(&rendered.expect("a small image").frame)
}
