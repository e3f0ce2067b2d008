//! Two pictures, pixel by pixel, in the codes of their PNG files.

use std::io::{self, BufReader};
use std::path::Path;

use image::codecs::png::{CompressionType, FilterType, PngDecoder, PngEncoder};
use image::{DynamicImage, ExtendedColorType, ImageDecoder, ImageEncoder, Limits};
use serde::Serialize;

use ground::{atomic_file, regular_file};

/// What decoding may allocate: a picture of 65,536 × 65,536 pixels would need more, and is refused.
const DECODED_BYTES_MAX: u64 = 8 << 30;
const CHANNELS: usize = 3;

/// A picture, 8 bits per channel, row by row from the top left.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Picture {
    width: u32,
    height: u32,
    codes: Vec<u8>,
}

impl Picture {
    /// Reads a PNG file. What has an alpha channel or more bits is converted to RGB of 8 bits.
    ///
    /// # Errors
    /// The file cannot be read, is no regular file or no PNG, or is too large; the error names it.
    pub fn read(path: &Path) -> io::Result<Self> {
        let read = || {
            let mut limits = Limits::default();
            limits.max_alloc = Some(DECODED_BYTES_MAX);
            let file = BufReader::new(regular_file::open(path)?);
            let mut decoder = PngDecoder::with_limits(file, limits.clone()).map_err(io::Error::other)?;
            decoder.set_limits(limits).map_err(io::Error::other)?;
            let picture = DynamicImage::from_decoder(decoder).map_err(io::Error::other)?.into_rgb8();
            Ok(Self { width: picture.width(), height: picture.height(), codes: picture.into_raw() })
        };
        read().map_err(|error: io::Error| io::Error::new(error.kind(), format!("{}: {error}", path.display())))
    }

    fn pixels(&self) -> impl Iterator<Item = &[u8]> {
        self.codes.chunks_exact(CHANNELS)
    }
}

/// By how much one picture differs from another of its size.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub struct Comparison {
    pub width: u32,
    pub height: u32,
    /// Pixels of which at least one channel differs.
    pub differing_pixels: u64,
    /// Root of the mean squared difference of a channel, in codes from 0 to 255.
    pub rmse: f64,
    /// `20 log10(255 / rmse)`; `None`: no channel differs.
    pub psnr_decibels: Option<f64>,
    /// The largest difference of a channel, in codes; the first pixel in reading order that has it, if any differs.
    pub largest_error: u8,
    pub largest_at: Option<[u32; 2]>,
}

impl Comparison {
    /// # Errors
    /// The pictures have different sizes.
    pub fn of(a: &Picture, b: &Picture) -> Result<Self, SizesDiffer> {
        if (a.width, a.height) != (b.width, b.height) {
            return Err(SizesDiffer { a: [a.width, a.height], b: [b.width, b.height] });
        }
        let (mut differing_pixels, mut squares, mut largest_error, mut largest_pixel) = (0, 0u64, 0, None);
        for (pixel, (a, b)) in (0u64..).zip(a.pixels().zip(b.pixels())) {
            let mut largest = 0;
            for (&a, &b) in a.iter().zip(b) {
                let error = a.abs_diff(b);
                squares += u64::from(error) * u64::from(error);
                largest = largest.max(error);
            }
            differing_pixels += u64::from(largest > 0);
            if largest > largest_error {
                (largest_error, largest_pixel) = (largest, Some(pixel));
            }
        }
        let width = u64::from(a.width);
        let rmse = (squares as f64 / a.codes.len().max(1) as f64).sqrt();
        Ok(Self {
            width: a.width,
            height: a.height,
            differing_pixels,
            rmse,
            psnr_decibels: (squares > 0).then(|| 20.0 * libm::log10(255.0 / rmse)),
            largest_error,
            // Both are below 2³².
            largest_at: largest_pixel.map(|pixel| [(pixel % width) as u32, (pixel / width) as u32]),
        })
    }

    pub fn is_same(&self) -> bool {
        self.differing_pixels == 0
    }

    /// Writes the differences of two pictures as a PNG file: black where they are the same, the largest difference as 255.
    ///
    /// # Errors
    /// The file cannot be written; the error names it.
    pub fn write_differences(&self, a: &Picture, b: &Picture, path: &Path) -> io::Result<()> {
        let largest = u32::from(self.largest_error.max(1));
        let brightness = |(&a, &b): (&u8, &u8)| (u32::from(a.abs_diff(b)) * 255 / largest) as u8;
        let codes: Vec<u8> = a.codes.iter().zip(&b.codes).map(brightness).collect();
        atomic_file::write(path, |file| {
            PngEncoder::new_with_quality(file, CompressionType::Fast, FilterType::Adaptive)
                .write_image(&codes, self.width, self.height, ExtendedColorType::Rgb8)
                .map_err(io::Error::other)
        })
    }
}

#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
#[error("{}x{} and {}x{} pixels, expected pictures of the same size", a[0], a[1], b[0], b[1])]
pub struct SizesDiffer {
    pub a: [u32; 2],
    pub b: [u32; 2],
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(width: u32, codes: &[u8]) -> Picture {
        Picture { width, height: codes.len() as u32 / 3 / width, codes: codes.to_vec() }
    }

    #[test]
    fn a_comparison_is_as_worked_out_by_hand() {
        let a = picture(2, &[0, 0, 0, 10, 20, 30, 255, 255, 255, 1, 2, 3]);
        let b = picture(2, &[0, 0, 0, 10, 24, 30, 252, 255, 255, 1, 2, 3]);
        let found = Comparison::of(&a, &b).expect("one size");
        // (16 + 9) / 12 channels.
        assert!((found.rmse - (25.0f64 / 12.0).sqrt()).abs() < 1e-15);
        // 10 log10(255² · 12 / 25) = 10 log10(31,212).
        assert!((found.psnr_decibels.expect("they differ") - 44.943_215_98).abs() < 1e-6, "{found:?}");
        assert_eq!((found.differing_pixels, found.largest_error, found.largest_at), (2, 4, Some([1, 0])));
        let same = Comparison::of(&a, &a).expect("one size");
        assert_eq!((same.is_same(), same.rmse, same.psnr_decibels, same.largest_at), (true, 0.0, None, None));
        assert!(Comparison::of(&a, &picture(1, &[0; 12])).is_err());
    }

    #[test]
    fn differences_are_written_and_read_back() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("d.png");
        let (a, b) = (picture(1, &[0, 0, 0, 9, 8, 7]), picture(1, &[0, 0, 2, 13, 8, 7]));
        Comparison::of(&a, &b).expect("one size").write_differences(&a, &b, &path).expect("writable");
        assert_eq!(Picture::read(&path).expect("a picture"), picture(1, &[0, 0, 127, 255, 0, 0]));
        std::fs::write(&path, "no picture").expect("writable");
        assert!(Picture::read(&path).expect_err("no PNG").to_string().contains("d.png: "));
    }
}
