use proptest::prelude::*;

use super::*;
use crate::picture::Terminator;
use crate::scene::Warnings;

fn read(text: impl Into<Vec<u8>>) -> Result<Scene, String> {
    parse(&Source::from_bytes("x.nff", text)).map_err(|error| error.to_string())
}

const EVERYTHING: &str = "\
# Everything the format has.
b 0.1 0.2 0.3
v
from 0 -5 1
at 0 0 0
up 0 0 1
angle 40
hither 0.1
resolution 320 240
l 1 2 3
l 4 5 6 0.5 0.25 1e0 # with a colour
f 1 .5 0 0.5 0.25 10 0 0
s 1 2 3 -0.5
c 0 0 0 1 0 0 2 0
c
 0 0 0 -1
 0 0 2 -2
f 1 1 1 +1 0 5. 0.5 1.5
p 4
 0 0 0
 2 0 0 # a comment within
 2 2 0
 1 1 0
pp 3
0 0 0  0 0 2
1 0 0  0 3 4
0 1 0  1 0 0
";

#[test]
fn every_entity_is_read() {
    let scene = read(EVERYTHING).expect("valid");
    let v = DVec3::new;
    assert_eq!(scene.background, v(0.1, 0.2, 0.3));
    let camera = scene.camera.expect("a camera");
    assert_eq!((camera.from, camera.at, camera.up), (v(0.0, -5.0, 1.0), DVec3::ZERO, DVec3::Z));
    assert_eq!((camera.angle_degrees, camera.resolution), (40.0, Some((320, 240))));
    assert_eq!(scene.lights[0], Light { position: v(1.0, 2.0, 3.0), colour: DVec3::splat(1.0 / 2f64.sqrt()) });
    assert_eq!(scene.lights[1], Light { position: v(4.0, 5.0, 6.0), colour: v(0.5, 0.25, 1.0) });
    assert_eq!(scene.materials[0], Material::from_nff(v(1.0, 0.5, 0.0), 0.5, 0.25, 10.0, 0.0, 0.0));
    assert_eq!(scene.materials[1], Material::from_nff(DVec3::ONE, 1.0, 0.0, 5.0, 0.5, 1.5));
    assert_eq!(scene.spheres, [Sphere { centre: v(1.0, 2.0, 3.0), radius: -0.5, material: 0 }]);
    let cone = |base_radius, apex_radius| Cone {
        base: DVec3::ZERO,
        base_radius,
        apex: v(0.0, 0.0, 2.0),
        apex_radius,
        material: 0,
    };
    assert_eq!(scene.cones, [cone(1.0, 0.0), cone(-1.0, -2.0)]);
    let polygon = |first_vertex, vertex_count, first_normal| Polygon {
        first_vertex,
        vertex_count,
        first_normal,
        first_colour: None,
        material: 1,
    };
    assert_eq!(scene.polygons, [polygon(0, 4, None), polygon(4, 3, Some(0))]);
    assert_eq!(scene.corners(&scene.polygons[0])[3], v(1.0, 1.0, 0.0));
    assert_eq!((scene.file.as_deref(), scene.terminator), (Some(Path::new("x.nff")), Terminator::Hard));
    assert_eq!((&scene.polygon_lines[..], scene.warnings), (&[(0, 19)][..], Warnings::default()));
    assert_eq!(scene.normals, [DVec3::Z, v(0.0, 3.0, 4.0).normalize(), DVec3::X]);
}

#[test]
fn line_ends_and_byte_order_marks_of_other_systems_are_read() {
    for end in ["\r\n", "\r"] {
        let other = format!("\u{feff}{}", EVERYTHING.replace('\n', end));
        assert_eq!(read(other), read(EVERYTHING));
    }
    assert_eq!(read(EVERYTHING.trim_end()), read(EVERYTHING));
}

#[test]
fn without_entities_there_are_defaults() {
    assert_eq!(read("b 0 0 1").map(|scene| scene.background), Ok(DVec3::Z));
    let scene = read("s 0 0 0 1#one\nf 1 0 0 1 0 1 0 1 s 1 1 1 1").expect("valid");
    assert_eq!(scene.materials[0], Material::WHITE);
    assert_eq!((scene.spheres[0].material, scene.spheres[1].material), (0, 1));
}

