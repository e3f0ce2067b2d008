//! The axis of a scene that is vertical.

use std::str::FromStr;

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Which axis of a scene points up, where the scene has no camera that says so.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum UpAxis {
    /// As in most OBJ files, which face +z.
    #[default]
    Y,
    /// As in files of technical drawing, which face -y.
    Z,
}

impl UpAxis {
    pub const ALL: [Self; 2] = [Self::Y, Self::Z];

    pub const fn name(self) -> &'static str {
        match self {
            Self::Y => "y",
            Self::Z => "z",
        }
    }

    /// A vector of a scene whose y is up, in one whose vertical axis is this: turned about x.
    pub fn turn(self, vector: DVec3) -> DVec3 {
        match self {
            Self::Y => vector,
            Self::Z => DVec3::new(vector.x, -vector.z, vector.y),
        }
    }
}

/// For command lines.
impl FromStr for UpAxis {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::ALL.into_iter().find(|axis| axis.name() == text).ok_or("expected y or z")
    }
}
