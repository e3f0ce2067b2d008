use std::fs;

use glam::DVec3;
use proptest::prelude::*;

use super::libraries::Spelling;
use super::*;
use crate::picture::Terminator;
use crate::scene::{Material, Polygon, Warnings};

/// Reads an OBJ file beside libraries, which are in no folder.
fn read_with(obj: impl Into<Vec<u8>>, libraries: &[(&str, &[u8])]) -> Result<Scene, String> {
    let library = |name: &[u8], spelling| {
        let is_this = |file: &str| match spelling {
            Spelling::Exact => file.as_bytes() == name,
            Spelling::AnyCase => file.as_bytes().eq_ignore_ascii_case(name),
        };
        let (file, bytes) = libraries.iter().find(|(file, _)| is_this(file))?;
        Some(Ok(Source { is_quoted: false, ..Source::from_bytes(file, *bytes) }))
    };
    reader::read(&Source::from_bytes("x.obj", obj), library).map_err(|error| error.to_string())
}

fn read(obj: impl Into<Vec<u8>>, mtl: impl AsRef<[u8]>) -> Result<Scene, String> {
    read_with(obj, &[("x.mtl", mtl.as_ref())])
}

/// Kind, and the warning as it is shown.
fn shown(warnings: &Warnings) -> Vec<(&str, String)> {
    warnings.all().iter().map(|warning| (warning.kind.as_str(), warning.to_string())).collect()
}

const MTL: &str = "\
# Two materials.
newmtl red
Ka 0 0 0
Kd 1 0.25 0
Ks 0.5
Ns 20
illum 1

newmtl clear glass
  Kd 0 0 0
\tKs 0.5 0.5 0.5
Ni 1.5
Ns 40
d 0.25
illum 7
";

const OBJ: &str = "\
mtllib x.mtl
o house
v 0 0 0
v 1 0 0 1.0
v 1 1 0
v 0.5 2 0 # the gable
v 0 1 0
vt 0.5 0.5
vn 0 0 2
vn 0 3 4
g wall
s off
f 1 2 3 \\
  4 5
  usemtl red
f 1/1 2/1 3/1
usemtl\tclear glass
f -5//1 -4//-1 -3/1/2 -1//1
usemtl red
f 3 4\\
 5
";

/// Four corners of a square, one unit normal, and what follows from line 6 on.
fn square(tail: &str) -> String {
    format!("v 0 0 0\nv 2 0 0\nv 2 2 0\nv 0 2 0\nvn 0 0 1\n{tail}\n")
}

const FLAT: Polygon = Polygon { first_vertex: 0, vertex_count: 4, first_normal: None, first_colour: None, material: 0 };

#[test]
fn faces_materials_and_normals_are_read() {
    let scene = read(OBJ, MTL).expect("valid");
    assert_eq!(scene.warnings, Warnings::default());
    assert!(scene.camera.is_none() && scene.lights.is_empty());
    assert_eq!((scene.file.as_deref(), scene.terminator), (Some(Path::new("x.obj")), Terminator::Soft));
    let polygon = |first_vertex, vertex_count, first_normal, material| Polygon {
        first_vertex,
        vertex_count,
        first_normal,
        first_colour: None,
        material,
    };
    let expected = [polygon(0, 5, None, 2), polygon(5, 3, None, 0), polygon(8, 4, Some(0), 1), polygon(12, 3, None, 0)];
    assert_eq!(scene.polygons, expected);
    assert_eq!(scene.polygon_lines, [(0, 13), (2, 18)]);
    let v = DVec3::new;
    assert_eq!(scene.vertices[3], v(0.5, 2.0, 0.0));
    assert_eq!(scene.vertices[8..12], [v(0.0, 0.0, 0.0), v(1.0, 0.0, 0.0), v(1.0, 1.0, 0.0), v(0.0, 1.0, 0.0)]);
    assert_eq!(scene.normals, [DVec3::Z, v(0.0, 3.0, 4.0).normalize(), v(0.0, 3.0, 4.0).normalize(), DVec3::Z]);
    let [red, glass, white] = scene.materials[..] else { panic!("three materials") };
    assert_eq!(white, Material::WHITE);
    assert_eq!((red.diffuse, red.highlight, red.reflection), (v(1.0, 0.25, 0.0), DVec3::ZERO, DVec3::ZERO));
    assert_eq!((red.shine, red.transmittance, red.shadow_transmittance), (20.0, 0.0, 0.0));
    assert_eq!((glass.highlight, glass.reflection), (DVec3::splat(0.5), DVec3::splat(0.5)));
    assert_eq!((glass.transmittance, glass.ior), (0.75, 1.5));
}

#[test]
fn coordinates_keep_their_precision_and_may_have_any_form() {
    let scene = read("v 1234567.123456789 0 0\nv 1. +1 .5\nv -1e-3 1E5 -0\nf 1 2 3\n", "").expect("valid");
    assert_eq!(scene.vertices[0].x, 1_234_567.123_456_789);
    assert_eq!(scene.vertices[1..], [DVec3::new(1.0, 1.0, 0.5), DVec3::new(-0.001, 1e5, 0.0)]);
    assert_eq!(scene.materials, [Material::WHITE]);
}

#[test]
fn line_ends_of_all_systems_mean_the_same() {
    let expected = read(OBJ, MTL).expect("valid");
    for end in ["\r\n", "\r"] {
        let (obj, mtl) = (OBJ.replace('\n', end), MTL.replace('\n', end));
        assert_eq!(read(obj, mtl).as_ref(), Ok(&expected), "{}", end.escape_debug());
    }
    let mixed = OBJ.replacen('\n', "\r", 4).replacen("f 1", "\r\nf 1", 1);
    assert_eq!(read(mixed, MTL).map(|scene| scene.polygon_lines), Ok(vec![(0, 14), (2, 19)]));
    let error = read("v 0 0 0\r\rv 1 2 x\r", "").expect_err("malformed");
    assert_eq!(error, "x.obj:3:7: \"x\" is not a number, expected a coordinate from -1e30 to 1e30");
}

