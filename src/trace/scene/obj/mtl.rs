//! MTL material libraries. Nothing in them is an error: what cannot be used is repaired or left out.
//!
//! No text here shows words of the file but keywords: see [`Source::read_unquoted`].

use std::fmt;

use glam::DVec3;

use super::definition::Definition;
use super::materials::Materials;
use crate::scene::Warnings;
use crate::scene::cursor::{Cursor, Field, Judged, Token};
use crate::scene::source::Source;

const KD: Field = Field { name: "Kd", min: 0.0, max: 1e6 };
const KS: Field = Field { name: "Ks", min: 0.0, max: 1e6 };
const KE: Field = Field { name: "Ke", min: 0.0, max: 1e6 };
const NS: Field = Field { name: "Ns", min: 0.0, max: 1e9 };
const DISSOLVE: Field = Field { name: "d", min: 0.0, max: 1.0 };
const TRANSPARENCY: Field = Field { name: "Tr", min: 0.0, max: 1.0 };
const NUMBER: Field = Field { name: "a number", min: f64::MIN, max: f64::MAX };

const READ: [&str; 9] = ["newmtl", "Kd", "Ks", "Ke", "Ns", "Ni", "d", "Tr", "illum"];

/// Statements without effect: keywords, the kind of their warning, and its text.
const UNUSED: [(&[&str], &str, &str); 5] = [
    (&["Ka"], "ambient-colour", "there is no ambient light, it is ignored"),
    (&["Tf"], "transmission-filter", "what passes through is not coloured, it is ignored"),
    (&["sharpness"], "sharpness", "reflections are always sharp, it is ignored"),
    (
        &["Pr", "Pm", "Ps", "Pc", "Pcr", "aniso", "anisor"],
        "physically-based",
        "physically based materials are not drawn, it is ignored",
    ),
    (
        &[
            "map_Ka",
            "map_Kd",
            "map_Ks",
            "map_Ke",
            "map_Ns",
            "map_Ni",
            "map_d",
            "map_Tr",
            "map_Tf",
            "map_bump",
            "map_Bump",
            "map_disp",
            "map_refl",
            "map_opacity",
            "map_aat",
            "map_Pr",
            "map_Pm",
            "map_Ps",
            "bump",
            "disp",
            "decal",
            "refl",
            "norm",
        ],
        "texture-map",
        "textures are not drawn, the colour alone is",
    ),
];

/// Reads a library and adds its materials. One whose name is defined already is left out: the first library of a
/// name counts, as the specification has it, and within a library too.
pub(super) fn read(source: &Source, materials: &mut Materials) -> Warnings {
    let cursor = Cursor::new(source);
    let mut reader = Reader { source, cursor, warnings: Warnings::default(), materials, current: None };
    reader.cursor.warn_of_stray_end(&mut reader.warnings);
    loop {
        if let Some(keyword) = reader.cursor.token_on_line() {
            reader.statement(keyword);
        }
        if !reader.cursor.next_statement() {
            reader.finish_material();
            return reader.warnings;
        }
    }
}

struct Reader<'a> {
    source: &'a Source,
    cursor: Cursor<'a>,
    warnings: Warnings,
    materials: &'a mut Materials,
    /// The last material that was named, and what is known of it.
    current: Option<(Token<'a>, Definition)>,
}

