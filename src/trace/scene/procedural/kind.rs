//! Which procedural scene: its name, and the sizes that it can have.

use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// n³ interlocked gears: 2n³ concave polygons of 144 vertices and 144n³ quadrilaterals, and a ground.
    Gears,
    /// The Utah teapot, each of its 32 patches cut into 2n² triangles, on a chequerboard of n² squares.
    Teapot,
    /// Spheres that carry nine smaller ones each, n levels deep: (9ⁿ⁺¹ − 1)/8, and a ground.
    Balls,
    /// A pyramid of 4ⁿ⁻¹ tetrahedra.
    Tetra,
    /// 1000n long thin triangles, down to a millionth as wide as long, above a ground.
    Slivers,
    /// 100n² triangles of one plane.
    Plane,
    /// 1000n spheres with radii over nine decades, above a ground.
    Decades,
    /// 256n triangles on one that is a million times as large.
    Giant,
    /// n² small buildings of every kind of primitive in one corner of the root, and a sphere in the opposite one.
    Corner,
}

/// A size that the kind does not have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{kind} of size {size}: not made, it would be {} triangles or spheres, expected a size from {} to {}",
    kind.primitives(*size),
    kind.sizes().start(),
    kind.sizes().end()
)]
pub struct SizeError {
    pub kind: Kind,
    pub size: u32,
}

/// No such procedural scene.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{_0:?} is not a procedural scene, expected {list}", list = Kind::LIST)]
pub struct KindError(String);

impl Kind {
    pub const ALL: [Self; 9] = [
        Self::Gears,
        Self::Teapot,
        Self::Balls,
        Self::Tetra,
        Self::Slivers,
        Self::Plane,
        Self::Decades,
        Self::Giant,
        Self::Corner,
    ];

    /// Their names, for messages.
    pub const LIST: &str = "gears, teapot, balls, tetra, slivers, plane, decades, giant or corner";

    /// As in files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Gears => "gears",
            Self::Teapot => "teapot",
            Self::Balls => "balls",
            Self::Tetra => "tetra",
            Self::Slivers => "slivers",
            Self::Plane => "plane",
            Self::Decades => "decades",
            Self::Giant => "giant",
            Self::Corner => "corner",
        }
    }

    pub const fn default_size(self) -> u32 {
        match self {
            Self::Gears | Self::Balls => 4,
            Self::Teapot => 12,
            Self::Tetra => 6,
            Self::Slivers | Self::Decades => 10,
            Self::Plane => 100,
            Self::Giant => 2,
            Self::Corner => 8,
        }
    }

    /// How many triangles and spheres, or for [`Self::Corner`] at the most.
    pub fn primitives(self, size: u32) -> u128 {
        let n = u128::from(size);
        match self {
            Self::Gears => n.pow(3) * (144 * 2 + 2 * 142) + 2,
            Self::Teapot => 66 * n * n - 8 * n,
            Self::Balls => (9u128.saturating_pow(size.saturating_add(1)) - 1) / 8 + 2,
            Self::Tetra => 4u128.saturating_pow(size),
            Self::Slivers | Self::Decades => 1000 * n + 2,
            Self::Plane => 100 * n * n,
            Self::Giant => 256 * n + 1,
            Self::Corner => 42 * n * n + 3,
        }
    }

    /// The sizes that can be made: the largest is the last one below 40 million triangles and spheres, or
    /// 1000. A teapot of size 1 has patches without area at its cusps.
    pub const fn sizes(self) -> RangeInclusive<u32> {
        match self {
            Self::Gears => 1..=41,
            Self::Teapot => 2..=778,
            Self::Balls => 1..=7,
            Self::Tetra => 1..=12,
            Self::Plane => 1..=632,
            Self::Corner => 1..=975,
            Self::Slivers | Self::Decades | Self::Giant => 1..=1000,
        }
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Kind {
    type Err = KindError;

    fn from_str(name: &str) -> Result<Self, KindError> {
        Self::ALL.into_iter().find(|kind| kind.name() == name).ok_or_else(|| KindError(name.to_owned()))
    }
}