#[test]
fn what_changes_the_geometry_is_an_error_with_its_place() {
    let table = [
        ("v 1 2", "6: the line ends here, expected a coordinate from -1e30 to 1e30"),
        ("v 1 x 2", "5: \"x\" is not a number, expected a coordinate from -1e30 to 1e30"),
        ("v 1 1,5 2", "5: \"1,5\" is not a number, expected a coordinate from -1e30 to 1e30"),
        ("v 1 NaN 2", "5: \"NaN\" is out of range, expected a coordinate from -1e30 to 1e30"),
        ("v 1 2 inf", "7: \"inf\" is out of range, expected a coordinate from -1e30 to 1e30"),
        ("v 1 2 -1.#IND", "7: \"-1.#IND\" is not a number, expected a coordinate from -1e30 to 1e30"),
        (
            "v 1 2 3 0",
            "9: \"0\" is a weight that the coordinates cannot be divided by, expected one that leaves a coordinate from -1e30 to 1e30",
        ),
        (
            "v 1e29 2 3 0.01",
            "12: \"0.01\" is a weight that the coordinates cannot be divided by, expected one that leaves a coordinate from -1e30 to 1e30",
        ),
        ("v 1 2 3 w", "9: \"w\" is not a number, expected a weight from -1e30 to 1e30"),
        ("f 1 2 5", "7: \"5\" names vertex 5, expected one of the 4 defined so far"),
        ("f 1 2 0", "7: \"0\" names vertex 0, expected one of the 4 defined so far"),
        ("f -5 2 3 4", "3: \"-5\" names vertex -5, expected one of the 4 defined so far"),
        (
            "f -9223372036854775808 2 3",
            "3: \"-9223372036854775808\" names vertex -9223372036854775808, expected one of the 4 defined so far",
        ),
        ("f 1/1 2/1 9/1", "11: \"9/1\" names vertex 9, expected one of the 4 defined so far"),
        ("f //1 2 3", "3: \"//1\", expected a corner like 1, 1/2, 1//3 or 1/2/3"),
        ("f a b c", "3: \"a\", expected a corner like 1, 1/2, 1//3 or 1/2/3"),
        ("f 1 2 3.0", "7: \"3.0\", expected a corner like 1, 1/2, 1//3 or 1/2/3"),
    ];
    for (line, expected) in table {
        assert_eq!(read(square(line), ""), Err(format!("x.obj:6:{expected}")), "{line}");
    }
    assert_eq!(read(b"\xff\xfev\0".to_vec(), ""), Err("x.obj: is UTF-16, expected ASCII or UTF-8".into()));
}

/// The warnings of one statement after [`square`], and the scene.
#[track_caller]
fn repaired(tail: &str, expected: &[(&str, &str)]) -> Scene {
    let scene = read_with(square(tail), &[]).expect("repaired");
    let expected: Vec<_> = expected.iter().map(|(kind, text)| (*kind, format!("x.obj:{text}"))).collect();
    assert_eq!(shown(&scene.warnings), expected, "{tail}");
    scene
}

#[test]
fn statements_without_effect_are_named_once_per_kind() {
    let table: &[(&str, &[(&str, &str)])] = &[
        ("g a\no b\ng\nvt\nvt x y\ns 1\ns off\ns 0", &[]),
        (
            "vw 1\nf 1 2 3 4\nhello\n\u{1}",
            &[("unknown-keyword", "6:1: \"vw\" starts no statement of OBJ: its line is ignored (and 2 more)")],
        ),
        (
            "caf\u{e9} 1",
            &[("unknown-keyword", "6:1: \"caf\\xc3\\xa9\" starts no statement of OBJ: its line is ignored")],
        ),
        ("l 1 2 \\\n3\nl 1/1 2/2", &[("lines", "6:1: \"l\": lines are not drawn (and 1 more)")]),
        ("p 1", &[("points", "6:1: \"p\": points are not drawn")]),
        (
            "cstype bezier\ndeg 3\ncurv 0 1 1 2 \\\n3 4\nparm u 0 1\nend",
            &[(
                "free-form",
                "6:1: \"cstype\": free-form curves and surfaces are not drawn, expected faces (and 4 more)",
            )],
        ),
        (
            "bevel off\nlod 0\nc_interp on",
            &[("display-attribute", "8:1: \"c_interp\": this display attribute has no effect")],
        ),
        (
            "shadow_obj a.obj\ntrace_obj b.obj",
            &[(
                "shadow-object",
                "6:1: \"shadow_obj\": other objects for shadows or reflections are not read: the scene's own are seen in them (and 1 more)",
            )],
        ),
        (
            "call a.obj",
            &[("call", "6:1: \"call\": other files and commands are not called: what they would give is missing")],
        ),
        ("usemap wood\nusemap off", &[("texture-map", "6:1: \"usemap\": textures are not drawn, the colour alone is")]),
        ("p 1\nl 1 2", &[("points", "6:1: \"p\": points are not drawn"), ("lines", "7:1: \"l\": lines are not drawn")]),
    ];
    for (tail, expected) in table {
        let scene = repaired(tail, expected);
        assert_eq!(scene.polygons.len(), usize::from(tail.contains("\nf ")), "{tail}");
    }
}

#[test]
fn keywords_in_capitals_are_read() {
    let scene = read("V 0 0 0\nV 1 0 0\nV 0 1 0\nF 1 2 3\nL 1 2\n", "").expect("valid");
    assert_eq!((scene.vertices.len(), scene.polygons.len()), (3, 1));
    let expected = [
        ("keyword-case", "x.obj:1:1: \"V\", expected lower case: is read as \"v\" (and 4 more)".into()),
        ("lines", "x.obj:5:1: \"l\": lines are not drawn".into()),
    ];
    assert_eq!(shown(&scene.warnings), expected);
}

