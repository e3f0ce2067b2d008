mod libraries;
mod materials;
mod smoothing;

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
    let error = read("v 0 0 0\r\rv 1 2 x\rf 1 1 2\r", "").expect_err("malformed");
    assert_eq!(error, "x.obj:3:7: \"x\" is not a number, expected a coordinate from -1e30 to 1e30");
}

#[test]
fn what_changes_the_geometry_is_an_error_with_its_place() {
    let table = [
        ("v 1 2\nf 1 2 5", "6: the line ends here, expected a coordinate from -1e30 to 1e30"),
        ("v 1 x 2\nf 1 2 5", "5: \"x\" is not a number, expected a coordinate from -1e30 to 1e30"),
        ("v 1 1,5 2\nf 1 2 5", "5: \"1,5\" is not a number, expected a coordinate from -1e30 to 1e30"),
        ("v 1 NaN 2\nf 1 2 5", "5: \"NaN\" is out of range, expected a coordinate from -1e30 to 1e30"),
        ("v 1 2 inf\nf 1 2 5", "7: \"inf\" is out of range, expected a coordinate from -1e30 to 1e30"),
        ("v 1 2 -1.#IND\nf 1 2 5", "7: \"-1.#IND\" is not a number, expected a coordinate from -1e30 to 1e30"),
        (
            "v 1 2 3 0\nf 1 2 5",
            "9: \"0\" is a weight that the coordinates cannot be divided by, expected one that leaves a coordinate from -1e30 to 1e30",
        ),
        (
            "v 1e29 2 3 0.01\nf 1 2 5",
            "12: \"0.01\" is a weight that the coordinates cannot be divided by, expected one that leaves a coordinate from -1e30 to 1e30",
        ),
        ("v 1 2 3 w\nf 1 2 5", "9: \"w\" is not a number, expected a weight from -1e30 to 1e30"),
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
}

#[test]
fn a_vertex_that_cannot_be_read_is_no_harm_where_no_face_uses_it() {
    for (statements, expected) in [
        (
            "v 1 2 3.1+e2",
            "6:7: \"3.1+e2\" is not a number, expected a coordinate from -1e30 to 1e30: no face uses this vertex",
        ),
        (
            "v 1 2 3 0\nv nan 0 0\nf 1 2 3",
            "6:9: \"0\" is a weight that the coordinates cannot be divided by, expected one that leaves a coordinate from -1e30 to 1e30: no face uses this vertex (and 1 more)",
        ),
        (
            "v\nv 1\nv",
            "6:2: the line ends here, expected a coordinate from -1e30 to 1e30: no face uses this vertex (and 2 more)",
        ),
    ] {
        let scene = read_with(square(statements), &[]).expect("repaired");
        assert_eq!(shown(&scene.warnings), [("unused-vertex", format!("x.obj:{expected}"))], "{statements}");
    }
    // The numbers of those after it are what they would be.
    let scene = read_with(square("v x 0 0\nv 2 2 2\nf 1 2 6"), &[]).expect("repaired");
    assert_eq!(scene.vertices.last(), Some(&DVec3::splat(2.0)));
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
        ("na\u{ef}ve 1", &[("unknown-keyword", "6:1: \"naïve\" starts no statement of OBJ: its line is ignored")]),
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
    for (end, what) in [("\u{1a}", 1), ("\0\0\0", 3), (" \u{1a}\r\n", 3)] {
        let scene = read(format!("{OBJ}{end}"), MTL).expect("valid");
        let place = if end.starts_with(' ') { "22:2" } else { "22:1" };
        let text =
            format!("x.obj:{place}: the file ends in NUL or ^Z ({what} of them), expected text: they are ignored");
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
