//! What is seen, in world coordinates: everything besides the database that decides the image.

use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

use crate::database::Normalisation;
use crate::scene::{Camera, Light};

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct View {
    pub camera: Camera,
    pub lights: Vec<Light>,
    /// Linear RGB.
    pub background: DVec3,
    pub image: ImageSettings,
}

impl View {
    /// Positions as the tracer has them, and linear RGB.
    pub fn normalised_lights(&self, normalisation: &Normalisation) -> Vec<(DVec3, Vec3)> {
        self.lights.iter().map(|light| (normalisation.point(light.position), light.colour.as_vec3())).collect()
    }
}

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
