//! A pinhole camera in world coordinates.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::{Light, UpAxis};

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

impl Camera {
    /// Towards the eye, in [`Self::framing`] of a scene whose y is up: in front of it, to the right and above.
    const FRAMING_SIDE: DVec3 = DVec3::new(0.5, 0.4, 1.0);
    pub const FRAMING_ANGLE_DEGREES: f64 = 45.0;
    /// Room around the model, as a factor of the smallest distance that shows all of it.
    const FRAMING_ROOM: f64 = 1.05;

    /// Whether the invariants hold.
    ///
    /// # Errors
    /// What does not, and what was expected.
    pub fn check(&self) -> Result<(), String> {
        if !(self.angle_degrees > 0.0 && self.angle_degrees < 180.0) {
            return Err(format!("the angle is {}, expected it between 0 and 180 degrees", self.angle_degrees));
        }
        let Some(direction) = (self.at - self.from).try_normalize() else {
            return Err("from and at are the same point, expected two".into());
        };
        // The sine of the angle between the two: below this, rounding decides where up is.
        const SINE_MIN: f64 = 1e-9;
        match self.up.try_normalize() {
            None => Err("up has no direction, expected a vector longer than 0".into()),
            Some(up) if direction.cross(up).length() < SINE_MIN => {
                Err("up is along the view direction, expected it to point aside".into())
            }
            Some(_) => Ok(()),
        }
    }

    /// For a scene without a camera: a view that shows everything within the bounds on an image whose width is `aspect`
    /// times its height, from as near as that is possible with this angle.
    pub fn framing(bounds: Option<(DVec3, DVec3)>, axis: UpAxis, aspect: f64, angle_degrees: f64) -> Self {
        let (low, high) = bounds.unwrap_or((DVec3::NEG_ONE, DVec3::ONE));
        let centre = low * 0.5 + high * 0.5;
        let half = high * 0.5 - low * 0.5;
        let vertical = axis.turn(DVec3::Y);
        let back = axis.turn(Self::FRAMING_SIDE).normalize();
        let right = vertical.cross(back).normalize();
        let up = back.cross(right);
        let slope = libm::tan(angle_degrees.to_radians() / 2.0);
        // A corner is seen when it lies no farther above than slope times its depth, and no farther aside than aspect times that.
        let distance = (0..8)
            .map(|corner| {
                let sign = |axis: u32| if corner & (1 << axis) == 0 { -1.0 } else { 1.0 };
                let corner = half * DVec3::new(sign(0), sign(1), sign(2));
                (corner.dot(right).abs() / aspect).max(corner.dot(up).abs()) / slope + corner.dot(back)
            })
            .fold(0.0, f64::max);
        // A single point is seen from any distance.
        let distance = if distance > 0.0 { distance * Self::FRAMING_ROOM } else { 1.0f64.max(centre.length()) };
        Self { from: centre + back * distance, at: centre, up: vertical, angle_degrees, resolution: None }
    }