#[test]
fn bytes_behind_the_end_are_ignored() {
    for (end, what) in [("\u{1a}", "1 bytes"), ("\0\0\0", "3 bytes"), (" \u{1a}\r\n", "3 bytes")] {
        let scene = read(format!("{OBJ}{end}"), MTL).expect("valid");
        let place = if end.starts_with(' ') { "22:2" } else { "22:1" };
        let text = format!("x.obj:{place}: the file ends in NUL or ^Z, expected text: the last {what} are ignored");
        assert_eq!(shown(&scene.warnings), [("stray-end", text)]);
        assert_eq!(scene.polygons.len(), 4);
    }
}

#[test]
fn faces_of_fewer_than_three_corners_are_left_out() {
    let short = |text| [("short-face", text)];
    for (tail, text, polygons) in [
        ("f 1 2\nf 1 2 3 4", "6:1: \"f\" with 2 corners, expected at least 3: the face is left out", 1),
        ("f\nfo 1//1", "6:1: \"f\" with 0 corners, expected at least 3: the face is left out (and 1 more)", 0),
        ("f 9 x", "6:1: \"f\" with 2 corners, expected at least 3: the face is left out", 0),
    ] {
        assert_eq!(repaired(tail, &short(text)).polygons.len(), polygons);
    }
}

#[test]
fn normals_that_are_of_no_use_are_left_out() {
    let absent = "names a normal that is not there, expected one of the";
    let table: &[(&str, &[(&str, &str)])] = &[
        // Unused ones, and a good one beside.
        (
            "vn 0 0 0\nf 1 2 3 4",
            &[("zero-normal", "6:1: \"vn\" without a direction, expected a normal longer than 0: faces do without it")],
        ),
        (
            "vn 0 0 0\nf 1//2 2//1 3//1 4//1",
            &[("zero-normal", "6:1: \"vn\" without a direction, expected a normal longer than 0: faces do without it")],
        ),
        (
            "vn 0 nan 1\nf 1//2 2//2 3//2 4//2",
            &[(
                "bad-normal",
                "6:6: \"nan\" is out of range, expected a normal's component from -1e30 to 1e30: faces do without this normal",
            )],
        ),
        (
            "vn 0 1\nf 1//2 2//2 3//2 4//2",
            &[(
                "bad-normal",
                "6:7: the line ends here, expected a normal's component from -1e30 to 1e30: faces do without this normal",
            )],
        ),
        (
            "f 1//1 2//2 3//1 4//-3",
            &[(
                "normal-index",
                &format!("6:8: \"2//2\" {absent} 1 defined so far: the face does without (and 1 more)"),
            )],
        ),
        (
            "f 1//x 2//1 3//1 4//1",
            &[("normal-index", &format!("6:3: \"1//x\" {absent} 1 defined so far: the face does without"))],
        ),
        (
            "f 1//1 2//1 3//1 4",
            &[(
                "mixed-normals",
                "6:1: \"f\" with normals at some corners, expected all or none: the face does without",
            )],
        ),
        (
            "f 1 2/7 3 4/7/1",
            &[(
                "mixed-normals",
                "6:1: \"f\" with normals at some corners, expected all or none: the face does without",
            )],
        ),
        // Texture coordinates are not read, so none has to be there.
        ("f 1/1 2/-7 3/99 4/0", &[]),
        (
            "f 1/a 2 3 4",
            &[(
                "odd-corner",
                "6:3: \"1/a\" names no texture coordinate, expected a corner like 1/2 or 1/2/3: that part is ignored",
            )],
        ),
        (
            "f 1/ 2// 3 4///1",
            &[(
                "odd-corner",
                "6:12: \"4///1\" has more than three parts, expected a corner like 1/2/3: the others are ignored",
            )],
        ),
    ];
    for (tail, expected) in table {
        let scene = repaired(tail, expected);
        assert_eq!((&scene.polygons[..], scene.normals.len()), (&[FLAT][..], 0), "{tail}");
    }
    let text = "6:10: \"7\" after a normal, expected the end of the line: is ignored";
    let scene = repaired("vn 0 2 0 7\nf 1//2 2//2 3//2 4//2", &[("bad-normal", text)]);
    assert_eq!((scene.polygons[0].first_normal, &scene.normals[..]), (Some(0), &[DVec3::Y; 4][..]));
}

#[test]
fn weights_divide_and_colours_are_read() {
    let scene = read("v 2 4 6 2\nv 1 0 0 1\nv 0 -1 0 -1\nf 1 2 3", "").expect("valid");
    assert_eq!(scene.vertices, [DVec3::new(1.0, 2.0, 3.0), DVec3::X, DVec3::Y]);
    assert_eq!((scene.colours.len(), scene.warnings), (0, Warnings::default()));

    let corners = "v 0 0 0\nv 1 0 0 1 0 0\nv 1 1 0 0 .5 0\nv 0 1 0\nv 0 2 0\n";
    let scene = read(format!("{corners}f 1 2 3\nf 1 4 5\nf 5 4 2"), "").expect("valid");
    let colours = [DVec3::ONE, DVec3::X, DVec3::Y * 0.5, DVec3::ONE, DVec3::ONE, DVec3::X];
    assert_eq!((&scene.colours[..], &scene.warnings), (&colours[..], &Warnings::default()));
    assert_eq!(scene.polygons.iter().map(|polygon| polygon.first_colour).collect::<Vec<_>>(), [Some(0), None, Some(3)]);
    assert_eq!(scene.corner_colours(&scene.polygons[2]), Some(&colours[3..]));
}

