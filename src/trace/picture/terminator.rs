//! Where a smooth surface turns away from a light.

use std::fmt;
use std::str::FromStr;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Where the rays to lights leave from smooth triangles, which are flat while their shading is round.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Terminator {
    /// From the triangle itself: coarse meshes have black steps, a triangle wide, where they turn from a light.
    #[default]
    Hard,
    /// From the round surface that the normals describe, whose normals are turned to the eye as the triangle's own is (J. Hanika, *Hacking the Shadow Terminator*, Ray Tracing Gems II, 2021).
    Soft,
}

impl Terminator {
    pub const ALL: [Self; 2] = [Self::Hard, Self::Soft];

    pub const fn name(self) -> &'static str {
        match self {
            Self::Hard => "hard",
            Self::Soft => "soft",
        }
    }
}

impl fmt::Display for Terminator {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// For command lines.
impl FromStr for Terminator {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::ALL.into_iter().find(|one| one.name() == text).ok_or("expected hard or soft")
    }
}
