//! From what a person asked for to what can be traced: the scene is read, the view chosen, the database built.

use std::time::{Duration, Instant};

use glam::DVec3;

use crate::database::compile::compile;
use crate::database::verify::Verified;
use crate::picture::ImageSettings;
use crate::scene::SceneSource;
use crate::scene::{Camera, Light, Scene, SourceError, Warning};
use crate::tracer::View;
use crate::tracer::octree::Octree;
use crate::tracer::octree::{BuildError, complete};

/// A scene, ready to be traced.
#[derive(Clone, Debug)]
pub struct Prepared {
    pub database: Verified,
    pub view: View,
    /// What of the scene was repaired or left out.
    pub warnings: Vec<Warning>,
    /// Reading the scene.
    pub load: Duration,
    /// Compiling it and building its octree.
    pub build: Duration,
}

/// What is used where the scene does not say.
#[derive(Clone, Debug, Default)]
pub struct Fallback {
    /// `None`: a camera that shows the whole scene.
    pub camera: Option<Camera>,
    /// Empty: lights beside that camera.
    pub lights: Vec<Light>,
    pub background: Option<DVec3>,
}

#[derive(Debug, thiserror::Error)]
pub enum PreparationError {
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The image settings do not fit the scene's resolution.
    #[error("{0}")]
    Image(String),
    #[error("{scene}: {error}")]
    Build { scene: String, error: BuildError },
}

/// Builds the database of a scene, and lists what of it was repaired or left out; `source` names it in errors.
///
/// # Errors
/// It is larger than can be addressed.
pub fn build(source: &SceneSource, scene: Scene, octree: Octree) -> Result<(Verified, Vec<Warning>), PreparationError> {
    let failure = |error| PreparationError::Build { scene: source.to_string(), error };
    let mut records = compile(&scene).map_err(|error| failure(error.into()))?;
    let mut warnings = scene.warnings.all().to_vec();
    warnings.append(&mut records.warnings);
    // A large one is larger than its records.
    drop(scene);
    let database = complete(records, octree.into()).map_err(failure)?;
    Ok((database, warnings))
}

/// Prepares a scene; `image` chooses the image settings once the camera, and with it the file's own resolution,
/// is known.
///
/// # Errors
/// The scene cannot be read or is too large, or `image` finds that the settings do not fit.
pub fn prepare(
    source: &SceneSource,
    octree: Octree,
    fallback: &Fallback,
    image: impl FnOnce(&Camera) -> Result<ImageSettings, String>,
) -> Result<Prepared, PreparationError> {
    let start = Instant::now();
    let scene = source.load()?;
    let load = start.elapsed();
    let view = view(&scene, fallback, image).map_err(PreparationError::Image)?;
    let start = Instant::now();
    let (database, warnings) = build(source, scene, octree)?;
    Ok(Prepared { database, view, warnings, load, build: start.elapsed() })
}

/// The scene's own camera, lights and background; else the fallback's; else what shows all of it.
///
/// # Errors
/// What `image` finds wrong.
pub fn view(
    scene: &Scene,
    fallback: &Fallback,
    image: impl FnOnce(&Camera) -> Result<ImageSettings, String>,
) -> Result<View, String> {
    let camera = scene.camera.or(fallback.camera).unwrap_or_else(|| Camera::framing(scene.bounds()));
    let lights = match (&scene.lights[..], &fallback.lights[..]) {
        // A file with a camera of its own says all: without lights it is dark.
        ([], []) if scene.camera.is_none() => camera.framing_lights().to_vec(),
        ([], fallback) => fallback.to_vec(),
        (own, _) => own.to_vec(),
    };
    let background = fallback.background.unwrap_or(scene.background);
    Ok(View { image: image(&camera)?, camera, lights, background })
}