#[test]
fn odd_words_after_coordinates_are_repaired() {
    let range = "expected a vertex's colour from 0 to 1";
    for (words, kind, text, colour) in [
        (
            "1.5 0 -1",
            "vertex-colour",
            format!(
                "5:9: \"1.5\" is out of range, {range}: it is clamped; colours from 0 to 255 have to be divided by 255 (and 1 more)"
            ),
            Some(DVec3::X),
        ),
        (
            "0 -0.1 1",
            "vertex-colour",
            format!("5:11: \"-0.1\" is out of range, {range}: it is clamped"),
            Some(DVec3::Z),
        ),
        (
            "0 1 300",
            "vertex-colour",
            format!("5:13: \"300\" is out of range, {range}: it is clamped"),
            Some(DVec3::new(0.0, 1.0, 1.0)),
        ),
        ("0 nan 1", "vertex-colour", format!("5:11: \"nan\" is not a number, {range}: the vertex has none"), None),
        ("1 0 0 0.5", "vertex-alpha", "5:15: \"0.5\" is a vertex's alpha: it is left out".into(), Some(DVec3::X)),
        (
            "1 0 0 1 2 3",
            "odd-vertex",
            "5:17: \"2\" after a vertex's colour, expected the end of the line: is ignored".into(),
            Some(DVec3::X),
        ),
        (
            "1 0",
            "odd-vertex",
            "5:9: \"1\" and another word after the coordinates, expected a weight or a colour: both are ignored".into(),
            None,
        ),
    ] {
        let obj = format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nv 0 0 1 {words}\nf 1 2 4");
        let scene = read(obj, "").expect("repaired");
        assert_eq!(shown(&scene.warnings), [(kind, format!("x.obj:{text}"))]);
        assert_eq!(scene.vertices[5], DVec3::Z);
        let expected: Vec<DVec3> = colour.map_or(vec![], |colour| vec![DVec3::ONE, DVec3::ONE, colour]);
        assert_eq!(scene.colours, expected, "{words}");
    }
}

/// A roof of two squares that meet at a right angle in the edge of vertices 2 and 3, y up.
const ROOF: &str = "v -1 0 0\nv -1 0 1\nv 0 1 1\nv 0 1 0\nv 1 0 1\nv 1 0 0\n";

#[test]
fn faces_of_a_smoothing_group_share_normals() {
    let slope = DVec3::new(-1.0, 1.0, 0.0).normalize();
    let other = DVec3::new(1.0, 1.0, 0.0).normalize();
    let scene = read(format!("{ROOF}s 1\nf 1 2 3 4\nf 3 5 6 4"), "").expect("valid");
    assert_eq!(scene.warnings, Warnings::default());
    let is_near = |normals: &[DVec3], expected: [DVec3; 4]| {
        normals.iter().zip(expected).all(|(normal, expected)| (*normal - expected).length() < 1e-15)
    };
    let [left, right] = scene.polygons[..] else { panic!("two polygons") };
    let normals = |polygon| scene.corner_normals(polygon).expect("smooth");
    assert!(is_near(normals(&left), [slope, slope, DVec3::Y, DVec3::Y]), "{:?}", scene.normals);
    assert!(is_near(normals(&right), [DVec3::Y, other, other, DVec3::Y]), "{:?}", scene.normals);

    // Other groups, and faces of none, keep their edge; a group may go on later.
    for groups in [["s 1", "s 2"], ["s 1", "s off"], ["s 1", "s 0"], ["s 4294967295", "s 3"]] {
        let obj = format!("{ROOF}{}\nf 1 2 3 4\n{}\nf 3 5 6 4", groups[0], groups[1]);
        let scene = read(obj, "").expect("valid");
        let normals = scene.corner_normals(&scene.polygons[0]).expect("smooth");
        assert!(is_near(normals, [slope; 4]), "{groups:?}");
        assert_eq!(scene.polygons[1].first_normal.is_some(), !matches!(groups[1], "s off" | "s 0"), "{groups:?}");
    }
    let scene = read(format!("{ROOF}s 1\nf 1 2 3 4\ns 2\nf 1 2 3\ns 1\nf 3 5 6 4"), "").expect("valid");
    assert!(is_near(scene.corner_normals(&scene.polygons[2]).expect("smooth"), [DVec3::Y, other, other, DVec3::Y]));
}

#[test]
fn smoothing_weighs_by_angle_and_leaves_own_normals_alone() {
    // The right square as two triangles: the middle is as before, whatever the diagonal.
    for right in ["f 3 5 6\nf 3 6 4", "f 3 5 4\nf 5 6 4"] {
        let scene = read(format!("{ROOF}s 1\nf 1 2 3 4\n{right}"), "").expect("valid");
        let normals = scene.corner_normals(&scene.polygons[0]).expect("smooth");
        assert!((normals[2] - DVec3::Y).length() < 1e-15 && (normals[3] - DVec3::Y).length() < 1e-15, "{right}");
    }
    let own = read(format!("{ROOF}vn 0 0 5\ns 1\nf 1//1 2//1 3//1 4//1\nf 3 5 6 4"), "").expect("valid");
    assert_eq!(own.corner_normals(&own.polygons[0]), Some(&[DVec3::Z; 4][..]));
    let other = DVec3::new(1.0, 1.0, 0.0).normalize();
    let normals = own.corner_normals(&own.polygons[1]).expect("smooth");
    assert!(normals.iter().all(|normal| (*normal - other).length() < 1e-15), "the other's normals do not count");
}

#[test]
fn smoothing_that_gives_no_normal_is_flat() {
    // The same triangle from both sides; and one without area.
    let text = "the normals around a corner of this face cancel out in its smoothing group: the face is flat";
    let scene = repaired("s 3\nf 1 2 3\nf 3 2 1", &[("smoothing-cancels", &format!("7:1: {text} (and 1 more)"))]);
    assert!(scene.polygons.iter().all(|polygon| polygon.first_normal.is_none()) && scene.normals.is_empty());
    let scene = repaired("s 3\nf 1 2 1\nf 1 2 3 4", &[]);
    assert!(scene.normals.iter().all(|normal| *normal == DVec3::Z), "{:?}", scene.normals);
    for (group, place) in [("on", "6:3: \"on\""), ("-1", "6:3: \"-1\""), ("", "6:3: the line ends here")] {
        let text = "expected a smoothing group, a whole number from 0 to 4294967295, or off: is read as off";
        let scene = repaired(&format!("s {group}\nf 1 2 3 4"), &[("smoothing-group", &format!("{place}, {text}"))]);
        assert_eq!(scene.polygons, [FLAT], "{group}");
    }
}

