//! The image settings.

use serde::{Deserialize, Serialize};

use super::Terminator;

/// The image settings that decide its bits. Proven, from wherever they come: a kernel can trace all that there are.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Written")]
pub struct ImageSettings {
    width: u32,
    height: u32,
    depth: u32,
    cutoff: f32,
    terminator: Terminator,
}

/// [`ImageSettings`] as they are read, not proven yet.
#[derive(Deserialize)]
struct Written {
    width: u32,
    height: u32,
    depth: u32,
    cutoff: f32,
    terminator: Terminator,
}

/// Numbers that are no image settings.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ImageSettingsError {
    #[error("an image of {width}x{height} pixels, expected 1 to {max} a side", max = ImageSettings::SIDE_MAX)]
    Side { width: u32, height: u32 },
    #[error("a depth of {0}, expected 0 to {max}", max = ImageSettings::DEPTH_MAX)]
    Depth(u32),
    #[error("a cutoff of {0}, expected a number from 0 to 1")]
    Cutoff(f32),
}

impl TryFrom<Written> for ImageSettings {
    type Error = ImageSettingsError;

    fn try_from(written: Written) -> Result<Self, ImageSettingsError> {
        let settings = Self::new(written.width, written.height, written.depth, written.cutoff)?;
        Ok(settings.with_terminator(written.terminator))
    }
}

impl ImageSettings {
    pub const SIDE_MAX: u32 = 65_536;
    pub const DEPTH_MAX: u32 = 64;
    pub const DEPTH_DEFAULT: u32 = 4;

    /// Settings of an image of `width` times `height` pixels, with [`Self::depth`] and [`Self::cutoff`], and a hard terminator.
    ///
    /// # Errors
    /// A side is not 1 to 65,536, the depth is above 64, or the cutoff is not 0 to 1.
    pub const fn new(width: u32, height: u32, depth: u32, cutoff: f32) -> Result<Self, ImageSettingsError> {
        if width == 0 || height == 0 || width > Self::SIDE_MAX || height > Self::SIDE_MAX {
            return Err(ImageSettingsError::Side { width, height });
        }
        if depth > Self::DEPTH_MAX {
            return Err(ImageSettingsError::Depth(depth));
        }
        // False for what is not a number.
        if !(cutoff >= 0.0 && cutoff <= 1.0) {
            return Err(ImageSettingsError::Cutoff(cutoff));
        }
        Ok(Self { width, height, depth, cutoff, terminator: Terminator::Hard })
    }

    #[must_use]
    pub const fn with_terminator(self, terminator: Terminator) -> Self {
        Self { terminator, ..self }
    }

    /// Pixels, 1 to 65,536.
    pub const fn width(&self) -> u32 {
        self.width
    }

    /// Pixels, 1 to 65,536.
    pub const fn height(&self) -> u32 {
        self.height
    }

    /// How many reflections or refractions a ray's ancestry may hold, 0 to 64.
    pub const fn depth(&self) -> u32 {
        self.depth
    }

    /// A secondary ray is cast when its weight in the pixel, in the strongest channel, exceeds this; 0 to 1.
    pub const fn cutoff(&self) -> f32 {
        self.cutoff
    }

    /// Where smooth surfaces turn away from a light.
    pub const fn terminator(&self) -> Terminator {
        self.terminator
    }
}

#[cfg(test)]
mod tests {
    use bincode::config::standard;
    use bincode::serde::{decode_from_slice, encode_to_vec};

    use super::*;

    #[test]
    fn what_cannot_be_settings_is_refused_by_number_and_from_the_wire() {
        for ((width, height, depth, cutoff), expected) in [
            ((0, 1, 0, 0.0), "an image of 0x1 pixels, expected 1 to 65536 a side"),
            ((8, 65_537, 0, 0.0), "an image of 8x65537 pixels, expected 1 to 65536 a side"),
            ((8, 8, 65, 0.0), "a depth of 65, expected 0 to 64"),
            ((8, 8, 4, -0.5), "a cutoff of -0.5, expected a number from 0 to 1"),
            ((8, 8, 4, f32::NAN), "a cutoff of NaN, expected a number from 0 to 1"),
            ((8, 8, 4, f32::INFINITY), "a cutoff of inf, expected a number from 0 to 1"),
        ] {
            let error = ImageSettings::new(width, height, depth, cutoff).expect_err(expected);
            assert_eq!(error.to_string(), expected);
            let wire = encode_to_vec((width, height, depth, cutoff, Terminator::Hard), standard()).expect("numbers");
            let error = decode_from_slice::<ImageSettings, _>(&wire, standard()).expect_err(expected).to_string();
            assert!(error.contains(expected), "{error}");
        }
    }

    #[test]
    fn settings_are_written_as_their_numbers_and_read_back() {
        let hard = ImageSettings::new(65_536, 1, 64, 1.0).expect("the most");
        for (settings, variant) in [(hard, 0u32), (hard.with_terminator(Terminator::Soft), 1)] {
            let wire = encode_to_vec(settings, standard()).expect("numbers");
            assert_eq!(wire, encode_to_vec((65_536u32, 1u32, 64u32, 1.0f32, variant), standard()).expect("numbers"));
            assert_eq!(decode_from_slice(&wire, standard()).expect("its own"), (settings, wire.len()));
        }
    }
}
