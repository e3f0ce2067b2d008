//! Primary rays: from the eye through the centres of pixels, in f64.

use glam::DVec3;

use super::view::View;
use crate::database::{Header, Normalisation};

/// A pinhole camera: `d + (2(x+½)/W − 1)·tan(angle/2)·W/H·r + (1 − 2(y+½)/H)·tan(angle/2)·u`, row 0 on top.
pub struct PrimaryRays {
    /// Normalised coordinates.
    pub eye: DVec3,
    forward: DVec3,
    /// Half the width and height of the image plane at distance 1, as vectors.
    right: DVec3,
    up: DVec3,
    width: f64,
    height: f64,
    normalisation: Normalisation,
}

impl PrimaryRays {
    pub fn new(header: &Header, view: &View) -> Self {
        let camera = &view.camera;
        let forward = (camera.at - camera.from).normalize();
        let right = forward.cross(camera.up).normalize();
        let (width, height) = (f64::from(view.image.width), f64::from(view.image.height));
        let half_height = libm::tan(camera.angle_degrees.to_radians() / 2.0);
        Self {
            eye: header.normalisation.point(camera.from),
            forward,
            right: right * (half_height * width / height),
            up: right.cross(forward) * half_height,
            width,
            height,
            normalisation: header.normalisation,
        }
    }

    /// Unit direction through the centre of a pixel.
    pub fn direction(&self, x: u32, y: u32) -> DVec3 {
        let across = 2.0 * (f64::from(x) + 0.5) / self.width - 1.0;
        let upward = 1.0 - 2.0 * (f64::from(y) + 0.5) / self.height;
        (self.forward + self.right * across + self.up * upward).normalize()
    }

    pub fn world_length(&self, normalised: f64) -> f64 {
        self.normalisation.world_length(normalised)
    }
}