/// The first component of the diffuse colour of the only polygon, and the warnings of the OBJ file.
fn red_of(mtllib: &str, usemtl: &str, libraries: &[(&str, &[u8])]) -> (f64, Vec<(String, String)>) {
    let obj = format!("{mtllib}\nv 0 0 0\nv 1 0 0\nv 0 1 0\n{usemtl}\nf 1 2 3");
    let scene = read_with(obj, libraries).expect("repaired");
    let warnings = scene.warnings.all().iter().map(|warning| (warning.kind.clone(), warning.to_string())).collect();
    (scene.materials[scene.polygons[0].material as usize].diffuse.x, warnings)
}

const RED: &[u8] = b"newmtl red\nKd 0.5";
const BLUE: &[u8] = b"newmtl blue\nKd 0.25";

#[test]
fn libraries_are_found_by_whatever_is_meant() {
    let table: &[(&str, &str, &[(&str, &[u8])], &[&str])] = &[
        ("mtllib a.mtl", "red", &[("a.mtl", RED)], &[]),
        ("mtllib my paint.mtl", "red", &[("my paint.mtl", RED)], &[]),
        ("mtllib a.mtl # paint", "red", &[("a.mtl", RED)], &[]),
        ("mtllib a #1.mtl", "red", &[("a #1.mtl", RED), ("a", BLUE)], &[]),
        ("mtllib b.mtl  a.mtl # paint", "red", &[("a.mtl", RED), ("b.mtl", BLUE)], &[]),
        ("mtllib b.mtl\nmtllib a.mtl", "red", &[("a.mtl", RED), ("b.mtl", BLUE)], &[]),
        (
            "mtllib c.mtl a.mtl",
            "red",
            &[("a.mtl", RED)],
            &["x.obj:1:8: \"c.mtl\": no such file, white is used for its materials"],
        ),
        (
            "mtllib s\\a.mtl",
            "red",
            &[("s/a.mtl", RED)],
            &["x.obj:1:8: \"s\\\\a.mtl\": no such file, \"s/a.mtl\" is read"],
        ),
        ("mtllib A.MTL", "red", &[("a.mtl", RED)], &["x.obj:1:8: \"A.MTL\": no such file, \"a.mtl\" is read"]),
        (
            "mtllib S\\A.mtl",
            "red",
            &[("s/a.mtl", RED)],
            &["x.obj:1:8: \"S\\\\A.mtl\": no such file, \"s/a.mtl\" is read"],
        ),
        (
            "mtllib C:\\My Models\\a.mtl",
            "red",
            &[("a.mtl", RED)],
            &["x.obj:1:8: \"C:\\\\My Models\\\\a.mtl\": no such file, \"a.mtl\" is read"],
        ),
        (
            "mtllib /home/a/my paint.mtl",
            "red",
            &[("My paint.mtl", RED), ("paint.mtl", BLUE)],
            &["x.obj:1:8: \"/home/a/my paint.mtl\": no such file, \"My paint.mtl\" is read"],
        ),
        (
            "mtllib s/a.mtl b.mtl",
            "red",
            &[("a.mtl", RED), ("b.mtl", BLUE)],
            &["x.obj:1:8: \"s/a.mtl\": no such file, \"a.mtl\" is read"],
        ),
        (
            "mtllib s/a.mtl s/b.mtl",
            "red",
            &[("a.mtl", RED), ("b.mtl", BLUE)],
            &["x.obj:1:8: \"s/a.mtl\": no such file, \"a.mtl\" is read (and 1 more)"],
        ),
        (
            "mtllib\nmtllib a.mtl",
            "red",
            &[("a.mtl", RED)],
            &["x.obj:1:1: \"mtllib\" without a name, expected a material library's: is ignored"],
        ),
    ];
    for (mtllib, name, libraries, expected) in table {
        let (red, warnings) = red_of(mtllib, &format!("usemtl {name}"), libraries);
        assert_eq!(warnings.iter().map(|(_, text)| text).collect::<Vec<_>>(), *expected, "{mtllib}");
        assert_eq!(red, 0.5, "{mtllib}");
    }
}

#[test]
fn what_is_not_there_is_white() {
    for (mtllib, usemtl, libraries, expected) in [
        ("", "usemtl wood", &[][..], vec![("undefined-material", "5:8: \"wood\": no such material, white is used")]),
        (
            "",
            "usemtl",
            &[],
            vec![("nameless-material", "5:1: \"usemtl\" without a name, expected a material's: white is used")],
        ),
        (
            "mtllib none.mtl",
            "usemtl wood\nf 1 2 3\nusemtl stone\nusemtl wood",
            &[],
            vec![
                ("missing-library", "1:8: \"none.mtl\": no such file, white is used for its materials"),
                ("undefined-material", "5:8: \"wood\": no such material, white is used (and 2 more)"),
            ],
        ),
        (
            "mtllib a.mtl",
            "usemtl RED",
            &[("a.mtl", RED)],
            vec![("undefined-material", "5:8: \"RED\": no such material, white is used")],
        ),
        (
            "mtllib a.mtl",
            "usemtl red#1",
            &[("a.mtl", RED)],
            vec![("undefined-material", "5:8: \"red#1\": no such material, white is used")],
        ),
    ] {
        let (red, warnings) = red_of(mtllib, usemtl, libraries);
        let expected: Vec<_> =
            expected.into_iter().map(|(kind, text)| (kind.into(), format!("x.obj:{text}"))).collect();
        assert_eq!((red, warnings), (1.0, expected), "{usemtl}");
    }
}