impl<'a> Reader<'a> {
    fn statement(&mut self, keyword: Token<'a>) {
        let at = keyword.at;
        let Some(known) = known(keyword.bytes) else {
            self.warn("unknown-keyword", at, "a word that starts no statement of MTL: its line is ignored");
            return;
        };
        if known.as_bytes() != keyword.bytes {
            self.warn("keyword-case", at, format_args!("a keyword in other letters is read as {known}"));
        }
        if known == "newmtl" {
            self.new_material(keyword);
            return;
        }
        if self.current.is_none() {
            self.warn(
                "outside-material",
                at,
                format_args!("{known} of no material, expected newmtl before it: is ignored"),
            );
            return;
        }
        match known {
            "Kd" => {
                let diffuse = self.colour(keyword, known, &KD, DVec3::ONE);
                self.set(diffuse, |definition, colour| definition.diffuse = Some(colour));
            }
            "Ks" => {
                let specular = self.colour(keyword, known, &KS, DVec3::ZERO);
                self.set(specular, |definition, colour| definition.specular = colour);
            }
            "Ke" => {
                let emission = self.colour(keyword, known, &KE, DVec3::ZERO);
                self.set(emission, |definition, colour| definition.emission = colour);
            }
            "Ns" => {
                let shine = self.last_number(&NS);
                self.set(shine, |definition, shine| definition.shine = shine);
            }
            "Ni" => {
                let ior = self.refractive_index();
                self.set(ior, |definition, ior| definition.ior = Some((at, ior)));
            }
            "d" => {
                let dissolve = self.dissolve();
                self.set(dissolve, |definition, dissolve| definition.dissolve = Some(dissolve));
            }
            "Tr" => {
                let transparency = self.last_number(&TRANSPARENCY);
                self.set(transparency, |definition, tr| definition.transparency = Some((at, tr)));
            }
            "illum" => {
                let model = self.illumination_model();
                self.set(model, |definition, model| definition.model = Some((at, model)));
            }
            unused => self.unused(keyword, unused),
        }
    }

    fn new_material(&mut self, keyword: Token<'a>) {
        self.finish_material();
        let name = self.cursor.rest_of_line();
        if name.bytes.is_empty() {
            self.warn("nameless-material", keyword.at, "newmtl without a name, expected a material's: it is left out");
        } else if self.materials.is_defined(name) {
            self.warn(
                "material-defined-twice",
                keyword.at,
                "newmtl of a name that is defined already: the first counts",
            );
        }
        self.current = Some((name, Definition::default()));
    }

    fn finish_material(&mut self) {
        let Some((name, definition)) = self.current.take() else { return };
        let (source, warnings) = (self.source, &mut self.warnings);
        let material =
            definition.material(|kind, at, what| warnings.add(&source.file, kind, || source.error(at, what)));
        if !name.bytes.is_empty() && !self.materials.is_defined(name) {
            self.materials.define(name, material);
        }
    }

    fn set<T>(&mut self, value: Option<T>, set: impl FnOnce(&mut Definition, T)) {
        if let (Some(value), Some((_, definition))) = (value, &mut self.current) {
            set(definition, value);
        }
    }

    /// Three components, or one for a grey. `instead` is for colours in forms that are not read.
    fn colour(&mut self, keyword: Token, known: &'static str, field: &Field, instead: DVec3) -> Option<DVec3> {
        let first = self.cursor.expected_token_on_line();
        if matches!(first.bytes, b"spectral" | b"xyz") {
            let colour = if instead == DVec3::ONE { "white" } else { "black" };
            let what =
                format_args!("{known} as a spectrum or in CIE XYZ, expected red, green and blue: {colour} is used");
            self.warn("colour-form", keyword.at, what);
            return Some(instead);
        }
        let red = self.number(first, field)?;
        let colour = match self.cursor.token_on_line() {
            None => DVec3::splat(red),
            Some(green) => DVec3::new(red, self.number(green, field)?, self.last_number(field)?),
        };
        // A lamp may be as bright as it likes.
        if known != "Ke" && colour.max_element() > 1.0 {
            let what = format_args!(
                "{known} above 1 sends back more light than comes, and is drawn so; colours from 0 to 255 have to be divided by 255"
            );
            self.warn("bright-colour", first.at, what);
        }
        Some(colour)
    }

