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

/// What shading takes from a view.
#[derive(Clone, Debug)]
pub struct Illumination {
    /// Normalised position, linear RGB.
    pub lights: Vec<(DVec3, Vec3)>,
    pub background: Vec3,
    /// Reflections and refractions in a row.
    pub depth: u32,
    /// Weight in the pixel that a secondary ray must exceed.
    pub cutoff: f32,
}

impl Illumination {
    pub fn new(view: &View, normalisation: &Normalisation) -> Self {
        let light = |light: &Light| (normalisation.point(light.position), light.colour.as_vec3());
        Self {
            lights: view.lights.iter().map(light).collect(),
            background: view.background.as_vec3(),
            depth: view.image.depth(),
            cutoff: view.image.cutoff(),
        }
    }
}