#[test]
fn names_of_materials_are_bytes_and_may_have_comments() {
    let latin = b"newmtl gr\xfcn\nKd 0.5".as_slice();
    for (name, library) in [
        (b"gr\xfcn".as_slice(), latin),
        (b"gr\xfcn # a comment", latin),
        (b"red # leaf", b"newmtl red # wood\nKd 0.5"),
        (b"red", b"newmtl red # wood\nKd 0.5"),
        (b"red # wood", b"newmtl red # wood\nKd 0.5\nnewmtl red\nKd 0"),
        (b"red #2", b"newmtl red\nKd 0.25\nnewmtl red #2\nKd 0.5"),
        (b"my red", b"newmtl my red\t\r\nKd 0.5"),
    ] {
        let obj = [b"mtllib x.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl ", name, b"\nf 1 2 3"].concat();
        let scene = read(obj, library).expect("valid");
        let material = scene.polygons[0].material as usize;
        assert_eq!(
            (scene.materials[material].diffuse.x, &scene.warnings),
            (0.5, &Warnings::default()),
            "{}",
            name.escape_ascii()
        );
    }
    let scene = read(b"usemtl \xff\x1b[2J\nv 0 0 0".to_vec(), "").expect("valid");
    let text = "x.obj:1:8: \"\\xff\\x1b[2J\": no such material, white is used";
    assert_eq!(shown(&scene.warnings), [("undefined-material", text.into())]);
}

#[test]
fn a_material_may_be_used_before_its_library_is_named_and_the_first_of_a_name_counts() {
    let obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\nf 3 2 1\nmtllib a.mtl\nmtllib b.mtl";
    let twice = b"newmtl red\nKd 0\nfoo\nnewmtl blue\nKd 1\nnewmtl blue\nKd 0\nnewmtl blue";
    let scene = read_with(obj, &[("a.mtl", RED), ("b.mtl", twice)]).expect("valid");
    assert_eq!(scene.materials.iter().map(|material| material.diffuse.x).collect::<Vec<_>>(), [0.5, 1.0]);
    assert!(scene.polygons.iter().all(|polygon| polygon.material == 0));
    let text = "b.mtl:1:1: newmtl of a name that is defined already: the first counts (and 2 more)";
    let word = "b.mtl:3:1: a word that starts no statement of MTL: its line is ignored";
    assert_eq!(shown(&scene.warnings), [("material-defined-twice", text.into()), ("unknown-keyword", word.into())]);
}

#[test]
fn libraries_on_disk_that_cannot_be_read_are_named() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("x.obj");
    fs::create_dir(folder.path().join("folder.mtl")).expect("a folder");
    fs::write(folder.path().join("Wood.MTL"), "newmtl wood\nKd 0 0 1\nsecret = 1").expect("a file");
    fs::write(&path, "mtllib none.mtl\nmtllib folder.mtl\nmtllib wood.mtl\nmtllib ./Wood.MTL\nmtllib wood.mtl\n")
        .expect("a file");
    let scene = load(&path).expect("a scene");
    let shown: Vec<String> = shown(&scene.warnings)
        .into_iter()
        .map(|(_, text)| text.replace(folder.path().to_str().expect("text"), "F"))
        .collect();
    let expected = [
        "F/x.obj:1:8: \"none.mtl\": no such file, white is used for its materials",
        "F/x.obj:2:8: \"folder.mtl\": is not a regular file, expected one: white is used for its materials",
        "F/x.obj:3:8: \"wood.mtl\": no such file, \"F/Wood.MTL\" is read",
        "F/Wood.MTL:3:1: a word that starts no statement of MTL: its line is ignored",
    ];
    // Once, though two paths lead to it.
    assert_eq!((shown, scene.materials.len()), (expected.map(String::from).to_vec(), 1));
    assert_eq!(scene.file.as_deref(), Some(path.as_path()));
}

#[test]
fn too_many_names_of_libraries_are_not_looked_for() {
    let looked_for = std::cell::Cell::new(0);
    let names: String = (0..3000).map(|i| format!("mtllib {i} a\n")).collect();
    let source = Source::from_bytes("x.obj", names);
    let scene = reader::read(&source, |_, _| {
        looked_for.set(looked_for.get() + 1);
        None
    });
    let warnings = scene.expect("a scene").warnings;
    assert_eq!(
        warnings.all().iter().map(|warning| (warning.kind.as_str(), warning.count)).collect::<Vec<_>>(),
        [("missing-library", 2048), ("too-many-libraries", 952)]
    );
    assert!(looked_for.get() < 4096 * 12, "{}", looked_for.get());
}

/// The only material of a library, and its warnings.
fn material(mtl: &str) -> (Material, Vec<(String, String)>) {
    let scene = read("mtllib x.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3", format!("newmtl m\n{mtl}\n"))
        .expect("valid");
    assert_eq!(scene.materials.len(), 1);
    (
        scene.materials[0],
        scene.warnings.all().iter().map(|warning| (warning.kind.clone(), warning.to_string())).collect(),
    )
}

#[test]
fn illumination_models_have_highlights_reflections_or_neither() {
    for (model, highlight, reflection) in [(0, 0.0, 0.0), (1, 0.0, 0.0), (2, 1.0, 0.0), (3, 1.0, 1.0), (7, 1.0, 1.0)] {
        let (material, warnings) = material(&format!("Ks 1 1 1\nNs 5\nillum {model}"));
        assert_eq!((material.highlight.x, material.reflection.x), (highlight, reflection), "illum {model}");
        assert_eq!(warnings, []);
    }
    // Ns 0 is no highlight, and so is none; reflections do not depend on it.
    for shine in ["", "Ns 0", "Ns 0.0"] {
        assert_eq!(material(&format!("Ks 1 1 1\n{shine}")).0, Material { shine: 0.0, ..Material::WHITE });
        let (mirror, warnings) = material(&format!("Ks 1 1 1\n{shine}\nillum 3"));
        assert_eq!((mirror.highlight, mirror.reflection, warnings), (DVec3::ZERO, DVec3::ONE, vec![]));
    }
}

