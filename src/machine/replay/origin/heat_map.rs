//! Counts by pixel as a picture.

use std::io::{self, Write};

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

/// How counts become colours, from the smallest to the largest.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub enum Scale {
    #[default]
    Linear,
    /// By the logarithm of the count plus one: small differences show beside large counts.
    Logarithmic,
}

/// The counts that have the first colour and the last.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Range {
    pub min: u64,
    pub max: u64,
}

/// Writes a PNG of the counts, row by row, `width` to a row.
///
/// # Errors
/// The counts are not whole rows, or `out` fails.
pub fn write(out: &mut impl Write, counts: &[u64], width: u32, scale: Scale) -> io::Result<Range> {
    let height = counts.len().checked_div(width as usize).unwrap_or(0);
    if height == 0 || height * width as usize != counts.len() {
        return Err(io::Error::other(format!("{} pixels, expected rows of {width}", counts.len())));
    }
    let range =
        Range { min: counts.iter().copied().min().unwrap_or(0), max: counts.iter().copied().max().unwrap_or(0) };
    let codes: Vec<u8> = counts.iter().flat_map(|&count| colour(range.share(count, scale))).collect();
    PngEncoder::new_with_quality(out, CompressionType::Fast, FilterType::Adaptive)
        .write_image(&codes, width, height as u32, ExtendedColorType::Rgb8)
        .map_err(io::Error::other)?;
    Ok(range)
}

impl Range {
    /// A count's place in the range, 0 to 1; 0 where all counts are the same.
    fn share(self, count: u64, scale: Scale) -> f64 {
        let value = |count: u64| match scale {
            Scale::Linear => count as f64,
            Scale::Logarithmic => libm::log1p(count as f64),
        };
        let extent = value(self.max) - value(self.min);
        if extent > 0.0 { (value(count) - value(self.min)) / extent } else { 0.0 }
    }
}

/// Stops of matplotlib's colour map `inferno` (van der Walt and Smith, public domain), equally far apart, in sRGB. From
/// one end to the other it is ever lighter, evenly to the eye, and in print without colours too.
const INFERNO: [[u8; 3]; 9] = [
    [0, 0, 4],
    [31, 12, 72],
    [85, 15, 109],
    [136, 34, 106],
    [186, 54, 85],
    [227, 89, 51],
    [249, 140, 10],
    [249, 201, 50],
    [252, 255, 164],
];

fn colour(share: f64) -> [u8; 3] {
    let place = share.clamp(0.0, 1.0) * (INFERNO.len() - 1) as f64;
    let stop = (place as usize).min(INFERNO.len() - 2);
    let part = place - stop as f64;
    let (from, to) = (INFERNO[stop], INFERNO[stop + 1]);
    std::array::from_fn(|channel| {
        let (from, to) = (f64::from(from[channel]), f64::from(to[channel]));
        (from + (to - from) * part).round() as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(counts: &[u64], width: u32, scale: Scale) -> (Range, Vec<[u8; 3]>) {
        let mut bytes = Vec::new();
        let range = write(&mut bytes, counts, width, scale).expect("into memory");
        let image = image::load_from_memory(&bytes).expect("a PNG").to_rgb8();
        assert_eq!(image.dimensions(), (width, counts.len() as u32 / width));
        (range, image.pixels().map(|pixel| pixel.0).collect())
    }

    #[test]
    fn the_ends_of_the_range_have_the_first_and_the_last_colour() {
        let (range, colours) = picture(&[10, 18, 14, 11, 10, 10], 3, Scale::Linear);
        assert_eq!(range, Range { min: 10, max: 18 });
        // Eight counts for eight steps between the stops.
        assert_eq!(colours, [0, 8, 4, 1, 0, 0].map(|stop| INFERNO[stop]));
        let (range, colours) = picture(&[0, 15, 3, 255], 2, Scale::Logarithmic);
        assert_eq!(range, Range { min: 0, max: 255 });
        assert_eq!(colours, [0, 4, 2, 8].map(|stop| INFERNO[stop]));
        assert_eq!(picture(&[7; 4], 2, Scale::Logarithmic).1, [INFERNO[0]; 4]);
    }

    #[test]
    fn larger_counts_are_lighter() {
        let luminance = |[red, green, blue]: [u8; 3]| {
            0.2126 * f64::from(red) + 0.7152 * f64::from(green) + 0.0722 * f64::from(blue)
        };
        let lightness: Vec<f64> = (0..=64).map(|i| luminance(colour(f64::from(i) / 64.0))).collect();
        assert!(lightness.is_sorted_by(|a, b| a < b), "{lightness:?}");
    }

    #[test]
    fn what_is_no_picture_is_an_error() {
        for (counts, width) in [(&[][..], 0), (&[], 4), (&[1, 2, 3], 2), (&[1], 2)] {
            assert!(write(&mut Vec::new(), counts, width, Scale::Linear).is_err());
        }
    }
}