#[test]
fn mistakes_are_told_with_their_place() {
    let table: &[(&[u8], &str)] = &[
        (b"", "1:1: the file ends here, expected v, b, l, f, s, c, p, pp or #"),
        (b"# only a comment\n", "2:1: the file ends here, expected v, b, l, f, s, c, p, pp or #"),
        (b"x 1", "1:1: \"x\", expected v, b, l, f, s, c, p, pp or #"),
        (b"s 0 0 0 1 2", "1:11: \"2\", expected v, b, l, f, s, c, p, pp or #"),
        (b"\x7fELF\x02\x01\x01\0\0", "1:1: \"\\u{7f}ELF\\u{2}\\u{1}\\u{1}\", expected v, b, l, f, s, c, p, pp or #"),
        (b"s 0 0 \xff\xfe 1", "1:7: \"\\xff\\xfe\" is not a number, expected a coordinate from -1e30 to 1e30"),
        (b"s 0 0 \0 1", "1:7: \"\\0\" is not a number, expected a coordinate from -1e30 to 1e30"),
        (b"s 0 0 0", "1:8: the file ends here, expected a radius from -1e30 to 1e30"),
        (b"s nan 0 0 1", "1:3: \"nan\" is out of range, expected a coordinate from -1e30 to 1e30"),
        (b"s 0 -inf 0 1", "1:5: \"-inf\" is out of range, expected a coordinate from -1e30 to 1e30"),
        (b"s 0 1e400 0 1", "1:5: \"1e400\" is out of range, expected a coordinate from -1e30 to 1e30"),
        (b"s 0 2e30 0 1", "1:5: \"2e30\" is out of range, expected a coordinate from -1e30 to 1e30"),
        (b"s 0 0,5 0 1", "1:5: \"0,5\" is not a number, expected a coordinate from -1e30 to 1e30"),
        (b"p -3", "1:3: \"-3\", expected a polygon's vertex count, a whole number from 0 to 4294967295"),
        (b"p 3.5", "1:3: \"3.5\", expected a polygon's vertex count, a whole number from 0 to 4294967295"),
        (
            b"p 4000000000\n0 0 0\n",
            "1:3: \"4000000000\" vertices are too many, expected at most the 1 that the rest of the file can hold",
        ),
        (
            b"p 99999999999",
            "1:3: \"99999999999\", expected a polygon's vertex count, a whole number from 0 to 4294967295",
        ),
        (b"p 3\n0.5 0.5 0\n1 0 0\n0 1 ", "4:5: the file ends here, expected a coordinate from -1e30 to 1e30"),
        (
            b"c\n0 0 0 1\n0 0 1 -1",
            "3:7: \"-1\" is an apex radius of the other sign, expected both positive or both negative",
        ),
        (b"l 0 0", "1:6: the file ends here, expected a coordinate from -1e30 to 1e30"),
        (b"l 0 0 0 1\ns 0 0 0 1", "2:1: \"s\" is not a number, expected a colour's component from 0 to 1e6"),
        (b"v\nfrom 1 0 0\nat 0 0 0\nangle 45\n", "1:1: \"v\": the view has no `up`, expected from, at, up and angle"),
    ];
    for (text, expected) in table {
        let error = read(*text).expect_err("malformed");
        assert_eq!(error, format!("x.nff:{expected}"), "{}", text.escape_ascii());
    }
}

#[test]
fn impossible_views_are_told_with_their_place() {
    for (right, wrong, expected) in [
        ("at 0 0 0", "at 0 -5 1", "3:1: \"v\": from and at are the same point, expected two"),
        ("up 0 0 1", "up 0 5 -1", "3:1: \"v\": up is along the view direction, expected it to point aside"),
        ("up 0 0 1", "up 0 0 0", "3:1: \"v\": up has no direction, expected a vector longer than 0"),
        ("up 0 0 1\n", "", "3:1: \"v\": the view has no `up`, expected from, at, up and angle"),
        ("angle 40", "angle 180", "7:7: \"180\" is out of range, expected an angle between 0 and 180"),
        ("angle 40", "angle -1", "7:7: \"-1\" is out of range, expected an angle in degrees from 0 to 180"),
        ("320 240", "320 x", "9:16: \"x\" is not a number, expected a side in pixels from 1 to 65536"),
        ("320 240", "320 x", "9:16: \"x\" is not a number, expected a side in pixels from 1 to 65536"),
    ] {
        let error = read(EVERYTHING.replace(right, wrong)).expect_err("malformed");
        assert_eq!(error, format!("x.nff:{expected}"));
    }
}

