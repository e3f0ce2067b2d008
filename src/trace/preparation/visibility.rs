//! Whether anything of a scene can be seen in a view.

use std::convert::Infallible;

use glam::DVec3;

use crate::database::verify::Verified;
use crate::picture::{AovSet, ImageSettings, Rect};
use crate::scene::{Camera, Warning};
use crate::tracer::MemoryPort;
use crate::tracer::octree::hero::Hero;
use crate::tracer::primary::PrimaryRays;
use crate::tracer::ray::Ray;
use crate::tracer::slices::Slices;
use crate::tracer::{TileTracer, TraceStats, View};

/// Pixels to look at, along each side of the image.
const PROBES: u32 = 16;

/// Warns where it is sure, before anything is traced, that the image shows the background alone.
pub(super) fn of_bounds(bounds: Option<(DVec3, DVec3)>, view: &View) -> Option<Warning> {
    let Some((low, high)) = bounds else {
        return Some(Warning::of_scene(
            "no-primitives",
            "the scene has no surfaces (points, lines and curves are none): the background is all that is seen",
        ));
    };
    let corners = (0..8).map(|i| {
        let pick = |axis: usize| if i >> axis & 1 == 0 { low[axis] } else { high[axis] };
        DVec3::new(pick(0), pick(1), pick(2))
    });
    let corners: Vec<_> = corners.collect();
    let (side, _) = sides(&view.camera, &view.image)
        .into_iter()
        .find(|(_, inward)| corners.iter().all(|corner| is_outside(*corner - view.camera.from, *inward)))?;
    Some(Warning::of_scene("out-of-view", format!("the whole scene is {side}: the background is all that is seen")))
}