#[test]
fn surfaces_that_dissolve_fade_and_those_that_refract_bend() {
    let paint = "Kd 1 1 1\nKs 0.5\nKe 4 2 0\nNs 9\nNi 1.5\nd 0.25\n";
    let (sheet, warnings) = material(&format!("{paint}illum 3"));
    let expected = Material {
        diffuse: DVec3::splat(0.25),
        highlight: DVec3::splat(0.125),
        reflection: DVec3::splat(0.125),
        emission: DVec3::new(1.0, 0.5, 0.0),
        shine: 9.0,
        transmittance: 0.75,
        ior: 1.0,
        shadow_transmittance: 0.75,
    };
    assert_eq!((sheet, warnings), (expected, vec![]), "of all models but 6 and 7");
    for model in [6, 7] {
        let (glass, warnings) = material(&format!("{paint}illum {model}"));
        let expected = Material {
            highlight: DVec3::splat(0.5),
            reflection: DVec3::splat(0.5),
            emission: DVec3::new(4.0, 2.0, 0.0),
            ior: 1.5,
            ..expected
        };
        assert_eq!((glass, warnings), (expected, vec![]), "illum {model}");
    }
    let (nothing, warnings) = material("Kd 0 0.8 0\nKs 1\nNs 3\nKe 1\nd 0");
    assert_eq!((nothing.diffuse, nothing.highlight, nothing.emission), (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO));
    assert_eq!((nothing.transmittance, nothing.shadow_transmittance, warnings), (1.0, 1.0, vec![]));
    assert_eq!(material("Tr 0.25").0.transmittance, 0.25);
    assert_eq!(material("Tr 0").0.transmittance, 0.0);
    assert_eq!(material("Tr 0.25\nd 0.75").1, [], "the two agree");
}

#[test]
fn opacity_and_refraction_that_contradict_are_repaired() {
    for (mtl, kind, text, transmittance, ior) in [
        (
            "Tr 1.000",
            "opaque-or-transparent",
            "2:1: Tr 1 without d is fully transparent in some files and opaque in others: it is read as opaque",
            0.0,
            1.0,
        ),
        (
            "Tr 0.25\nd 0.25",
            "opacity-twice",
            "2:1: Tr is not 1 - d of its material, expected that: d is used",
            0.75,
            1.0,
        ),
        ("d 1\nTr 1", "opacity-twice", "3:1: Tr is not 1 - d of its material, expected that: d is used", 0.0, 1.0),
        (
            "d 0.5\nillum 7",
            "refractive-index",
            "3:1: illum of refraction without Ni, expected an index of refraction: 1 is used",
            0.5,
            1.0,
        ),
        (
            "d 0.5\nillum 6\nNi 0",
            "refractive-index",
            "4:1: Ni is out of range, expected an index of refraction from 0.001 to 1e6: 1 is used",
            0.5,
            1.0,
        ),
        (
            "d -halo 0.5\nNi -3",
            "halo",
            "2:3: -halo: d does not depend on the direction, its number alone is used",
            0.5,
            1.0,
        ),
    ] {
        let (material, warnings) = material(mtl);
        assert_eq!(warnings, [(kind.into(), format!("x.mtl:{text}"))], "{mtl}");
        assert_eq!((material.transmittance, material.ior), (transmittance, ior), "{mtl}");
    }
}

#[test]
fn values_of_materials_are_clamped_or_left_out() {
    let grey = |value| Material { diffuse: DVec3::splat(value), ..Material::WHITE };
    let white = grey(1.0);
    let table: [(&str, &[(&str, &str)], Material); 17] = [
        ("Kd 0.5", &[], grey(0.5)),
        (
            "Kd 0.5 0.5",
            &[("bad-number", "2:11: the line ends here, expected Kd from 0 to 1e6: the statement is left out")],
            white,
        ),
        (
            "Kd",
            &[("bad-number", "2:3: the line ends here, expected Kd from 0 to 1e6: the statement is left out")],
            white,
        ),
        (
            "Kd -1 -2 -3",
            &[("out-of-range", "2:4: a word is out of range, expected Kd from 0 to 1e6: 0 is used (and 2 more)")],
            grey(0.0),
        ),
        (
            "Kd 1e9",
            &[("out-of-range", "2:4: a word is out of range, expected Kd from 0 to 1e6: 1e6 is used")],
            grey(1e6),
        ),
        (
            "Kd inf",
            &[("bad-number", "2:4: a word is out of range, expected Kd from 0 to 1e6: the statement is left out")],
            white,
        ),
        (
            "Kd .5 .5 .5 1",
            &[("extra-words", "2:13: a word too many, expected the end of the line: is ignored")],
            grey(0.5),
        ),
        (
            "Kd spectral sun.rfl 1",
            &[("colour-form", "2:1: Kd as a spectrum or in CIE XYZ, expected red, green and blue: white is used")],
            white,
        ),
        (
            "Ke xyz 1 1 1",
            &[("colour-form", "2:1: Ke as a spectrum or in CIE XYZ, expected red, green and blue: black is used")],
            white,
        ),
        ("d 1.000001", &[("out-of-range", "2:3: a word is out of range, expected d from 0 to 1: 1 is used")], white),
        ("Ns -0.0001", &[("out-of-range", "2:4: a word is out of range, expected Ns from 0 to 1e9: 0 is used")], white),
        (
            "Ns nan",
            &[("bad-number", "2:4: a word is out of range, expected Ns from 0 to 1e9: the statement is left out")],
            white,
        ),
        ("Ni 0\nNi 1e9", &[], white),
        (
            "Ni x",
            &[("bad-number", "2:4: a word is not a number, expected Ni from 0.001 to 1e6: the statement is left out")],
            white,
        ),
        (
            "illum 2.0",
            &[(
                "illumination-model",
                "2:7: an illumination model of odd form, expected a whole number from 0 to 10: 2 is used",
            )],
            white,
        ),
        (
            "illum 11\nillum 7",
            &[(
                "illumination-model",
                "2:7: an illumination model of odd form, expected a whole number from 0 to 10: 2 is used",
            )],
            white,
        ),
        (
            "illum glass",
            &[(
                "bad-number",
                "2:7: a word is not a number, expected an illumination model from 0 to 10: the statement is left out",
            )],
            white,
        ),
    ];
    for (mtl, expected, repaired) in table {
        let (material, warnings) = material(mtl);
        let expected: Vec<_> = expected.iter().map(|(kind, text)| ((*kind).into(), format!("x.mtl:{text}"))).collect();
        assert_eq!(warnings, expected, "{mtl}");
        assert_eq!(material, Material { shine: 0.0, ..repaired }, "{mtl}");
    }
}