/// A file with a good view, and warnings of what follows from line 7 on.
#[track_caller]
fn repaired(tail: &str, expected: &[(&str, &str)]) -> Scene {
    let view = "v\nfrom 0 -5 1\nat 0 0 0\nup 0 0 1\nangle 40\nhither 0\n";
    let scene = read(format!("{view}{tail}")).expect("repaired");
    let shown: Vec<_> = scene.warnings.all().iter().map(|w| (w.kind.as_str(), w.to_string())).collect();
    let expected: Vec<_> = expected.iter().map(|(kind, text)| (*kind, format!("x.nff:{text}"))).collect();
    assert_eq!(shown, expected, "{tail}");
    assert_eq!(scene.camera.map(|camera| camera.from), Some(DVec3::new(0.0, -5.0, 1.0)));
    scene
}

#[test]
fn surfaces_that_cannot_be_seen_are_left_out() {
    for (tail, kind, text) in [
        (
            "s 0 0 0 0\ns 1 1 1 -0",
            "sphere-without-radius",
            "7:9: \"0\" is no radius, expected one other than 0: the sphere is left out (and 1 more)",
        ),
        (
            "c 0 0 0 1 0 0 0 2",
            "cone-without-surface",
            "7:1: \"c\" without height, expected an apex away from the base: the cone is left out",
        ),
        (
            "c 0 0 0 0 0 0 1 0",
            "cone-without-surface",
            "7:17: \"0\" is the second radius that is 0, expected at most one: the cone is left out",
        ),
        (
            "p 2\n1 1 1\n2 2 2",
            "short-face",
            "7:3: \"2\" vertices are too few, expected at least 3: the polygon is left out",
        ),
        (
            "p 0 pp 1\n1 1 1 0 0 1",
            "short-face",
            "7:3: \"0\" vertices are too few, expected at least 3: the polygon is left out (and 1 more)",
        ),
    ] {
        let scene = repaired(&format!("{tail}\npp 3 0 0 0 0 0 1\n1 0 0 0 0 1 0 1 0 0 0 1"), &[(kind, text)]);
        assert_eq!((scene.primitive_count(), scene.vertices.len()), (1, 3), "{tail}");
        assert_eq!((scene.polygons[0].first_normal, scene.normals.len()), (Some(0), 3), "{tail}");
    }
}

#[test]
fn normals_without_a_direction_make_a_polygon_flat() {
    let good = "pp 3\n0 0 0 0 0 1\n1 0 0 0 0 1\n0 1 0 0 0 1\n";
    let tail = format!("{good}pp 3\n0 0 0 0 0 1\n1 0 0 0 0 0\n0 1 0 -0 0 0\n{good}");
    let text =
        "13:7: \"0\" starts a normal without a direction, expected one longer than 0: the polygon is flat (and 1 more)";
    let scene = repaired(&tail, &[("zero-normal", text)]);
    let first_normals: Vec<_> = scene.polygons.iter().map(|polygon| polygon.first_normal).collect();
    assert_eq!((&first_normals[..], scene.normals.len()), (&[Some(0), None, Some(3)][..], 6));
}

