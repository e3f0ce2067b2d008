//! Wavefront OBJ with MTL materials, read by `tobj`.
//!
//! `tobj` does not say where a mistake is, panics on some, and takes others for something else (a line of
//! three points for a triangle, a missing normal for the one before). So every file is first checked
//! line by line, in `statements` and `mtl`, and `tobj` gets what it reads well.
//!
//! Polygons stay polygons. Groups and objects have no meaning for a scene; texture coordinates, points,
//! lines and free-form curves are left out. OBJ has neither a camera nor lights.

mod mtl;
mod statements;

use std::cell::Cell;
use std::path::Path;

use glam::DVec3;

use super::source::Source;
use super::{Material, Polygon, Scene, SourceError};
use statements::Checked;

/// Larger files are refused, so that no index outgrows 32 bits and memory stays within some 20 GiB.
pub const OBJ_BYTES_MAX: u64 = 1 << 30;
/// Of all material libraries of a scene together.
pub const MTL_BYTES_MAX: u64 = 64 << 20;

/// Reads an OBJ file and the material libraries it names, in paths relative to its own folder.
///
/// # Errors
/// A file cannot be read, is larger than [`OBJ_BYTES_MAX`] or [`MTL_BYTES_MAX`], or its first mistake,
/// with line and column. Of a library no word is shown.
pub fn load(path: &Path) -> Result<Scene, SourceError> {
    let source = Source::read(path, OBJ_BYTES_MAX)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let left = Cell::new(MTL_BYTES_MAX);
    parse(&source, |library| {
        let library = Source::read_unquoted(&folder.join(library), left.get())?;
        left.set(left.get() - library.bytes.len() as u64);
        Ok(library)
    })
}

fn parse(source: &Source, read_library: impl Fn(&str) -> Result<Source, SourceError>) -> Result<Scene, SourceError> {
    let checked = statements::check(source, read_library)?;
    let options = tobj::LoadOptions::default();
    let loaded = tobj::load_obj_buf(&mut checked.text.as_bytes(), &options, |library| {
        let text = library.to_str().and_then(|name| checked.libraries.get(name));
        tobj::load_mtl_buf(&mut text.ok_or(tobj::LoadError::OpenFileFailed)?.as_bytes())
    });
    let unreadable = |error: tobj::LoadError| {
        SourceError::new(&source.file, None, format!("{error}, expected geometry and materials that tobj reads"))
    };
    let (models, materials) = loaded.map_err(unreadable)?;
    let materials = materials.map_err(unreadable)?.iter().map(mtl::material).collect();
    scene(&models, materials, &checked).ok_or_else(|| unreadable(tobj::LoadError::GenericFailure))
}

/// `None` when `tobj` gives back something else than what was checked.
fn scene(models: &[tobj::Model], materials: Vec<Material>, checked: &Checked) -> Option<Scene> {
    let mut scene = Scene { materials, ..Scene::default() };
    // Of faces that name no material.
    let white = u32::try_from(scene.materials.len()).ok()?;
    let mut is_smooth = checked.is_smooth.iter();
    for tobj::Model { mesh, .. } in models {
        let material = mesh.material_id.map_or(Some(white), |id| u32::try_from(id).ok())?;
        // No arities at all: every face is a triangle.
        let triangles = if mesh.face_arities.is_empty() { mesh.indices.len() / 3 } else { 0 };
        let mut first = 0;
        for vertex_count in mesh.face_arities.iter().copied().chain(std::iter::repeat_n(3, triangles)) {
            let corners = first..first + vertex_count as usize;
            first = corners.end;
            let first_vertex = scene.vertices.len() as u32;
            for &index in mesh.indices.get(corners.clone())? {
                scene.vertices.push(triple(&mesh.positions, index)?);
            }
            let first_normal = is_smooth.next()?.then_some(scene.normals.len() as u32);
            if first_normal.is_some() {
                for &index in mesh.normal_indices.get(corners)? {
                    scene.normals.push(triple(&mesh.normals, index)?.try_normalize()?);
                }
            }
            scene.polygons.push(Polygon { first_vertex, vertex_count, first_normal, first_colour: None, material });
        }
    }
    if scene.polygons.iter().any(|polygon| polygon.material == white) {
        scene.materials.push(Material::WHITE);
    }
    Some(scene)
}

