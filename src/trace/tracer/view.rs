//! What is seen, in world coordinates: everything besides the database that decides the image.

use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

use crate::database::Header;
use crate::picture::{ImageSettings, Terminator};
use crate::scene::{Camera, Light};

/// A camera, the lights, the background and the image settings: what is rendered of a database.
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
    /// Rays to lights leave from smooth triangles as if these were round.
    pub is_terminator_soft: bool,
    /// Rays to lights go on behind what lets them pass.
    pub has_sheets: bool,
}

impl Illumination {
    pub fn new(view: &View, header: &Header) -> Self {
        let light = |light: &Light| (header.normalisation.point(light.position), light.colour.as_vec3());
        Self {
            lights: view.lights.iter().map(light).collect(),
            background: view.background.as_vec3(),
            depth: view.image.depth(),
            cutoff: view.image.cutoff(),
            is_terminator_soft: view.image.terminator() == Terminator::Soft,
            has_sheets: header.has_sheets,
        }
    }
}
