//! What is seen, in world coordinates: everything besides the database that decides the image.

use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

use crate::database::Normalisation;
use crate::picture::ImageSettings;
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
