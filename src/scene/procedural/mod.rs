//! Scenes written from their definitions: the ones of Haines' Standard Procedural Databases (SPD)
//! that the paper uses, and two more.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Which procedural scene, and how large.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Procedural {
    pub kind: Kind,
    /// SPD's size factor; its range depends on the kind.
    pub size: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    Gears,
    Teapot,
    Balls,
    Tetra,
}