#[test]
fn statements_of_materials_without_effect_are_named() {
    for (mtl, kind, text) in [
        ("map_Kd -s 1 1 1 stone.png", "texture-map", "map_Kd: textures are not drawn, the colour alone is"),
        ("map_d a.png\nbump b.png", "texture-map", "map_d: textures are not drawn, the colour alone is (and 1 more)"),
        ("norm a.png", "texture-map", "norm: textures are not drawn, the colour alone is"),
        ("disp a.png", "texture-map", "disp: textures are not drawn, the colour alone is"),
        ("refl -type sphere a.png", "texture-map", "refl: textures are not drawn, the colour alone is"),
        ("Ka 0.2 0.2 0.2", "ambient-colour", "Ka: there is no ambient light, it is ignored"),
        ("Ka spectral a.rfl", "ambient-colour", "Ka: there is no ambient light, it is ignored"),
        ("Tf 1 0.5 1", "transmission-filter", "Tf: what passes through is not coloured, it is ignored"),
        ("sharpness 60", "sharpness", "sharpness: reflections are always sharp, it is ignored"),
        (
            "Pr 0.5\nPm 1\naniso 0",
            "physically-based",
            "Pr: physically based materials are not drawn, it is ignored (and 2 more)",
        ),
        ("password hunter2", "unknown-keyword", "a word that starts no statement of MTL: its line is ignored"),
        ("root:x:0", "unknown-keyword", "a word that starts no statement of MTL: its line is ignored"),
        ("KD 1 1 1", "keyword-case", "a keyword in other letters is read as Kd"),
    ] {
        let expected = (kind.to_owned(), format!("x.mtl:2:1: {text}"));
        assert_eq!(material(mtl), (Material { shine: 0.0, ..Material::WHITE }, vec![expected]), "{mtl}");
    }
    assert_eq!(material("Ka 0 0.0 0\nTf 1.0 1 1\nKe 0 0 0\n# end").1, []);
}

#[test]
fn statements_of_no_material_are_ignored() {
    let scene = read("mtllib x.mtl", "Kd 1 1 1\nNi 2\nnewmtl\nKd 0 0 0\nnewmtl a\0\0").expect("valid");
    let expected = [
        ("stray-end", "5:9: the file ends in NUL or ^Z, expected text: the last 2 bytes are ignored"),
        ("outside-material", "1:1: Kd of no material, expected newmtl before it: is ignored (and 1 more)"),
        ("nameless-material", "3:1: newmtl without a name, expected a material's: it is left out"),
    ];
    assert_eq!(shown(&scene.warnings), expected.map(|(kind, text)| (kind, format!("x.mtl:{text}"))));
    assert_eq!(scene.materials.len(), 1);
}

proptest! {
    #[test]
    fn arbitrary_bytes_are_read_or_refused(
        obj in prop::collection::vec(any::<u8>(), 0..300),
        mtl in prop::collection::vec(any::<u8>(), 0..100),
    ) {
        let _ = read(obj, &mtl);
        prop_assert!(read("mtllib x.mtl", mtl).is_ok(), "a library is never an error");
    }

    #[test]
    fn a_damaged_file_is_read_or_refused(
        obj_bytes in prop::collection::vec((0..OBJ.len(), prop::sample::select(b"0-19/. \nvfnum#\\\r\xff".to_vec())), 0..6),
        mtl_bytes in prop::collection::vec((0..MTL.len(), prop::sample::select(b"0-19. \nKdsNi#\r\xff".to_vec())), 0..6),
        cut in 0..=OBJ.len(),
    ) {
        let (mut obj, mut mtl) = (OBJ.as_bytes().to_vec(), MTL.as_bytes().to_vec());
        obj_bytes.into_iter().for_each(|(place, byte)| obj[place] = byte);
        mtl_bytes.into_iter().for_each(|(place, byte)| mtl[place] = byte);
        obj.truncate(cut);
        if let Ok(scene) = read(obj, mtl) {
            let of = |list: usize, first: Option<u32>, p: &Polygon| first.is_none_or(|first| (first + p.vertex_count) as usize <= list);
            for p in &scene.polygons {
                prop_assert!(p.vertex_count >= 3 && (p.material as usize) < scene.materials.len());
                prop_assert!(of(scene.vertices.len(), Some(p.first_vertex), p));
                prop_assert!(of(scene.normals.len(), p.first_normal, p) && of(scene.colours.len(), p.first_colour, p));
            }
            prop_assert!(scene.vertices.iter().all(|v| v.is_finite()));
            prop_assert!(scene.normals.iter().all(|v| (v.length() - 1.0).abs() < 1e-9));
        }
    }

    /// What is said of a library shows no word of it that is no keyword.
    #[test]
    fn words_of_libraries_are_not_shown(mtl in "(newmtl |Kd |d |illum |map_|Ns )?[xyzqw]{9}( [xyzqw]{9})?\n?") {
        let text = format!("newmtl a\n{mtl}");
        for (_, shown) in shown(&read("mtllib x.mtl", text).expect("valid").warnings) {
            prop_assert!(!mtl.split([' ', '\n']).any(|word| word.len() >= 9 && shown.contains(word)), "{shown}");
        }
    }
}
