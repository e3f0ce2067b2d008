//! Counts by pixel as a picture, above a colour bar with numbers.

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

/// Writes a PNG of the counts, row by row, `width` to a row. Below them is a colour bar: the picture is higher by [`BAR_HEIGHT`],
/// and wider where the bar's numbers need more room.
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
    let bar = ColourBar::new(range, scale, width as usize);
    let mut codes: Vec<[u8; 3]> = Vec::with_capacity(bar.width * (height + BAR_HEIGHT));
    for row in counts.chunks(width as usize) {
        codes.extend(row.iter().map(|&count| colour(range.share(count, scale))));
        codes.resize(codes.len() + bar.width - row.len(), PAPER);
    }
    codes.extend(bar.pixels());
    PngEncoder::new_with_quality(out, CompressionType::Fast, FilterType::Adaptive)
        .write_image(codes.as_flattened(), bar.width as u32, (height + BAR_HEIGHT) as u32, ExtendedColorType::Rgb8)
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

    /// The count that has the middle colour.
    fn middle(self, scale: Scale) -> u64 {
        let (min, max) = (self.min as f64, self.max as f64);
        match scale {
            Scale::Linear => f64::midpoint(min, max).round() as u64,
            Scale::Logarithmic => libm::expm1(f64::midpoint(libm::log1p(min), libm::log1p(max))).round() as u64,
        }
    }
}

/// Rows of the colour bar: a margin, the colours, a margin, the digits, a margin.
pub const BAR_HEIGHT: usize = MARGIN + COLOURS_HEIGHT + MARGIN + GLYPH_HEIGHT + MARGIN;
const MARGIN: usize = 3;
const COLOURS_HEIGHT: usize = 8;
const GLYPH_HEIGHT: usize = 7;
const GLYPH_WIDTH: usize = 5;
/// From a digit to the next.
const ADVANCE: usize = GLYPH_WIDTH + 1;
const PAPER: [u8; 3] = [255; 3];
const INK: [u8; 3] = [0; 3];

/// The digits, 5 by 7 pixels: a row per byte, the leftmost pixel in bit 4.
const DIGITS: [[u8; GLYPH_HEIGHT]; 10] = [
    [0x0e, 0x11, 0x13, 0x15, 0x19, 0x11, 0x0e],
    [0x04, 0x0c, 0x04, 0x04, 0x04, 0x04, 0x0e],
    [0x0e, 0x11, 0x01, 0x02, 0x04, 0x08, 0x1f],
    [0x1f, 0x02, 0x04, 0x02, 0x01, 0x11, 0x0e],
    [0x02, 0x06, 0x0a, 0x12, 0x1f, 0x02, 0x02],
    [0x1f, 0x10, 0x1e, 0x01, 0x01, 0x11, 0x0e],
    [0x06, 0x08, 0x10, 0x1e, 0x11, 0x11, 0x0e],
    [0x1f, 0x01, 0x02, 0x04, 0x08, 0x08, 0x08],
    [0x0e, 0x11, 0x11, 0x0e, 0x11, 0x11, 0x0e],
    [0x0e, 0x11, 0x11, 0x0f, 0x01, 0x02, 0x0c],
];

/// All colours from left to right, and the counts of the first, the middle and the last one.
struct ColourBar {
    width: usize,
    /// Each with its first pixel.
    labels: Vec<(usize, String)>,
}

impl ColourBar {
    fn new(range: Range, scale: Scale, width: usize) -> Self {
        let extent = |label: &str| label.len() * ADVANCE - 1;
        let [first, middle, last] = [range.min, range.middle(scale), range.max].map(|count| count.to_string());
        let width = width.max(extent(&first) + 2 * ADVANCE + extent(&last));
        let centre = (width - extent(&middle).min(width)) / 2;
        let right = width - extent(&last);
        let has_room = centre > extent(&first) + ADVANCE && centre + extent(&middle) + ADVANCE < right;
        let mut labels = vec![(0, first), (right, last)];
        if has_room {
            labels.push((centre, middle));
        }
        Self { width, labels }
    }

    fn pixels(&self) -> Vec<[u8; 3]> {
        let mut pixels = vec![PAPER; self.width * BAR_HEIGHT];
        let last = (self.width - 1) as f64;
        for row in MARGIN..MARGIN + COLOURS_HEIGHT {
            for x in 0..self.width {
                pixels[row * self.width + x] = colour(x as f64 / last);
            }
        }
        let top = MARGIN + COLOURS_HEIGHT + MARGIN;
        for (left, label) in &self.labels {
            for (place, digit) in label.bytes().enumerate() {
                for (row, bits) in DIGITS[usize::from(digit - b'0')].iter().enumerate() {
                    for x in (0..GLYPH_WIDTH).filter(|x| bits >> (GLYPH_WIDTH - 1 - x) & 1 == 1) {
                        pixels[(top + row) * self.width + left + place * ADVANCE + x] = INK;
                    }
                }
            }
        }
        pixels
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
        let height = counts.len() as u32 / width;
        assert_eq!(image.height(), height + BAR_HEIGHT as u32);
        let counted = image.enumerate_pixels().filter(|&(x, y, _)| x < width && y < height);
        (range, counted.map(|(_, _, pixel)| pixel.0).collect())
    }

    #[test]
    fn the_bar_has_all_colours_and_the_numbers_of_the_first_the_middle_and_the_last() {
        let bar = ColourBar::new(Range { min: 0, max: 255 }, Scale::Logarithmic, 100);
        assert_eq!(bar.labels, [(0, "0".to_owned()), (83, "255".to_owned()), (44, "15".to_owned())]);
        let pixels = bar.pixels();
        assert_eq!((pixels[MARGIN * 100], pixels[MARGIN * 100 + 99]), (INFERNO[0], INFERNO[8]));
        let top = MARGIN + COLOURS_HEIGHT + MARGIN;
        let ink = |row: usize| (83..88).map(|x| u8::from(pixels[(top + row) * 100 + x] == INK)).collect::<Vec<_>>();
        assert_eq!([ink(0), ink(5)], [[0, 1, 1, 1, 0], [0, 1, 0, 0, 0]], "the first digit is a 2");
        let narrow = ColourBar::new(Range { min: 10, max: 18 }, Scale::Linear, 3);
        assert_eq!((narrow.width, narrow.labels.len()), (34, 2), "wide enough for both numbers");
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
