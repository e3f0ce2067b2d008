//! The view of a scene: what is chosen, else what the scene says, else what shows all of it.

use std::path::Path;

use glam::DVec3;

use super::view_choices::{CameraPart, ViewChoices};
use super::visibility;
use crate::picture::{ImageSettings, Terminator};
use crate::scene::{Camera, Scene, Warning};
use crate::tracer::View;

/// A view, and where it is from.
#[derive(Clone, Debug, PartialEq)]
pub struct ChosenView {
    pub view: View,
    /// Smallest box around all primitives, world coordinates; `None` where there are none.
    pub bounds: Option<(DVec3, DVec3)>,
    /// Whether the scene has a camera; else the parts that are not chosen show all of it.
    pub has_camera: bool,
    /// What of the camera was chosen.
    pub chosen: Vec<CameraPart>,
    /// About choices that have no effect, and about what cannot be seen.
    pub warnings: Vec<Warning>,
}

/// Image settings for those who choose none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageDefaults {
    /// Width and height, pixels.
    pub resolution: (u32, u32),
    pub terminator: Terminator,
}

impl ImageDefaults {
    /// Where the scene has none.
    const RESOLUTION: (u32, u32) = (512, 512);

    /// The scene's own.
    pub fn of(scene: &Scene) -> Self {
        let resolution = scene.camera.and_then(|camera| camera.resolution);
        Self { resolution: resolution.unwrap_or(Self::RESOLUTION), terminator: scene.terminator }
    }
}

/// The view of a scene; `image` makes the image settings.
///
/// # Errors
/// What is wrong with the camera, or what `image` finds wrong.
pub fn view(
    scene: &Scene,
    choices: &ViewChoices,
    image: impl FnOnce(&ImageDefaults) -> Result<ImageSettings, String>,
) -> Result<View, String> {
    choose(scene, choices, image).map(|chosen| chosen.view)
}

/// [`view`], and where it is from.
///
/// # Errors
/// What is wrong with the camera, or what `image` finds wrong.
pub fn choose(
    scene: &Scene,
    choices: &ViewChoices,
    image: impl FnOnce(&ImageDefaults) -> Result<ImageSettings, String>,
) -> Result<ChosenView, String> {
    let image = image(&ImageDefaults::of(scene))?;
    let bounds = scene.bounds();
    let aspect = f64::from(image.width()) / f64::from(image.height());
    let axis = choices.up.unwrap_or_default();
    let angle = choices.camera.angle_degrees.filter(|angle| *angle > 0.0 && *angle < 180.0);
    let framing = || Camera::framing(bounds, axis, aspect, angle.unwrap_or(Camera::FRAMING_ANGLE_DEGREES));
    let mut camera = choices.camera.applied_to(&scene.camera.unwrap_or_else(framing));
    if scene.camera.is_none() && choices.camera.up.is_none() && camera.check().is_err() {
        // Seen from straight above or below, what is at the back is at the top.
        camera.up = axis.turn(DVec3::NEG_Z);
    }
    camera.check().map_err(|what| format!("camera: {what}"))?;
    let lights = match (&choices.lights[..], &scene.lights[..]) {
        ([], []) => camera.framing_lights().to_vec(),
        ([], own) => own.to_vec(),
        (chosen, _) => chosen.to_vec(),
    };
    let background = choices.background.unwrap_or(scene.background);
    let view = View { camera, lights, background, image };
    let warnings =
        [without_effect(scene, choices), without_light(scene, choices), visibility::of_bounds(bounds, &view)];
    Ok(ChosenView {
        view,
        bounds,
        has_camera: scene.camera.is_some(),
        chosen: choices.camera.parts(),
        warnings: warnings.into_iter().flatten().collect(),
    })
}

/// The vertical axis decides where the eye is and what is up in the image, where nothing else does.
fn without_effect(scene: &Scene, choices: &ViewChoices) -> Option<Warning> {
    let axis = choices.up?;
    let why = match choices.camera {
        _ if scene.camera.is_some() => "the scene has a camera of its own",
        camera if camera.from.is_some() && camera.up.is_some() => "the camera's from and up are given",
        _ => return None,
    };
    Some(Warning::of_scene("no-effect", format!("the vertical axis {} has no effect: {why}", axis.name())))
}

