//! The reference scenes as they are, far from the origin, tiny, and huge.

use glam::DVec3;
use trace::oracle::verify;
use trace::picture::ImageSettings;
use trace::preparation::{ViewChoices, view};
use trace::scene::Placement;
use trace::scene::SceneSource;
use trace::tracer::octree::{BuildParameters, build_database};

const RAYS: u64 = 3000;

const PLACEMENTS: [Placement; 4] = [
    Placement { scale: 1.0, translation: 0.0 },
    Placement { scale: 1.0, translation: 1e6 },
    Placement { scale: 1e-12, translation: 0.0 },
    Placement { scale: 1e12, translation: 0.0 },
];

/// No hit lost and none made up, by any kernel, in any reference scene, wherever it stands. With more rays:
///
///     marti verify SCENE --rays 1000000 --translate 1e6
#[test]
fn nothing_is_lost_or_made_up_in_the_reference_scenes() {
    for name in ["gears:2", "teapot:12", "balls:3", "tetra:6", "scenes/primitives.nff", "scenes/house.obj"] {
        for placement in PLACEMENTS {
            let source: SceneSource = name.parse().expect("a scene");
            let mut scene = source.load().expect("it can be read");
            scene.place(placement).expect("it stays finite");
            let image = |_: &_| Ok(ImageSettings::new(500, 500, 0, 0.0).expect("possible"));
            let view = view(&scene, &ViewChoices::default(), image).expect("a view");
            let database = build_database(&scene, BuildParameters { leaf_size: 8, max_depth: 12 }).expect("builds");
            let verification = verify(&database, &view, RAYS, 3);
            assert!(verification.holds(), "{name}, {placement:?}: {:#?}", verification.disagreements);
            for kernel in &verification.kernels {
                let (counts, name) = (&kernel.total, format!("{}, {name}, {placement:?}", kernel.kernel));
                assert_eq!(counts.rays, RAYS, "{name}");
                assert_eq!(counts.agreeing + counts.other_primitive, RAYS, "{name}");
                assert!(counts.hits > RAYS / 10, "{name}: {} hits", counts.hits);
                // Rounding to f32.
                assert!(counts.worst_depth_error < 1.2e-7, "{name}: {}", counts.worst_depth_error);
            }
        }
    }
}

/// A scene that is only a few thousand units in the last place wide loses nothing either.
#[test]
fn a_scene_of_some_ulps_loses_nothing() {
    for scale in [1e-4, 1e-6] {
        let mut scene = "tetra:3".parse::<SceneSource>().expect("a scene").load().expect("it can be made");
        scene.place(Placement { scale, translation: 1e9 }).expect("it stays finite");
        let image = |_: &_| Ok(ImageSettings::new(100, 100, 0, 0.0).expect("possible"));
        // The scene's own camera may have moved into its target.
        let camera = trace::scene::Camera {
            from: DVec3::splat(1e9 + 1.0),
            at: DVec3::splat(1e9),
            up: DVec3::Z,
            angle_degrees: 30.0,
            resolution: None,
        };
        scene.camera = Some(camera);
        let view = view(&scene, &ViewChoices::default(), image).expect("a view");
        let database = build_database(&scene, BuildParameters { leaf_size: 8, max_depth: 12 }).expect("builds");
        let verification = verify(&database, &view, RAYS, 5);
        assert!(verification.holds(), "{scale}: {:#?}", verification.disagreements);
        assert!(verification.kernels[0].total.hits > RAYS / 10, "{scale}: {:?}", verification.kernels[0].total);
    }
}
