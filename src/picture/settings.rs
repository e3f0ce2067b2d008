//! The image settings.

use serde::{Deserialize, Serialize};

/// The image settings that decide its bits.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImageSettings {
    /// Pixels, 1 to 65,536 each.
    pub width: u32,
    pub height: u32,
    /// How many reflections or refractions a ray's ancestry may hold, 0 to 64.
    pub depth: u32,
    /// A secondary ray is cast when its weight in the pixel, in the strongest channel, exceeds this.
    pub cutoff: f32,
}

impl ImageSettings {
    pub const SIDE_MAX: u32 = 65_536;
    pub const DEPTH_MAX: u32 = 64;
    pub const DEPTH_DEFAULT: u32 = 4;
}
