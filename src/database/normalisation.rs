//! From world coordinates to the root cube, in f64.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// `normalised = (world − centre) · scale`. The root cube is `[−1, 1]³`; the scene fits inside it with a
/// margin, so that no surface lies in the root's faces.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
pub struct Normalisation {
    pub centre: DVec3,
    /// Normalised units a world unit, positive.
    pub scale: f64,
}

impl Normalisation {
    /// Share of the root's half extent that the scene fills.
    const FILL: f64 = 1.0 - 1.0 / 4096.0;

    /// For a scene with these bounds; an empty scene or a single point has scale 1.
    pub fn new(bounds: Option<(DVec3, DVec3)>) -> Self {
        let Some((lo, hi)) = bounds else {
            return Self { centre: DVec3::ZERO, scale: 1.0 };
        };
        // Halved first: the sum or difference of two large coordinates may overflow.
        let centre = lo * 0.5 + hi * 0.5;
        let half = (hi * 0.5 - lo * 0.5).max_element();
        let scale = Self::FILL / half;
        Self { centre, scale: if scale.is_finite() && scale > 0.0 { scale } else { 1.0 } }
    }

    pub fn point(&self, world: DVec3) -> DVec3 {
        (world - self.centre) * self.scale
    }

    /// Normalised length of a world length.
    pub fn length(&self, world: f64) -> f64 {
        world * self.scale
    }

    /// World length of a normalised length.
    pub fn world_length(&self, normalised: f64) -> f64 {
        normalised / self.scale
    }
}
