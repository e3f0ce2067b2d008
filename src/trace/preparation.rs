//! From what a person asked for to what can be traced: the scene is read, the view chosen, the database built.

mod chosen_view;
mod view_choices;
mod visibility;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use glam::DVec3;

pub use chosen_view::{ChosenView, ImageDefaults, choose, view};
pub use view_choices::{CameraChoices, CameraPart, ViewChoices};
pub use visibility::is_certain;

use crate::database::RecordLayout;
use crate::database::compile::compile_as;
use crate::database::verify::Verified;
use crate::picture::ImageSettings;
use crate::scene::{Scene, SceneSource, SourceError, Warning};
use crate::tracer::View;
use crate::tracer::octree::Octree;
use crate::tracer::octree::{BuildError, complete};

/// How a scene's database is built. None of it changes the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BuildChoices {
    pub octree: Octree,
    pub records: RecordLayout,
}

impl From<Octree> for BuildChoices {
    fn from(octree: Octree) -> Self {
        Self { octree, records: RecordLayout::DEFAULT }
    }
}

/// A scene, ready to be traced.
#[derive(Clone, Debug)]
pub struct Prepared {
    pub database: Verified,
    pub view: View,
    /// Smallest box around all primitives, world coordinates; `None` where there are none.
    pub bounds: Option<(DVec3, DVec3)>,
    /// Whether the scene has a camera; else the parts that are not chosen show all of it.
    pub has_camera: bool,
    /// What of the camera was chosen, in the order of [`CameraPart::ALL`].
    pub chosen: Vec<CameraPart>,
    /// Those of the scene first, then those of its polygons, then those of its view.
    pub warnings: Vec<Warning>,
    /// Files that the scene was read from besides its own.
    pub libraries: Vec<PathBuf>,
    /// Reading the scene.
    pub load: Duration,
    /// Compiling it and building its octree.
    pub build: Duration,
}

#[derive(Debug, thiserror::Error)]
pub enum PreparationError {
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The camera cannot be, or the image settings do not fit the scene's resolution.
    #[error("{0}")]
    View(String),
    #[error("{scene}: {error}")]
    Build { scene: String, error: BuildError },
}

/// Builds the database of a scene, and lists what of it was repaired or left out; `source` names it in errors.
///
/// # Errors
/// It is larger than can be addressed.
pub fn build(
    source: &SceneSource,
    scene: Scene,
    choices: impl Into<BuildChoices>,
) -> Result<(Verified, Vec<Warning>), PreparationError> {
    let BuildChoices { octree, records } = choices.into();
    let failure = |error| PreparationError::Build { scene: source.to_string(), error };
    let mut records = compile_as(&scene, records).map_err(|error| failure(error.into()))?;
    let mut warnings = scene.warnings.all().to_vec();
    warnings.append(&mut records.warnings);
    // A large one is larger than its records.
    drop(scene);
    let database = complete(records, octree.into()).map_err(failure)?;
    Ok((database, warnings))
}

/// Prepares a scene; `image` chooses the image settings once the scene's own are known.
///
/// # Errors
/// The scene cannot be read or is too large, its camera cannot be, or `image` finds that the settings do not fit.
pub fn prepare(
    source: &SceneSource,
    database: impl Into<BuildChoices>,
    choices: &ViewChoices,
    image: impl FnOnce(&ImageDefaults) -> Result<ImageSettings, String>,
) -> Result<Prepared, PreparationError> {
    let start = Instant::now();
    let scene = source.load()?;
    let load = start.elapsed();
    let ChosenView { view, bounds, has_camera, chosen, warnings: of_view } =
        choose(&scene, choices, image).map_err(PreparationError::View)?;
    let libraries = scene.libraries.clone();
    let start = Instant::now();
    let (database, mut warnings) = build(source, scene, database)?;
    let build = start.elapsed();
    let may_be_seen = visibility::of_bounds(bounds, &view).is_none();
    warnings.extend(of_view.into_iter().chain(may_be_seen.then(|| visibility::of_light(&database, &view)).flatten()));
    Ok(Prepared { database, view, bounds, has_camera, chosen, warnings, libraries, load, build })
}
