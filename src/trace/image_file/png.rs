//! PNG, 8 bits a channel, sRGB.

use std::io::{self, Write};

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

use super::FrameBuffer;

/// Writes the colours, clamped to 0..1.
pub(super) fn write(out: &mut impl Write, frame: &FrameBuffer) -> io::Result<()> {
    let transfer = SrgbTransfer::new();
    let colours = frame.pixels().colour.as_flattened();
    let codes: Vec<u8> = colours.iter().map(|&linear| transfer.code(linear)).collect();
    PngEncoder::new_with_quality(out, CompressionType::Fast, FilterType::Adaptive)
        .write_image(&codes, frame.width(), frame.height(), ExtendedColorType::Rgb8)
        .map_err(io::Error::other)
}

/// Linear to the nearest of the 256 sRGB codes (IEC 61966-2-1) by comparison with the exact borders between
/// them: one table look-up and one comparison instead of a power a channel.
struct SrgbTransfer {
    /// The smallest linear value of each code; one more, which is never reached.
    borders: [f32; 257],
    /// For each `1/BUCKETS` of the range, the code of its lower end.
    first: Vec<u8>,
}

impl SrgbTransfer {
    /// More than the transfer's steepest slope in codes (12.92 · 255), so that a bucket holds one border at most.
    const BUCKETS: usize = 4096;

    fn new() -> Self {
        let mut borders = [0.0; 257];
        for (code, border) in borders.iter_mut().enumerate().skip(1) {
            *border = linear((code as f64 - 0.5) / 255.0) as f32;
        }
        borders[256] = f32::INFINITY;
        let lower_ends = (0..=Self::BUCKETS).map(|bucket| bucket as f32 / Self::BUCKETS as f32);
        let first = lower_ends.map(|lower| (borders.partition_point(|&border| border <= lower) - 1) as u8).collect();
        Self { borders, first }
    }

    fn code(&self, linear: f32) -> u8 {
        let linear = linear.clamp(0.0, 1.0);
        // What is not a number is cast to bucket 0 and reaches no border.
        let code = self.first[(linear * Self::BUCKETS as f32) as usize];
        code + u8::from(linear >= self.borders[usize::from(code) + 1])
    }
}

/// The inverse transfer function: encoded 0..1 to linear.
fn linear(encoded: f64) -> f64 {
    if encoded <= 0.04045 { encoded / 12.92 } else { libm::pow((encoded + 0.055) / 1.055, 2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::{AovSet, Pixels, Rect};

    /// The transfer function as the standard writes it.
    fn encoded(linear: f64) -> f64 {
        if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * libm::pow(linear, 1.0 / 2.4) - 0.055 }
    }

    #[test]
    fn codes_are_the_nearest_to_the_standards_curve() {
        let transfer = SrgbTransfer::new();
        let mut off_by_rounding = 0;
        for i in 0..=1_000_000u32 {
            let linear = i as f32 / 1_000_000.0;
            let exact = 255.0 * encoded(f64::from(linear));
            let code = f64::from(transfer.code(linear));
            // The standard's two branches meet within 1e-6 of each other only.
            assert!((code - exact).abs() <= 0.5 + 1e-4, "{linear}: {code} for {exact}");
            off_by_rounding += u32::from((code - exact).abs() > 0.5);
        }
        assert!(off_by_rounding < 10, "{off_by_rounding}");
    }

    #[test]
    fn what_is_no_colour_is_clamped() {
        let transfer = SrgbTransfer::new();
        let codes = [f32::NAN, f32::NEG_INFINITY, -1.0, -0.0, 1.0, 7.5, f32::INFINITY].map(|v| transfer.code(v));
        assert_eq!(codes, [0, 0, 0, 0, 255, 255, 255]);
    }

    #[test]
    fn a_png_reads_back_row_by_row() {
        let mut frame = FrameBuffer::new(3, 2, AovSet::default()).expect("a small frame");
        let pixels = Pixels { colour: vec![[1.0, 0.0, 0.214_041_14]], ..Pixels::default() };
        frame.blit(Rect { x: 2, y: 1, width: 1, height: 1 }, &pixels).expect("fits");
        let mut bytes = Vec::new();
        write(&mut bytes, &frame).expect("into memory");
        let read = image::load_from_memory(&bytes).expect("a PNG").to_rgb8();
        assert_eq!(read.dimensions(), (3, 2));
        assert_eq!(read.get_pixel(2, 1).0, [255, 0, 128]);
        assert_eq!(read.get_pixel(0, 0).0, [0, 0, 0]);
    }
}
