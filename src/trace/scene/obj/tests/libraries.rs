//! `mtllib` and `usemtl`.

use std::fs;

use super::*;

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
    /// A line, the material, the libraries that there are, the warnings.
    type Case = (&'static str, &'static str, &'static [(&'static str, &'static [u8])], &'static [&'static str]);
    let table: &[Case] = &[
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
