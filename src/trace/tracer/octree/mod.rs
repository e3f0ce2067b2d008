//! The octree: [`build`] makes it, [`hero`] walks it.

pub mod build;
pub mod census;
mod descent;
pub mod hero;
pub mod mailbox;
mod octants;
pub mod overlap;
#[cfg(test)]
mod polygon_tests;
mod prepared;

use serde::{Deserialize, Serialize};

use crate::database::RecordLayout;
use crate::database::compile::{CompileError, Records, compile_as};
use crate::database::records::MAX_DEPTH;
use crate::database::verify::{Corrupt, Verified};
use crate::scene::Scene;

/// How finely to divide. Neither changes the image.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct BuildParameters {
    /// A leaf that has more primitives than this is divided, 1 to 1024.
    pub leaf_size: u32,
    /// Deepest level, 0 to 20; the root's is 0.
    pub max_depth: u32,
}

/// How the octree is built. None of these changes the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Octree {
    /// A leaf that has more primitives than this is divided, 1 to 1024.
    pub leaf_size: u32,
    /// Deepest level, 0 to 20.
    pub max_depth: u32,
    /// Whether a primitive that is in many leaves is tested once a ray.
    pub mailbox: bool,
}

/// Most primitives of a leaf that is not divided for having too many.
pub const LEAF_SIZE_MAX: u32 = 1024;

impl Octree {
    /// What is used where nothing else is asked for.
    pub const DEFAULT: Self = Self { leaf_size: 8, max_depth: 12, mailbox: true };
}

impl From<Octree> for BuildParameters {
    fn from(octree: Octree) -> Self {
        Self { leaf_size: octree.leaf_size, max_depth: octree.max_depth }
    }
}

impl BuildParameters {
    fn check(self) -> Result<(), BuildError> {
        let is_leaf_size = (1..=LEAF_SIZE_MAX).contains(&self.leaf_size);
        if is_leaf_size && self.max_depth <= MAX_DEPTH { Ok(()) } else { Err(BuildError::Parameters(self)) }
    }
}

/// Why there is no database of a scene.
#[derive(Clone, PartialEq, Debug, thiserror::Error)]
pub enum BuildError {
    /// Out of their ranges.
    #[error(
        "an octree of leaf size {} and depth {}, expected a leaf size from 1 to {LEAF_SIZE_MAX} and a depth from 0 to {MAX_DEPTH}",
        _0.leaf_size,
        _0.max_depth
    )]
    Parameters(BuildParameters),
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
/// The parameters are out of their ranges, or the scene is larger than a database can address.
pub fn build_database(scene: &Scene, parameters: BuildParameters) -> Result<Verified, BuildError> {
    build_database_as(scene, parameters, RecordLayout::DEFAULT)
}

/// [`build_database`], its records laid out like this.
///
/// # Errors
/// As [`build_database`]'s.
pub fn build_database_as(
    scene: &Scene,
    parameters: BuildParameters,
    layout: RecordLayout,
) -> Result<Verified, BuildError> {
    parameters.check()?;
    complete(compile_as(scene, layout)?, parameters)
}

/// [`build_database`] from the records on, which need the scene no more.
///
/// # Errors
/// As [`build_database`]'s.
pub fn complete(records: Records, parameters: BuildParameters) -> Result<Verified, BuildError> {
    parameters.check()?;
    let octree = build::build(&records, parameters);
    let database = records.assemble(octree.words, octree.leaf_lists, parameters.max_depth)?;
    Ok(Verified::new(database)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_out_of_range_are_refused() {
        let scene = Scene::default();
        for (leaf_size, max_depth) in [(0, 12), (1025, 12), (100_000, 12), (8, 21), (8, 99), (u32::MAX, u32::MAX)] {
            let parameters = BuildParameters { leaf_size, max_depth };
            let error = build_database(&scene, parameters).expect_err("out of range");
            assert_eq!(error, BuildError::Parameters(parameters));
        }
        let error = BuildError::Parameters(BuildParameters { leaf_size: 8, max_depth: 99 });
        assert_eq!(
            error.to_string(),
            "an octree of leaf size 8 and depth 99, expected a leaf size from 1 to 1024 and a depth from 0 to 20"
        );
    }
}