/// The planes through the eye that what is seen is between, as vectors that point to its side.
fn sides(camera: &Camera, image: &ImageSettings) -> [(&'static str, DVec3); 5] {
    let forward = (camera.at - camera.from).normalize();
    let right = forward.cross(camera.up).normalize();
    let up = right.cross(forward);
    let half_height = libm::tan(camera.angle_degrees.to_radians() / 2.0);
    let half_width = half_height * f64::from(image.width()) / f64::from(image.height());
    [
        ("behind the camera", forward),
        ("left of what the camera sees", forward * half_width + right),
        ("right of what the camera sees", forward * half_width - right),
        ("below what the camera sees", forward * half_height + up),
        ("above what the camera sees", forward * half_height - up),
    ]
}

/// Whether a point, relative to the eye, is on the other side of a plane; not where rounding could decide it.
fn is_outside(point: DVec3, inward: DVec3) -> bool {
    const ROUNDING: f64 = 1e-9;
    point.dot(inward) < -ROUNDING * point.length() * inward.length()
}

/// The kind of [`of_light`]'s warning.
const NOTHING_LIT: &str = "nothing-lit";

/// Whether a warning is about what was found, not about what a few pixels make likely.
pub fn is_certain(warning: &Warning) -> bool {
    warning.kind != NOTHING_LIT
}

/// Warns where a few pixels show surfaces, and all of them are black.
pub(super) fn of_light(database: &Verified, view: &View) -> Option<Warning> {
    // Most scenes show light without any reflection.
    if [0, view.image.depth()].into_iter().any(|depth| is_lit(database, view, depth)) {
        return None;
    }
    let seen = Seen::of(database, view);
    if seen.surfaces == 0 {
        return None;
    }
    let why = if seen.clear == seen.surfaces {
        "all that is seen is wholly transparent"
    } else if seen.back_sides == seen.pixels {
        "the camera sees back sides alone, and is probably inside of a closed surface"
    } else if view.lights.iter().all(|light| light.colour == DVec3::ZERO) {
        "every light is black"
    } else if !seen.has_light_in_front {
        "every light is behind the surfaces that are seen"
    } else {
        "all of it is black, or in the shadow of something else"
    };
    let Seen { surfaces, pixels, .. } = seen;
    let text = format!("none of the surfaces at {surfaces} of {pixels} pixels that were tried is lit: {why}");
    Some(Warning::of_scene(NOTHING_LIT, text))
}

/// The pixels to look at.
fn probes(image: &ImageSettings) -> impl Iterator<Item = (u32, u32)> {
    // The middle of each part, without those that are the same.
    let along = |side: u32| {
        let mut places: Vec<u32> = (0..PROBES).map(|i| (2 * i + 1) * side / (2 * PROBES)).collect();
        places.dedup();
        places
    };
    let (across, down) = (along(image.width()), along(image.height()));
    down.into_iter().flat_map(move |y| across.clone().into_iter().map(move |x| (x, y)))
}

/// Tests of primitives that the pixels may take together: where there are more, nothing is said.
const TESTS_MAX: u64 = 1 << 20;

/// Whether light comes from a surface, with so many reflections and refractions, or it takes too much to know.
fn is_lit(database: &Verified, view: &View, depth: u32) -> bool {
    let image = &view.image;
    let Ok(settings) = ImageSettings::new(image.width(), image.height(), depth, image.cutoff()) else { return true };
    let view = View { image: settings.with_terminator(image.terminator()), ..view.clone() };
    let mut tracer = TileTracer::new(&database.database().header, &view, true);
    let mut slices = Slices::new(database);
    let aov = AovSet { primitive: true, ..AovSet::default() };
    let mut tests = 0;
    probes(image).any(|(x, y)| {
        let Ok::<_, Infallible>((pixels, stats)) = tracer.trace(&mut slices, Rect { x, y, width: 1, height: 1 }, aov);
        tests += stats.primitive_tests + stats.polygon_triangles;
        tests > TESTS_MAX || pixels.primitive[0] >= 0 && pixels.colour[0].iter().any(|&channel| channel > 0.0)
    })
}

/// What pixels show.
struct Seen {
    pixels: u32,
    surfaces: u32,
    back_sides: u32,
    /// Surfaces that show what is behind them and nothing of themselves.
    clear: u32,
    has_light_in_front: bool,
}

impl Seen {
    fn of(database: &Verified, view: &View) -> Self {
        let header = &database.database().header;
        let (camera, mut hero, mut slices) =
            (PrimaryRays::new(header, view), Hero::new(header, true), Slices::new(database));
        let lights: Vec<_> = view.lights.iter().map(|light| header.normalisation.point(light.position)).collect();
        let mut stats = TraceStats::default();
        let mut seen = Self { pixels: 0, surfaces: 0, back_sides: 0, clear: 0, has_light_in_front: false };
        for (x, y) in probes(&view.image) {
            seen.pixels += 1;
            let direction = camera.direction(x, y);
            let Some((ray, _)) = Ray::from_eye(camera.eye, direction) else { continue };
            let Ok::<_, Infallible>(hit) = hero.nearest(&mut slices, &ray, &mut stats);
            let Some(hit) = hit else { continue };
            let point = hit.surface_point(&ray);
            let towards_eye = DVec3::from(point.normal_to_eye(direction).map(f64::from));
            seen.surfaces += 1;
            let Ok::<_, Infallible>(surface) = slices.surface(hit.primitive.0);
            let Ok::<_, Infallible>(material) = slices.material(surface.material);
            let own = material.diffuse.into_iter().chain(material.highlight).chain(material.reflection);
            seen.clear += u32::from(material.transmittance == 1.0 && own.into_iter().all(|share| share == 0.0));
            seen.back_sides += u32::from(point.normal.dot(direction) > 0.0);
            seen.has_light_in_front |= lights.iter().any(|&light| (light - point.position).dot(towards_eye) > 0.0);
        }
        seen
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::preparation::{ViewChoices, view as view_of};
    use crate::scene::{Light, Material, Scene, Sphere};
    use crate::tracer::octree::{Octree, build_database};

    fn camera(from: DVec3, at: DVec3) -> Camera {
        Camera { from, at, up: DVec3::Y, angle_degrees: 40.0, resolution: Some((32, 20)) }
    }

    fn sphere(camera: Camera, light: DVec3) -> Scene {
        Scene {
            camera: Some(camera),
            lights: vec![Light { position: light, colour: DVec3::ONE }],
            materials: vec![Material::WHITE],
            spheres: vec![Sphere { centre: DVec3::ZERO, radius: 1.0, material: 0 }],
            ..Scene::default()
        }
    }

    fn view(scene: &Scene) -> View {
        let image = |_: &_| ImageSettings::new(32, 20, 2, 0.0).map_err(|error| error.to_string());
        view_of(scene, &ViewChoices::default(), image).expect("a view")
    }

    fn lighting(scene: &Scene) -> Option<String> {
        let database = build_database(scene, Octree::DEFAULT.into()).expect("small");
        of_light(&database, &view(scene)).map(|warning| warning.to_string())
    }

    #[test]
    fn what_is_beside_the_view_is_named_with_its_side() {
        let eye = DVec3::new(0.0, 0.0, 9.0);
        let seen_from = |at: DVec3| {
            let scene = sphere(camera(eye, at), eye);
            of_bounds(scene.bounds(), &view(&scene)).map(|warning| warning.text)
        };
        assert_eq!(seen_from(DVec3::ZERO), None);
        // The edge of the sphere is in the corner of an eye.
        assert_eq!(seen_from(DVec3::new(4.0, 0.0, 0.0)), None);
        for (at, side) in [
            (DVec3::new(0.0, 0.0, 20.0), "behind"),
            (DVec3::new(12.0, 0.0, 0.0), "left of"),
            (DVec3::new(-12.0, 0.0, 0.0), "right of"),
            (DVec3::new(0.0, 8.0, 0.0), "below"),
            (DVec3::new(0.0, -8.0, 0.0), "above"),
        ] {
            let text = seen_from(at).expect(side);
            assert!(text.starts_with(&format!("the whole scene is {side}")), "{text}");
        }
        let empty = Scene { spheres: Vec::new(), ..sphere(camera(eye, DVec3::ZERO), eye) };
        assert_eq!(of_bounds(empty.bounds(), &view(&empty)).expect("nothing").kind, "no-primitives");
    }

    #[test]
    fn a_dark_image_is_explained() {
        let (eye, inside) = (DVec3::new(0.0, 0.0, 5.0), DVec3::new(0.0, 0.0, 0.5));
        assert_eq!(lighting(&sphere(camera(eye, DVec3::ZERO), eye)), None);
        assert_eq!(lighting(&sphere(camera(inside, DVec3::ZERO), DVec3::ZERO)), None, "a room with a lamp");
        let dark = |scene: &Scene| lighting(scene).expect("dark");
        assert!(dark(&sphere(camera(inside, DVec3::ZERO), eye)).ends_with("probably inside of a closed surface"));
        let behind = sphere(camera(eye, DVec3::ZERO), -eye);
        assert!(dark(&behind).ends_with("every light is behind the surfaces that are seen"));
        let mut black = sphere(camera(eye, DVec3::ZERO), eye);
        black.materials[0].diffuse = DVec3::ZERO;
        assert!(dark(&black).ends_with("all of it is black, or in the shadow of something else"));
        let mut unlit = sphere(camera(eye, DVec3::ZERO), eye);
        unlit.lights[0].colour = DVec3::ZERO;
        assert!(dark(&unlit).ends_with("every light is black"));
    }

    #[test]
    fn a_mirror_that_shows_light_is_not_dark() {
        let eye = DVec3::new(0.0, 0.0, 5.0);
        let mut scene = sphere(camera(eye, DVec3::ZERO), -eye);
        scene.materials[0].reflection = DVec3::splat(0.5);
        assert!(lighting(&scene).is_some(), "it reflects a black background");
        scene.background = DVec3::ONE;
        assert_eq!(lighting(&scene), None);
    }

    #[test]
    fn small_images_are_looked_at_in_every_pixel_once() {
        let image = |width, height| ImageSettings::new(width, height, 0, 0.0).expect("possible");
        assert_eq!(probes(&image(2, 1)).collect::<Vec<_>>(), [(0, 0), (1, 0)]);
        assert_eq!(probes(&image(65_536, 512)).count(), 256);
    }
}
