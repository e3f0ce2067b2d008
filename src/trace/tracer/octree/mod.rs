//! The octree: [`build`] makes it, [`hero`] walks it.

pub mod build;
pub mod census;
mod descent;
pub mod hero;
pub mod mailbox;
mod octants;
pub mod overlap;
mod prepared;

use serde::{Deserialize, Serialize};

use crate::database::compile::{CompileError, Records, compile};
use crate::database::verify::{Corrupt, Verified};
use crate::scene::Scene;

/// How finely to divide. Neither changes the image.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct BuildParameters {
    /// A leaf that holds more primitives than this is divided.
    pub leaf_size: u32,
    /// Deepest level; the root's is 0.
    pub max_depth: u32,
}

/// How the octree is built. None of these changes the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Octree {
    /// A leaf that holds more primitives than this is divided, 1 to 1024.
    pub leaf_size: u32,
    /// Deepest level, 0 to 20.
    pub max_depth: u32,
    /// Whether a primitive that stands in many leaves is tested once a ray.
    pub mailbox: bool,
}

impl Octree {
    pub const DEFAULT: Self = Self { leaf_size: 8, max_depth: 12, mailbox: true };
}

impl From<Octree> for BuildParameters {
    fn from(octree: Octree) -> Self {
        Self { leaf_size: octree.leaf_size, max_depth: octree.max_depth }
    }
}

#[derive(Clone, PartialEq, Debug, thiserror::Error)]
pub enum BuildError {
    #[error(transparent)]
    Compile(#[from] CompileError),
    #[error(transparent)]
    TooLarge(#[from] crate::database::layout::TooLarge),
    #[error(transparent)]
    Corrupt(#[from] Corrupt),
}

/// Scene → database, the octree built eagerly.
///
/// # Errors
/// The scene is larger than the image can address.
pub fn build_database(scene: &Scene, parameters: BuildParameters) -> Result<Verified, BuildError> {
    complete(compile(scene)?, parameters)
}

/// [`build_database`] from the records on, which need the scene no more.
///
/// # Errors
/// As [`build_database`]'s.
pub fn complete(records: Records, parameters: BuildParameters) -> Result<Verified, BuildError> {
    let octree = build::build(&records, parameters);
    let database = records.assemble(octree.words, octree.leaf_lists, parameters.max_depth)?;
    Ok(Verified::new(database)?)
}
