//! Statements of MTL, and what materials they make.

use super::*;

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
    /// A statement, its warnings, what it makes.
    type Case = (&'static str, &'static [(&'static str, &'static str)], Material);
    const BRIGHT: (&str, &str) = (
        "bright-colour",
        "2:4: Kd above 1 sends back more light than comes, and is drawn so; colours from 0 to 255 have to be divided by 255",
    );
    let table: [Case; 18] = [
        ("Kd 0.5", &[], grey(0.5)),
        ("Kd 255", &[BRIGHT], grey(255.0)),
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
            &[("out-of-range", "2:4: a word is out of range, expected Kd from 0 to 1e6: 1e6 is used"), BRIGHT],
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
        ("stray-end", "5:9: the file ends in NUL or ^Z (2 of them), expected text: they are ignored"),
        ("outside-material", "1:1: Kd of no material, expected newmtl before it: is ignored (and 1 more)"),
        ("nameless-material", "3:1: newmtl without a name, expected a material's: it is left out"),
    ];
    assert_eq!(shown(&scene.warnings), expected.map(|(kind, text)| (kind, format!("x.mtl:{text}"))));
    assert_eq!(scene.materials.len(), 1);
}