    fn dissolve(&mut self) -> Option<f64> {
        let mut word = self.cursor.expected_token_on_line();
        if word.bytes == b"-halo" {
            self.warn("halo", word.at, "-halo: d does not depend on the direction, its number alone is used");
            word = self.cursor.expected_token_on_line();
        }
        let dissolve = self.number(word, &DISSOLVE);
        self.end_of_statement();
        dissolve
    }

    /// Any number: its range counts where it is used.
    fn refractive_index(&mut self) -> Option<f64> {
        let word = self.cursor.expected_token_on_line();
        let ior = match Cursor::judge(word, &Definition::IOR) {
            Judged::Fits(ior) | Judged::OutOfRange(ior) => Some(ior),
            // With a warning.
            Judged::Useless => self.number(word, &Definition::IOR),
        };
        self.end_of_statement();
        ior
    }

    fn illumination_model(&mut self) -> Option<u8> {
        const MODEL: Field = Field { name: "an illumination model", min: 0.0, max: 10.0 };
        let word = self.cursor.expected_token_on_line();
        let (model, is_odd) = match Cursor::judge(word, &MODEL) {
            Judged::Fits(number) => (number.round() as u8, word.bytes.iter().any(|b| !b.is_ascii_digit())),
            Judged::OutOfRange(_) => (Definition::MODEL, true),
            // With a warning.
            Judged::Useless => return self.number(word, &MODEL).map(|_| Definition::MODEL),
        };
        if is_odd {
            let what = format_args!(
                "an illumination model of odd form, expected a whole number from 0 to 10: {model} is used"
            );
            self.warn("illumination-model", word.at, what);
        }
        self.end_of_statement();
        Some(model)
    }

    fn unused(&mut self, keyword: Token, known: &'static str) {
        // What a colour is that would change nothing if it were drawn.
        let neutral = match known {
            "Ka" => Some(0.0),
            "Tf" => Some(1.0),
            _ => None,
        };
        if let Some(neutral) = neutral {
            let is_neutral = |word| Cursor::judge(word, &NUMBER) == Judged::Fits(neutral);
            if self.cursor.token_on_line().is_some_and(is_neutral)
                && std::iter::from_fn(|| self.cursor.token_on_line()).all(is_neutral)
            {
                return;
            }
        }
        if let Some((_, kind, text)) = UNUSED.iter().find(|(keywords, ..)| keywords.contains(&known)) {
            self.warn(kind, keyword.at, format_args!("{known}: {text}"));
        }
    }

    /// The next word as a number; nothing may follow it.
    fn last_number(&mut self, field: &Field) -> Option<f64> {
        let word = self.cursor.expected_token_on_line();
        let number = self.number(word, field);
        self.end_of_statement();
        number
    }

    /// A word as a number, clamped; `None`, with a warning, for what is none.
    fn number(&mut self, word: Token, field: &Field) -> Option<f64> {
        let number = self.cursor.clamp_number(word, field, &mut self.warnings);
        if number.is_none() {
            self.warnings.add(&self.source.file, "bad-number", || {
                let mut error = self.cursor.bad_number(word, field);
                error.what.push_str(": the statement is left out");
                error
            });
        }
        number
    }

    fn end_of_statement(&mut self) {
        if let Some(more) = self.cursor.token_on_line() {
            self.warn("extra-words", more.at, "a word too many, expected the end of the line: is ignored");
        }
    }

    fn warn(&mut self, kind: &'static str, at: usize, what: impl fmt::Display) {
        self.warnings.add(&self.source.file, kind, || self.source.error(at, what.to_string()));
    }
}

/// The keyword that a word is, or is but for upper and lower case.
fn known(word: &[u8]) -> Option<&'static str> {
    let all = || READ.iter().chain(UNUSED.iter().flat_map(|(keywords, ..)| *keywords));
    let exact = all().find(|keyword| keyword.as_bytes() == word);
    exact.or_else(|| all().find(|keyword| keyword.as_bytes().eq_ignore_ascii_case(word))).copied()
}
