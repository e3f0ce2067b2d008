//! From where a scene is seen, and how far it reaches.

use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use trace::preparation::{CameraPart, ChosenView, Prepared};
use trace::scene;

/// The smallest box around all primitives, world units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Bounds {
    pub low: [f64; 3],
    pub high: [f64; 3],
}

impl Bounds {
    pub fn new<P: Into<[f64; 3]>>((low, high): (P, P)) -> Self {
        Self { low: low.into(), high: high.into() }
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Camera {
    /// World units.
    pub from: [f64; 3],
    pub at: [f64; 3],
    pub up: [f64; 3],
    /// Full vertical field of view, degrees.
    pub angle: f64,
    /// Whence all but what was chosen is.
    pub source: CameraSource,
    /// What the topology or the command line says: `from`, `at`, `up`, `angle`.
    pub chosen: Vec<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CameraSource {
    /// The scene's own camera.
    Scene,
    /// Such that the whole scene is seen.
    Framing,
}

impl Camera {
    fn new(camera: &scene::Camera, has_camera: bool, chosen: &[CameraPart]) -> Self {
        Self {
            from: camera.from.into(),
            at: camera.at.into(),
            up: camera.up.into(),
            angle: camera.angle_degrees,
            source: if has_camera { CameraSource::Scene } else { CameraSource::Framing },
            chosen: chosen.iter().map(|part| part.name().to_owned()).collect(),
        }
    }
}

impl From<&Prepared> for Camera {
    fn from(prepared: &Prepared) -> Self {
        Self::new(&prepared.view.camera, prepared.has_camera, &prepared.chosen)
    }
}

impl From<&ChosenView> for Camera {
    fn from(chosen: &ChosenView) -> Self {
        Self::new(&chosen.view.camera, chosen.has_camera, &chosen.chosen)
    }
}

impl fmt::Display for Bounds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} to {}", Point(self.low), Point(self.high))
    }
}

impl fmt::Display for Camera {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [from, at, up] = [self.from, self.at, self.up].map(Point);
        write!(f, "from {from} at {at}, up {up}, angle {}; ", Rounded(self.angle))?;
        let rest = match self.source {
            CameraSource::Scene => "the scene's",
            CameraSource::Framing if self.chosen.iter().any(|part| part == "from" || part == "at") => {
                "what frames the whole scene"
            }
            CameraSource::Framing => "placed so that the whole scene is seen",
        };
        match &self.chosen[..] {
            [] => f.write_str(rest),
            chosen if chosen.len() == CameraPart::ALL.len() => f.write_str("all of it chosen"),
            chosen => write!(f, "{} chosen, else {rest}", chosen.join(", ")),
        }
    }
}

struct Point([f64; 3]);

impl fmt::Display for Point {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.0.map(Rounded);
        write!(f, "({x}, {y}, {z})")
    }
}

/// With six digits.
struct Rounded(f64);

impl fmt::Display for Rounded {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rounded: f64 = format!("{:.5e}", self.0).parse().unwrap_or(self.0);
        let is_plain = rounded == 0.0 || (1e-4..1e7).contains(&rounded.abs());
        // No negative zero.
        if is_plain { write!(f, "{}", rounded + 0.0) } else { write!(f, "{rounded:e}") }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_and_bounds_are_read_at_a_glance() {
        let bounds = Bounds::new(([-1.0, -0.0, 1.0 / 3.0], [2e9, 1.5e-5, 1234567.8]));
        assert_eq!(bounds.to_string(), "(-1, 0, 0.333333) to (2e9, 1.5e-5, 1234570)");
        let camera = |source, chosen: &[CameraPart]| Camera {
            from: [0.0, 0.0, 9.0],
            at: [0.0; 3],
            up: [0.0, 1.0, 0.0],
            angle: 45.0,
            source,
            chosen: chosen.iter().map(|part| part.name().to_owned()).collect(),
        };
        let text = |source, chosen: &[CameraPart]| camera(source, chosen).to_string();
        assert_eq!(text(CameraSource::Scene, &[]), "from (0, 0, 9) at (0, 0, 0), up (0, 1, 0), angle 45; the scene's");
        let framed = text(CameraSource::Framing, &[CameraPart::From, CameraPart::Angle]);
        assert!(framed.ends_with("; from, angle chosen, else what frames the whole scene"), "{framed}");
        let framed = text(CameraSource::Framing, &[CameraPart::Angle]);
        assert!(framed.ends_with("; angle chosen, else placed so that the whole scene is seen"), "{framed}");
        assert!(text(CameraSource::Scene, &CameraPart::ALL).ends_with("; all of it chosen"));
    }
}