fn triple(values: &[f64], index: u32) -> Option<DVec3> {
    values.get(index as usize * 3..)?.first_chunk().copied().map(DVec3::from_array)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn read(obj: impl Into<Vec<u8>>, mtl: impl Into<Vec<u8>>) -> Result<Scene, String> {
        let mtl = mtl.into();
        let library = |name: &str| match name {
            "x.mtl" => Ok(Source::from_bytes("x.mtl", mtl.clone())),
            _ => Err(SourceError::new(Path::new(name), None, "is not there")),
        };
        parse(&Source::from_bytes("x.obj", obj), library).map_err(|error| error.to_string())
    }

    const MTL: &str = "\
# Two materials.
newmtl red
Ka 1 1 1
Kd 1 0.25 0
Ks 0.5
Ns 20
illum 1

newmtl clear glass
  Kd 0 0 0
\tKs 0.5 0.5 0.5
Ni 1.5
d 0.25
illum 7
map_Kd -s 1 1 1 stone.png
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
l 1 2 3
usemtl\tclear glass
f -5//1 -4//-1 -3/1/2 -1//1
usemtl red
f 3 4 5
";

    #[test]
    fn faces_materials_and_normals_are_read() {
        let scene = read(OBJ, MTL).expect("valid");
        assert!(scene.camera.is_none() && scene.lights.is_empty());
        let polygon = |first_vertex, vertex_count, first_normal, material| Polygon {
            first_vertex,
            vertex_count,
            first_normal,
            first_colour: None,
            material,
        };
        let expected =
            [polygon(0, 5, None, 2), polygon(5, 3, None, 0), polygon(8, 4, Some(0), 1), polygon(12, 3, None, 0)];
        assert_eq!(scene.polygons, expected);
        let v = DVec3::new;
        assert_eq!(scene.vertices[3], v(0.5, 2.0, 0.0));
        assert_eq!(scene.vertices[8..12], [v(0.0, 0.0, 0.0), v(1.0, 0.0, 0.0), v(1.0, 1.0, 0.0), v(0.0, 1.0, 0.0)]);
        assert_eq!(scene.normals, [DVec3::Z, v(0.0, 3.0, 4.0).normalize(), v(0.0, 3.0, 4.0).normalize(), DVec3::Z]);
        let [red, glass, white] = scene.materials[..] else { panic!("three materials") };
        assert_eq!(white, Material::WHITE);
        assert_eq!((red.diffuse, red.highlight, red.reflection), (v(1.0, 0.25, 0.0), DVec3::ZERO, DVec3::ZERO));
        assert_eq!((red.shine, red.transmittance), (20.0, 0.0));
        assert_eq!((glass.highlight, glass.reflection), (DVec3::splat(0.5), DVec3::splat(0.5)));
        assert_eq!((glass.transmittance, glass.ior), (0.75, 1.5));
    }

    #[test]
    fn coordinates_keep_their_precision() {
        let scene = read("v 1234567.123456789 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "").expect("valid");
        assert_eq!(scene.vertices[0].x, 1_234_567.123_456_789);
        assert_eq!(scene.materials, [Material::WHITE]);
    }

    #[test]
    fn illumination_models_tell_highlights_from_reflections() {
        let material = |mtl: &str| {
            let obj = "mtllib x.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3";
            read(obj, format!("newmtl m\nKs 1 1 1\n{mtl}")).expect("valid").materials[0]
        };
        for (model, highlight, reflection) in
            [(0, 0.0, 0.0), (1, 0.0, 0.0), (2, 1.0, 0.0), (3, 1.0, 1.0), (7, 1.0, 1.0)]
        {
            let material = material(&format!("illum {model}"));
            assert_eq!((material.highlight.x, material.reflection.x), (highlight, reflection), "illum {model}");
        }
        assert_eq!(material("").reflection, DVec3::ZERO);
        assert_eq!(material("Tr 0.25").transmittance, 0.25);
    }

    #[test]
    fn mistakes_are_told_with_their_place() {
        let head = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\n";
        let obj = |line: &str| (format!("{head}{line}\n"), String::new());
        let mtl = |text: &str| ("mtllib x.mtl\n".to_owned(), text.to_owned());
        let table = [
            (obj("hello"), "x.obj:5:1: \"hello\", expected v, vt, vn, f, g, o, s, usemtl or mtllib"),
            (obj("\u{1}\u{2}"), "x.obj:5:1: \"\\x01\\x02\", expected v, vt, vn, f, g, o, s, usemtl or mtllib"),
            (obj("v 1 2"), "x.obj:5:6: the line ends here, expected a coordinate from -1e30 to 1e30"),
            (obj("v 1 x 2"), "x.obj:5:5: \"x\" is not a number, expected a coordinate from -1e30 to 1e30"),
            (obj("v 1 NaN 2"), "x.obj:5:5: \"NaN\" is out of range, expected a coordinate from -1e30 to 1e30"),
            (obj("v 1 2 inf"), "x.obj:5:7: \"inf\" is out of range, expected a coordinate from -1e30 to 1e30"),
            (obj("vn 0 0 0"), "x.obj:5:1: \"vn\" without a direction, expected a normal longer than 0"),
            (obj("vn 0 0 1 1"), "x.obj:5:10: \"1\", expected the end of the line"),
            (obj("f 1 2"), "x.obj:5:1: \"f\" with 2 corners, expected at least 3"),
            (obj("f 1 2 4"), "x.obj:5:7: \"4\" names vertex 4, expected one of the 3 defined so far"),
            (obj("f 1 2 0"), "x.obj:5:7: \"0\" names vertex 0, expected one of the 3 defined so far"),
            (obj("f -4 2 3"), "x.obj:5:3: \"-4\" names vertex -4, expected one of the 3 defined so far"),
            (
                obj("f -9223372036854775808 2 3"),
                "x.obj:5:3: \"-9223372036854775808\" names vertex -9223372036854775808, expected one of the 3 defined so far",
            ),
            (obj("f 1//2 2//1 3//1"), "x.obj:5:3: \"1//2\" names normal 2, expected one of the 1 defined so far"),
            (
                obj("f 1/1 2/1 3/1"),
                "x.obj:5:3: \"1/1\" names texture coordinate 1, expected one of the 0 defined so far",
            ),
            (obj("f 1//1 2 3"), "x.obj:5:8: \"2\" has no normal and the face's first corner one, expected all or none"),
            (
                obj("f 1 2//1 3"),
                "x.obj:5:5: \"2//1\" has a normal and the face's first corner none, expected all or none",
            ),
            (
                obj("f 1/2/3/4 2 3"),
                "x.obj:5:3: \"1/2/3/4\" names texture coordinate 2, expected one of the 0 defined so far",
            ),
            (obj("f 1///1 2 3"), "x.obj:5:3: \"1///1\", expected a corner like 1, 1/2, 1//3 or 1/2/3"),
            (obj("f //1 2 3"), "x.obj:5:3: \"//1\", expected a corner like 1, 1/2, 1//3 or 1/2/3"),
            (obj("f a b c"), "x.obj:5:3: \"a\", expected a corner like 1, 1/2, 1//3 or 1/2/3"),
            (obj("usemtl stone"), "x.obj:5:8: \"stone\", expected one of the 0 materials defined so far"),
            (obj("usemtl"), "x.obj:5:7: the line ends here, expected a material's name"),
            (obj("mtllib none.mtl"), "x.obj:5:8: \"none.mtl\": is not there"),
            (mtl("Kd 1 1 1"), "x.mtl:1:1: \"Kd\" of no material, expected newmtl before it"),
            (mtl("newmtl"), "x.mtl:1:7: the file ends here, expected a material's name"),
            (mtl("newmtl a\nKd 1 1"), "x.mtl:2:7: the file ends here, expected a colour's component from 0 to 1e6"),
            (
                mtl("newmtl a\nKd 1 1 -1"),
                "x.mtl:2:8: \"-1\" is out of range, expected a colour's component from 0 to 1e6",
            ),
            (mtl("newmtl a\nKd 1 1 1 1"), "x.mtl:2:10: \"1\", expected the end of the line"),
            (mtl("newmtl a\nd 2"), "x.mtl:2:3: \"2\" is out of range, expected d from 0 to 1"),
            (mtl("newmtl a\nTr -1"), "x.mtl:2:4: \"-1\" is out of range, expected Tr from 0 to 1"),
            (
                mtl("newmtl a\nNi 0"),
                "x.mtl:2:4: \"0\" is out of range, expected an index of refraction from 0.001 to 1e6",
            ),
            (mtl("newmtl a\nNs nan"), "x.mtl:2:4: \"nan\" is out of range, expected a Phong exponent from 0 to 1e9"),
            (
                mtl("newmtl a\nillum 11"),
                "x.mtl:2:7: \"11\", expected an illumination model, a whole number from 0 to 10",
            ),
            (mtl("newmtl a\n\u{0}"), "x.mtl:2:1: \"\\x00\", expected newmtl, Kd, Ks, Ns, Ni, d, Tr or illum"),
        ];
        for ((obj, mtl), expected) in table {
            assert_eq!(read(obj.clone(), mtl).expect_err("malformed"), expected, "{obj}");
        }
    }

    #[test]
    fn a_missing_library_is_told_where_it_is_named() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("x.obj");
        std::fs::write(&path, "# hello\nmtllib none.mtl\n").expect("a file");
        let error = load(&path).expect_err("no such library").to_string();
        assert!(error.contains("x.obj:2:8: \"none.mtl\": cannot be read ("), "{error}");
    }

    proptest! {
        #[test]
        fn arbitrary_bytes_are_read_or_refused(
            obj in prop::collection::vec(any::<u8>(), 0..300),
            mtl in prop::collection::vec(any::<u8>(), 0..100),
        ) {
            let _ = read(obj, mtl.clone());
            let _ = read("mtllib x.mtl", mtl);
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
            match read(obj, mtl) {
                Ok(scene) => prop_assert!(scene.polygons.iter().all(|p| (p.material as usize) < scene.materials.len())),
                // What was checked must not be refused by the reader behind the checks.
                Err(error) => prop_assert!(!error.contains("tobj"), "{}", error),
            }
        }
    }
}