    /// For a scene without lights: a key light above the viewer's left shoulder, and a weaker one at the
    /// right that fills the shadows.
    pub fn framing_lights(&self) -> [Light; 2] {
        let back = self.from - self.at;
        let distance = back.length();
        let right = self.up.cross(back).normalize_or(DVec3::X);
        let up = back.cross(right).normalize_or(DVec3::Y);
        let light = |aside: DVec3, brightness| Light {
            position: self.from + aside * distance,
            colour: DVec3::splat(brightness),
        };
        [light((up - right) * 0.5, 0.8), light(right * 0.75, 0.3)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(from: DVec3, at: DVec3, up: DVec3, angle_degrees: f64) -> Result<(), String> {
        Camera { from, at, up, angle_degrees, resolution: None }.check()
    }

    #[test]
    fn impossible_cameras_are_told() {
        let (zero, y, z) = (DVec3::ZERO, DVec3::Y, DVec3::Z);
        assert_eq!(check(z, zero, y, 45.0), Ok(()));
        assert_eq!(check(z, zero, z + y * 1e-6, 45.0), Ok(()), "up need not be perpendicular");
        assert!(check(z, z, y, 45.0).is_err_and(|e| e.contains("same point")));
        assert!(check(z, zero, z * -3.0, 45.0).is_err_and(|e| e.contains("along")));
        assert!(check(z, zero, zero, 45.0).is_err_and(|e| e.contains("no direction")));
        for angle in [0.0, 180.0, -1.0, f64::NAN] {
            assert!(check(z, zero, y, angle).is_err_and(|e| e.contains("between 0 and 180")));
        }
    }

    /// How far the outermost corner is from the middle of the image, as a share of its half width and half height.
    fn outermost(camera: &Camera, (low, high): (DVec3, DVec3), aspect: f64) -> f64 {
        let forward = (camera.at - camera.from).normalize();
        let right = forward.cross(camera.up).normalize();
        let up = right.cross(forward);
        let slope = (camera.angle_degrees.to_radians() / 2.0).tan();
        (0..8)
            .map(|i| {
                let pick = |axis: usize| if i >> axis & 1 == 0 { low[axis] } else { high[axis] };
                let corner = DVec3::new(pick(0), pick(1), pick(2)) - camera.from;
                let depth = corner.dot(forward);
                assert!(depth > 0.0, "a corner behind the eye");
                (corner.dot(right).abs() / aspect).max(corner.dot(up).abs()) / depth / slope
            })
            .fold(0.0, f64::max)
    }

    #[test]
    fn framing_shows_every_corner_and_is_tight() {
        for bounds in [
            (DVec3::new(-1.0, -2.0, -3.0), DVec3::new(4.0, 5.0, 6.0)),
            (DVec3::new(1e6, 1e6, 1e6), DVec3::new(1e6 + 1.0, 1e6 + 1e-3, 1e6 + 2.0)),
            (DVec3::new(0.0, 0.0, 0.0), DVec3::new(1e9, 0.0, 0.0)),
        ] {
            for (axis, aspect) in
                UpAxis::ALL.into_iter().flat_map(|axis| [1.0, 0.5, 0.01, 2.5].map(|aspect| (axis, aspect)))
            {
                for angle in [45.0, 5.0, 120.0] {
                    let camera = Camera::framing(Some(bounds), axis, aspect, angle);
                    camera.check().expect("a possible camera");
                    let outermost = outermost(&camera, bounds, aspect);
                    // The room around it is a share of the distance, which counts for more where the angle is wide.
                    let least = if angle > 90.0 { 0.5 } else { 0.8 };
                    assert!(
                        (least..1.0).contains(&outermost),
                        "{axis:?}, {aspect}, {angle}: {outermost} of the half image"
                    );
                }
            }
        }
    }

    #[test]
    fn framing_turns_with_the_vertical_axis() {
        let (low, high) = (DVec3::new(-1.0, -2.0, -3.0), DVec3::new(4.0, 5.0, 6.0));
        let y = Camera::framing(Some((low, high)), UpAxis::Y, 1.0, 45.0);
        // The same scene with z up: y becomes z, and z becomes -y.
        let turned = (DVec3::new(-1.0, -6.0, -2.0), DVec3::new(4.0, 3.0, 5.0));
        let z = Camera::framing(Some(turned), UpAxis::Z, 1.0, 45.0);
        assert_eq!((z.at, z.up), (UpAxis::Z.turn(y.at), DVec3::Z));
        assert!(z.from.distance(UpAxis::Z.turn(y.from)) < 1e-12 * z.from.length());
    }

    #[test]
    fn framing_of_nothing_or_a_point_is_a_possible_camera() {
        for bounds in [None, Some((DVec3::splat(7.0), DVec3::splat(7.0)))] {
            let camera = Camera::framing(bounds, UpAxis::Y, 1.0, 45.0);
            assert_eq!(camera.check(), Ok(()));
            assert!(camera.framing_lights().iter().all(|l| l.position.is_finite() && l.colour.min_element() > 0.0));
        }
    }

    #[test]
    fn framing_lights_stand_on_the_viewers_side() {
        let camera = Camera::framing(Some((DVec3::NEG_ONE, DVec3::ONE)), UpAxis::Y, 1.0, 45.0);
        for light in camera.framing_lights() {
            assert!((light.position - camera.at).dot(camera.from - camera.at) > 0.0);
        }
    }
}
