//! The octree: [`build`] makes it, [`hero`] walks it.

pub mod build;
pub mod census;
mod descent;
pub mod hero;
pub mod mailbox;
pub mod overlap;
mod prepared;

use crate::database::compile::{CompileError, compile};
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

#[derive(Clone, PartialEq, Debug, thiserror::Error)]
pub enum BuildError {
    #[error(transparent)]
    Compile(#[from] CompileError),
    #[error("{0}; a larger octree.leaf_size or a smaller octree.max_depth needs less")]
    Octree(#[from] build::OctreeTooLarge),
    #[error(transparent)]
    TooLarge(#[from] crate::database::layout::TooLarge),
    #[error(transparent)]
    Corrupt(#[from] Corrupt),
}

/// Scene → database, the octree built eagerly.
///
/// # Errors
/// The scene or its octree is larger than the image can address.
pub fn build_database(scene: &Scene, parameters: BuildParameters) -> Result<Verified, BuildError> {
    let records = compile(scene)?;
    let octree = build::build(&records, parameters)?;
    let database = records.assemble(&octree.words, &octree.leaf_lists, parameters.max_depth)?;
    Ok(Verified::new(database)?)
}
