//! MTL material libraries: their statements checked one by one, and what a material means here.

use std::collections::HashSet;

use glam::DVec3;

use crate::scene::cursor::{Cursor, Field, Token};
use crate::scene::nff::COLOUR;
use crate::scene::source::Source;
use crate::scene::{Material, SourceError};

const NS: Field = Field { name: "a Phong exponent", min: 0.0, max: 1e9 };
const NI: Field = Field { name: "an index of refraction", min: 1e-3, max: 1e6 };
const DISSOLVE: Field = Field { name: "d", min: 0.0, max: 1.0 };
const TRANSPARENCY: Field = Field { name: "Tr", min: 0.0, max: 1.0 };

/// Checks a library, adds the names of its materials, and gives back the statements that count, as `tobj`
/// reads them well. Others, like texture maps, are left out.
///
/// # Errors
/// The first mistake, with line and column.
pub(super) fn check(source: &Source, names: &mut HashSet<String>) -> Result<String, SourceError> {
    let mut checker = Checker { cursor: Cursor::new(source), is_within_material: false, text: String::new() };
    loop {
        if let Some(keyword) = checker.cursor.token_on_line() {
            checker.statement(keyword, names)?;
        }
        if !checker.cursor.next_line() {
            return Ok(checker.text);
        }
    }
}

struct Checker<'a> {
    cursor: Cursor<'a>,
    is_within_material: bool,
    text: String,
}

impl Checker<'_> {
    fn statement(&mut self, keyword: Token, names: &mut HashSet<String>) -> Result<(), SourceError> {
        let is_word = |b: &u8| b.is_ascii_alphanumeric() || b"_-".contains(b);
        let Some(name) = keyword.text().filter(|_| keyword.bytes.iter().all(is_word)) else {
            return Err(self.cursor.error(keyword, format_args!(", expected newmtl, Kd, Ks, Ns, Ni, d, Tr or illum")));
        };
        if name == "newmtl" {
            return self.new_material(names);
        }
        let field = match name {
            "Kd" | "Ks" => &COLOUR,
            "Ns" => &NS,
            "Ni" => &NI,
            "d" => &DISSOLVE,
            "Tr" => &TRANSPARENCY,
            "illum" => return self.illumination_model(keyword),
            _ => return Ok(()),
        };
        self.expect_material(keyword)?;
        let (first, _) = self.cursor.number_on_line(field)?;
        let mut numbers = vec![first];
        if name.starts_with('K') {
            // A colour of one component is grey.
            let green = self.cursor.token_on_line();
            let blue = green.map(|_| self.cursor.expected_token_on_line());
            for word in [green, blue] {
                let word = word.unwrap_or(first);
                self.cursor.parse_number(word, field)?;
                numbers.push(word);
            }
        }
        self.put(name, &numbers);
        self.cursor.expect_end_of_line()
    }

    fn new_material(&mut self, names: &mut HashSet<String>) -> Result<(), SourceError> {
        let word = self.cursor.rest_of_line();
        // As `tobj` trims it.
        match word.text().map(str::trim) {
            Some(name) if !name.is_empty() => {
                names.insert(name.to_owned());
                self.is_within_material = true;
                self.put("newmtl", &[word]);
                Ok(())
            }
            _ => Err(self.cursor.error(word, format_args!(", expected a material's name"))),
        }
    }

    fn illumination_model(&mut self, keyword: Token) -> Result<(), SourceError> {
        self.expect_material(keyword)?;
        let word = self.cursor.expected_token_on_line();
        self.cursor.parse_count(word, "an illumination model", 0, 10)?;
        self.put("illum", &[word]);
        self.cursor.expect_end_of_line()
    }

    fn expect_material(&self, keyword: Token) -> Result<(), SourceError> {
        if self.is_within_material {
            return Ok(());
        }
        Err(self.cursor.error(keyword, format_args!(" of no material, expected newmtl before it")))
    }

    fn put(&mut self, keyword: &str, words: &[Token]) {
        self.text.push_str(keyword);
        for word in words {
            self.text.push(' ');
            self.text.push_str(word.text().unwrap_or_default());
        }
        self.text.push('\n');
    }
}

/// Illumination models 0 and 1 have no highlight, 2 has one, those above reflect as well. Without one: 2.
pub(super) fn material(mtl: &tobj::Material) -> Material {
    let model = mtl.illumination_model.unwrap_or(2);
    let specular = mtl.specular.map_or(DVec3::ZERO, DVec3::from);
    let transparency = mtl.unknown_param.get("Tr").and_then(|tr| tr.parse().ok()).unwrap_or(0.0);
    Material {
        diffuse: mtl.diffuse.map_or(Material::WHITE.diffuse, DVec3::from),
        highlight: if model >= 2 { specular } else { DVec3::ZERO },
        reflection: if model >= 3 { specular } else { DVec3::ZERO },
        shine: mtl.shininess.unwrap_or(Material::WHITE.shine),
        transmittance: mtl.dissolve.map_or(transparency, |dissolve| 1.0 - dissolve),
        ior: mtl.optical_density.unwrap_or(Material::WHITE.ior),
        ..Material::WHITE
    }
}