/// OBJ files cannot have any: there it goes without saying.
fn without_light(scene: &Scene, choices: &ViewChoices) -> Option<Warning> {
    let extension = scene.file.as_deref().and_then(Path::extension);
    let can_have_lights = !extension.is_some_and(|extension| extension.eq_ignore_ascii_case("obj"));
    let has_lights = !scene.lights.is_empty() || !choices.lights.is_empty();
    let text = "the scene has no lights: two beside the camera light it";
    (can_have_lights && !has_lights).then(|| Warning::of_scene("no-light", text))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::preparation::CameraChoices;
    use crate::scene::{Light, Sphere, UpAxis};

    const OWN: Camera = Camera {
        from: DVec3::new(0.0, 0.0, 9.0),
        at: DVec3::ZERO,
        up: DVec3::Y,
        angle_degrees: 30.0,
        resolution: Some((64, 32)),
    };
    const LIGHT: Light = Light { position: DVec3::ONE, colour: DVec3::ONE };

    fn sphere() -> Scene {
        let sphere = Sphere { centre: DVec3::new(1.0, 2.0, 3.0), radius: 1.0, material: 0 };
        Scene { spheres: vec![sphere], file: Some("a.OBJ".into()), ..Scene::default() }
    }

    fn with_camera() -> Scene {
        Scene { camera: Some(OWN), lights: vec![LIGHT], terminator: Terminator::Soft, ..sphere() }
    }

    fn chosen(scene: &Scene, choices: &ViewChoices) -> ChosenView {
        let image = |defaults: &ImageDefaults| {
            let (width, height) = defaults.resolution;
            let image = ImageSettings::new(width, height, 4, 0.0).map_err(|error| error.to_string())?;
            Ok(image.with_terminator(defaults.terminator))
        };
        choose(scene, choices, image).expect("a possible view")
    }

    fn kinds(chosen: &ChosenView) -> Vec<&str> {
        chosen.warnings.iter().map(|warning| warning.kind.as_str()).collect()
    }

    #[test]
    fn a_scene_says_what_is_not_chosen() {
        let found = chosen(&with_camera(), &ViewChoices::default());
        assert_eq!((found.view.camera, &found.view.lights[..]), (OWN, &[LIGHT][..]));
        let image = found.view.image;
        assert_eq!((image.width(), image.height(), image.terminator()), (64, 32, Terminator::Soft));
        assert_eq!((found.has_camera, found.chosen.len(), found.warnings.len()), (true, 0, 0));
        assert_eq!(found.bounds, Some((DVec3::new(0.0, 1.0, 2.0), DVec3::new(2.0, 3.0, 4.0))));
    }

    #[test]
    fn what_is_chosen_replaces_what_the_scene_says() {
        let light = Light { position: DVec3::Z, ..LIGHT };
        let camera = CameraChoices { from: Some(DVec3::X), ..CameraChoices::default() };
        let choices =
            ViewChoices { camera, lights: vec![light, light], background: Some(DVec3::X), ..ViewChoices::default() };
        let found = chosen(&with_camera(), &choices);
        assert_eq!(found.view.camera, Camera { from: DVec3::X, ..OWN });
        assert_eq!((&found.view.lights[..], found.view.background), (&[light, light][..], DVec3::X));
        assert_eq!((found.has_camera, &found.chosen[..]), (true, &[CameraPart::From][..]));
    }

    #[test]
    fn a_scene_without_a_camera_is_framed_around_what_is_chosen() {
        let camera = CameraChoices { from: Some(DVec3::splat(50.0)), ..CameraChoices::default() };
        let found = chosen(&sphere(), &ViewChoices { camera, up: Some(UpAxis::Z), ..ViewChoices::default() });
        let expected = Camera {
            from: DVec3::splat(50.0),
            at: DVec3::new(1.0, 2.0, 3.0),
            up: DVec3::Z,
            angle_degrees: 45.0,
            resolution: None,
        };
        assert_eq!((found.view.camera, found.view.lights.len()), (expected, 2));
        assert_eq!((found.has_camera, found.view.image.width(), found.warnings.len()), (false, 512, 0));
    }

    #[test]
    fn a_portrait_is_framed_from_farther_away() {
        let distance = |width, height| {
            let image = |_: &_| ImageSettings::new(width, height, 0, 0.0).map_err(|error| error.to_string());
            let camera = view(&sphere(), &ViewChoices::default(), image).expect("possible").camera;
            camera.from.distance(camera.at)
        };
        assert!(distance(32, 64) > 1.5 * distance(64, 64));
        assert!(distance(640, 64) <= distance(64, 64));
    }

    #[test]
    fn a_vertical_axis_without_effect_is_warned_of() {
        let up = ViewChoices { up: Some(UpAxis::Z), ..ViewChoices::default() };
        assert_eq!(kinds(&chosen(&with_camera(), &up)), ["no-effect"]);
        let camera = CameraChoices { from: Some(DVec3::splat(9.0)), up: Some(DVec3::Y), ..CameraChoices::default() };
        assert_eq!(kinds(&chosen(&sphere(), &ViewChoices { camera, ..up.clone() })), ["no-effect"]);
        let camera = CameraChoices { from: None, ..camera };
        assert!(kinds(&chosen(&sphere(), &ViewChoices { camera, ..up })).is_empty());
    }

    #[test]
    fn a_scene_that_could_have_lights_and_has_none_is_lit_and_warned_of() {
        let dark = Scene { lights: Vec::new(), file: Some("a.nff".into()), ..with_camera() };
        let found = chosen(&dark, &ViewChoices::default());
        assert_eq!((found.view.lights.clone(), kinds(&found)), (OWN.framing_lights().to_vec(), vec!["no-light"]));
        let lit = chosen(&dark, &ViewChoices { lights: vec![LIGHT], ..ViewChoices::default() });
        assert_eq!((&lit.view.lights[..], kinds(&lit).len()), (&[LIGHT][..], 0));
    }

    #[test]
    fn a_camera_that_cannot_be_is_refused() {
        let choices = ViewChoices {
            camera: CameraChoices { at: Some(OWN.from), ..CameraChoices::default() },
            ..ViewChoices::default()
        };
        let image = |_: &_| ImageSettings::new(8, 8, 0, 0.0).map_err(|error| error.to_string());
        let error = view(&with_camera(), &choices, image).expect_err("no direction");
        assert_eq!(error, "camera: from and at are the same point, expected two");
    }
}
