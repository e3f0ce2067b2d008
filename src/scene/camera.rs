//! A pinhole camera in world coordinates.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Invariants (checked by whoever makes one): `at` differs from `from`, `up` is not along the view
/// direction, `0 < angle_degrees < 180`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    pub from: DVec3,
    pub at: DVec3,
    /// Need not be perpendicular to the view direction.
    pub up: DVec3,
    /// Full vertical field of view.
    pub angle_degrees: f64,
    /// Pixels, width and height, where the file names them: the image's default size.
    pub resolution: Option<(u32, u32)>,
}