#[test]
fn values_out_of_range_are_clamped() {
    let material = |kd, ks, shine, t, ior| Material::from_nff(DVec3::ONE, kd, ks, shine, t, ior);
    for (tail, kind, text, expected) in [
        (
            "f 1 1 1 -1 0 1 0 1",
            "out-of-range",
            "7:9: \"-1\" is out of range, expected Kd from 0 to 1e6: 0 is used",
            material(0.0, 0.0, 1.0, 0.0, 1.0),
        ),
        (
            "f 1 1 1 1 -0.1 1 0 1",
            "out-of-range",
            "7:11: \"-0.1\" is out of range, expected Ks from 0 to 1e6: 0 is used",
            material(1.0, 0.0, 1.0, 0.0, 1.0),
        ),
        (
            "f 1 1 1 1 0 -5 1.5 1",
            "out-of-range",
            "7:13: \"-5\" is out of range, expected shine from 0 to 1e9: 0 is used (and 1 more)",
            material(1.0, 0.0, 0.0, 1.0, 1.0),
        ),
        (
            "f 1 1 1 1 0 1 0.5 0",
            "refractive-index",
            "7:19: \"0\" is no index of refraction where T is above 0, expected one above 0: 1 is used",
            material(1.0, 0.0, 1.0, 0.5, 1.0),
        ),
        (
            "f 1 1 1 1 0 1 0 -1",
            "out-of-range",
            "7:17: \"-1\" is out of range, expected an index of refraction from 0 to 1e6: 0 is used",
            material(1.0, 0.0, 1.0, 0.0, 0.0),
        ),
    ] {
        assert_eq!(repaired(tail, &[(kind, text)]).materials, [expected], "{tail}");
    }
    let text = "7:5: \"-1\" is out of range, expected a colour's component from 0 to 1e6: 0 is used (and 2 more)";
    let scene = repaired("b 1 -1 0\nl 0 0 0 1 2e6 -3", &[("out-of-range", text)]);
    assert_eq!((scene.background, scene.lights[0].colour), (DVec3::X, DVec3::new(1.0, 1e6, 0.0)));
}

#[test]
fn views_and_lights_too_many_are_left_out() {
    let second = "v from 1 2 3 at 1 2 3 up 0 0 0 angle 20";
    let scene = repaired(second, &[("second-view", "7:1: \"v\" is a second view, expected one: the first counts")]);
    assert_eq!(scene.camera.map(|camera| camera.angle_degrees), Some(40.0));
    for (resolution, words) in
        [("0 240", "7:12: \"0\""), ("320 65537", "7:16: \"65537\""), ("320 24.5", "7:16: \"24.5\"")]
    {
        let text =
            format!("{words}, expected a side in pixels from 1 to 65536, a whole number: the resolution is left out");
        let scene = repaired(&format!("resolution {resolution}"), &[("resolution", &text)]);
        assert_eq!(scene.camera.map(|camera| camera.resolution), Some(None), "{resolution}");
    }
    let text = "4103:1: \"l\" is one too many, expected at most 4096 lights: it is left out (and 1 more)";
    let scene = repaired(&"l 0 0 0\n".repeat(LIGHTS_MAX + 2), &[("too-many-lights", text)]);
    assert_eq!(scene.lights, [Light { position: DVec3::ZERO, colour: DVec3::splat(1.0 / 64.0) }; LIGHTS_MAX]);
}

#[test]
fn bytes_behind_the_end_are_ignored() {
    for (end, count) in [("\u{1a}", 1), ("\n\0\0", 2)] {
        let place = if count == 1 { "7:10" } else { "8:1" };
        let text = format!("{place}: the file ends in NUL or ^Z ({count} of them), expected text: they are ignored");
        assert_eq!(repaired(&format!("s 0 0 0 1{end}"), &[("stray-end", &text)]).spheres.len(), 1);
    }
    assert!(read("s 0 0 \u{1a} 1").is_err());
}

proptest! {
    #[test]
    fn arbitrary_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let _ = read(bytes);
    }

    #[test]
    fn a_damaged_file_is_read_or_refused(
        cut in 0..=EVERYTHING.len(),
        at in prop::collection::vec((0..EVERYTHING.len(), prop::sample::select(b"0-19e. \n#pcsvlfb\xff".to_vec())), 0..6),
    ) {
        let mut bytes = EVERYTHING.as_bytes().to_vec();
        for (place, byte) in at {
            bytes[place] = byte;
        }
        bytes.truncate(cut);
        if let Ok(scene) = read(bytes) {
            prop_assert!(scene.vertices.iter().chain(&scene.normals).all(|v| v.is_finite()));
            prop_assert!(scene.polygons.iter().all(|p| (p.material as usize) < scene.materials.len()));
        }
    }
}
