//! OpenEXR: the linear f32 RGB as it is.

use std::io;

use super::FrameBuffer;
use ground::atomic_file;

#[cfg(feature = "exr")]
pub(super) fn write(out: &mut atomic_file::Writer, frame: &FrameBuffer) -> io::Result<()> {
    use image::codecs::openexr::OpenExrEncoder;
    use image::{ExtendedColorType, ImageEncoder};

    let bytes = bytemuck::cast_slice(&frame.pixels().colour);
    OpenExrEncoder::new(out)
        .write_image(bytes, frame.width(), frame.height(), ExtendedColorType::Rgb32F)
        .map_err(io::Error::other)
}

#[cfg(not(feature = "exr"))]
pub(super) fn write(_: &mut atomic_file::Writer, _: &FrameBuffer) -> io::Result<()> {
    Err(io::Error::new(io::ErrorKind::Unsupported, "this build writes no EXR: build with --features exr"))
}
