//! What is chosen of a view.

use glam::DVec3;

use crate::scene::{Camera, Light, UpAxis};

/// What is chosen of a view, by a topology or on the command line. All else is the scene's own or, where it has none, such
/// that all of it is seen.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ViewChoices {
    pub camera: CameraChoices,
    /// Instead of all lights of the scene; empty: no choice.
    pub lights: Vec<Light>,
    /// Linear RGB where a ray hits nothing.
    pub background: Option<DVec3>,
    /// Which axis is up in a scene without a camera; `None`: y.
    pub up: Option<UpAxis>,
}

/// Parts of a camera, each as in [`Camera`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CameraChoices {
    pub from: Option<DVec3>,
    pub at: Option<DVec3>,
    pub up: Option<DVec3>,
    /// Between 0 and 180.
    pub angle_degrees: Option<f64>,
}

/// A part of a camera that can be chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CameraPart {
    From,
    At,
    Up,
    Angle,
}

impl CameraPart {
    pub const ALL: [Self; 4] = [Self::From, Self::At, Self::Up, Self::Angle];

    pub const fn name(self) -> &'static str {
        match self {
            Self::From => "from",
            Self::At => "at",
            Self::Up => "up",
            Self::Angle => "angle",
        }
    }
}

impl ViewChoices {
    /// These, and of `others` what these leave open.
    #[must_use]
    pub fn or(self, others: Self) -> Self {
        Self {
            camera: self.camera.or(others.camera),
            lights: if self.lights.is_empty() { others.lights } else { self.lights },
            background: self.background.or(others.background),
            up: self.up.or(others.up),
        }
    }
}

impl CameraChoices {
    /// These, and of `others` what these leave open.
    #[must_use]
    pub fn or(self, others: Self) -> Self {
        Self {
            from: self.from.or(others.from),
            at: self.at.or(others.at),
            up: self.up.or(others.up),
            angle_degrees: self.angle_degrees.or(others.angle_degrees),
        }
    }

    /// What is chosen.
    pub fn parts(&self) -> Vec<CameraPart> {
        let is_chosen = |part: &CameraPart| match part {
            CameraPart::From => self.from.is_some(),
            CameraPart::At => self.at.is_some(),
            CameraPart::Up => self.up.is_some(),
            CameraPart::Angle => self.angle_degrees.is_some(),
        };
        CameraPart::ALL.into_iter().filter(is_chosen).collect()
    }

    /// A camera with these parts in place of its own.
    pub fn applied_to(&self, camera: &Camera) -> Camera {
        Camera {
            from: self.from.unwrap_or(camera.from),
            at: self.at.unwrap_or(camera.at),
            up: self.up.unwrap_or(camera.up),
            angle_degrees: self.angle_degrees.unwrap_or(camera.angle_degrees),
            resolution: camera.resolution,
        }
    }

    /// Whether there is a camera with these parts.
    ///
    /// # Errors
    /// What is wrong, and what was expected.
    pub fn check(&self) -> Result<(), String> {
        let orthogonal =
            |direction: DVec3| direction.try_normalize().map_or(DVec3::Z, |unit| unit.any_orthonormal_vector());
        // What is not chosen is not known yet: here it is what goes with the rest.
        let forward = self.up.map_or(DVec3::Z, orthogonal);
        let from = self.from.or(self.at.map(|at| at - forward)).unwrap_or_default();
        let at = self.at.unwrap_or(from + forward);
        let up = self.up.unwrap_or_else(|| orthogonal(at - from));
        Camera { from, at, up, angle_degrees: self.angle_degrees.unwrap_or(45.0), resolution: None }.check()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_chosen_can_be_wrong() {
        let (zero, y) = (Some(DVec3::ZERO), Some(DVec3::Y));
        let good = [
            CameraChoices::default(),
            CameraChoices { from: zero, at: y, ..CameraChoices::default() },
            CameraChoices { from: zero, up: Some(DVec3::splat(1e-100)), ..CameraChoices::default() },
            CameraChoices { at: Some(DVec3::splat(1e12)), up: y, ..CameraChoices::default() },
            CameraChoices { angle_degrees: Some(179.9), ..CameraChoices::default() },
        ];
        assert!(good.iter().all(|choices| choices.check().is_ok()));
        for (choices, expected) in [
            (CameraChoices { from: y, at: y, ..CameraChoices::default() }, "same point"),
            (CameraChoices { from: zero, at: y, up: y, ..CameraChoices::default() }, "along the view direction"),
            (CameraChoices { up: zero, ..CameraChoices::default() }, "no direction"),
            (CameraChoices { angle_degrees: Some(180.0), ..CameraChoices::default() }, "between 0 and 180"),
        ] {
            let error = choices.check().expect_err(expected);
            assert!(error.contains(expected), "{error}");
        }
    }

    #[test]
    fn the_first_choice_of_a_part_counts() {
        let light = |x| Light { position: DVec3::splat(x), colour: DVec3::ONE };
        let first = ViewChoices {
            camera: CameraChoices { from: Some(DVec3::X), angle_degrees: Some(1.0), ..CameraChoices::default() },
            lights: vec![light(1.0)],
            up: Some(UpAxis::Z),
            ..ViewChoices::default()
        };
        let second = ViewChoices {
            camera: CameraChoices { from: Some(DVec3::Y), at: Some(DVec3::Y), ..CameraChoices::default() },
            lights: vec![light(2.0), light(3.0)],
            background: Some(DVec3::ONE),
            up: None,
        };
        let both = first.clone().or(second.clone());
        assert_eq!(both.camera.parts(), [CameraPart::From, CameraPart::At, CameraPart::Angle]);
        assert_eq!((both.camera.from, both.camera.at), (Some(DVec3::X), Some(DVec3::Y)));
        assert_eq!((both.lights, both.background, both.up), (first.lights, Some(DVec3::ONE), Some(UpAxis::Z)));
        assert_eq!(ViewChoices::default().or(second.clone()), second);
    }
}
