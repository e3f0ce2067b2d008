//! The statements of an OBJ file, checked one by one, and as `tobj` reads them well.

use std::collections::{HashMap, HashSet};
use std::fmt::Write;

use super::mtl;
use crate::scene::SourceError;
use crate::scene::cursor::{Cursor, Field, Token};
use crate::scene::nff::{COORDINATE, NORMAL};
use crate::scene::source::Source;

const WEIGHT: Field = Field { name: "a weight or a colour's component", min: -1e30, max: 1e30 };
const TEXTURE_COORDINATE: Field = Field { name: "a texture coordinate", min: -1e30, max: 1e30 };

/// What the specification knows besides and a scene does not hold: groups, smoothing, points, lines,
/// free-form geometry, display and render attributes.
const IGNORED: [&[u8]; 36] = [
    b"bevel",
    b"bmat",
    b"bsp",
    b"bzp",
    b"c_interp",
    b"cdc",
    b"con",
    b"cstype",
    b"ctech",
    b"curv",
    b"curv2",
    b"d_interp",
    b"deg",
    b"end",
    b"g",
    b"hole",
    b"l",
    b"lod",
    b"maplib",
    b"mg",
    b"o",
    b"p",
    b"parm",
    b"res",
    b"s",
    b"scrv",
    b"shadow_obj",
    b"sp",
    b"stech",
    b"step",
    b"surf",
    b"trace_obj",
    b"trim",
    b"usemap",
    b"vp",
    b"call",
];

/// An OBJ file that is known to be right.
pub(super) struct Checked {
    /// Its vertices, normals, faces and materials: one blank between words, no comments, absolute indices
    /// and no texture coordinates.
    pub(super) text: String,
    /// For each face whether its corners have normals.
    pub(super) is_smooth: Vec<bool>,
    /// The text of the material libraries by name.
    pub(super) libraries: HashMap<String, String>,
}

/// Checks a whole file and the libraries it names.
///
/// # Errors
/// The first mistake, with line and column.
pub(super) fn check(
    source: &Source,
    read_library: impl Fn(&str) -> Result<Source, SourceError>,
) -> Result<Checked, SourceError> {
    let mut checker = Checker {
        cursor: Cursor::new(source),
        read_library,
        vertices: 0,
        normals: 0,
        texture_coordinates: 0,
        materials: HashSet::new(),
        checked: Checked { text: String::new(), is_smooth: Vec::new(), libraries: HashMap::new() },
    };
    loop {
        if let Some(keyword) = checker.cursor.token_on_line() {
            checker.statement(keyword)?;
        }
        if !checker.cursor.next_line() {
            return Ok(checker.checked);
        }
    }
}

struct Checker<'a, R> {
    cursor: Cursor<'a>,
    read_library: R,
    /// How many were defined so far.
    vertices: usize,
    normals: usize,
    texture_coordinates: usize,
    /// Names.
    materials: HashSet<String>,
    checked: Checked,
}

/// Where the indices of a face's corner point, from 1.
struct Corner {
    vertex: usize,
    normal: Option<usize>,
}

impl<R: Fn(&str) -> Result<Source, SourceError>> Checker<'_, R> {
    fn statement(&mut self, keyword: Token) -> Result<(), SourceError> {
        match keyword.bytes {
            b"v" => self.vertex(),
            b"vn" => self.normal(keyword),
            b"vt" => self.texture_coordinate(),
            // Two names of one statement.
            b"f" | b"fo" => self.face(keyword),
            b"usemtl" => self.use_material(),
            b"mtllib" => self.library(),
            known if IGNORED.contains(&known) => Ok(()),
            _ => Err(self.cursor.error(keyword, format_args!(", expected v, vt, vn, f, g, o, s, usemtl or mtllib"))),
        }
    }

    fn vertex(&mut self) -> Result<(), SourceError> {
        self.copy_triple("v", &COORDINATE)?;
        // A weight, of use to free-form curves only, or the vertex's colour.
        while let Some(word) = self.cursor.token_on_line() {
            self.cursor.parse_number(word, &WEIGHT)?;
        }
        self.vertices += 1;
        Ok(())
    }

    fn normal(&mut self, keyword: Token) -> Result<(), SourceError> {
        let normal = self.copy_triple("vn", &NORMAL)?;
        if glam::DVec3::from(normal).try_normalize().is_none() {
            return Err(self
                .cursor
                .error(keyword, format_args!(" without a direction, expected a normal longer than 0")));
        }
        self.normals += 1;
        self.cursor.expect_end_of_line()
    }

    fn texture_coordinate(&mut self) -> Result<(), SourceError> {
        self.cursor.number_on_line(&TEXTURE_COORDINATE)?;
        while let Some(word) = self.cursor.token_on_line() {
            self.cursor.parse_number(word, &TEXTURE_COORDINATE)?;
        }
        self.texture_coordinates += 1;
        Ok(())
    }

    /// Passes three numbers on as they are written.
    fn copy_triple(&mut self, keyword: &str, field: &Field) -> Result<[f64; 3], SourceError> {
        self.checked.text.push_str(keyword);
        let mut numbers = [0.0; 3];
        for number in &mut numbers {
            let (word, value) = self.cursor.number_on_line(field)?;
            self.checked.text.push(' ');
            self.checked.text.push_str(word.text().unwrap_or_default());
            *number = value;
        }
        self.checked.text.push('\n');
        Ok(numbers)
    }

    fn face(&mut self, keyword: Token) -> Result<(), SourceError> {
        self.checked.text.push('f');
        let mut corners = 0;
        let mut is_smooth = false;
        while let Some(word) = self.cursor.token_on_line() {
            let corner = self.corner(word)?;
            if corners > 0 && is_smooth != corner.normal.is_some() {
                let (this, first) = if is_smooth { ("no normal", "one") } else { ("a normal", "none") };
                let what = format_args!(" has {this} and the face's first corner {first}, expected all or none");
                return Err(self.cursor.error(word, what));
            }
            is_smooth = corner.normal.is_some();
            corners += 1;
            // Writing to a string cannot fail.
            let _ = match corner.normal {
                Some(normal) => write!(self.checked.text, " {}//{normal}", corner.vertex),
                None => write!(self.checked.text, " {}", corner.vertex),
            };
        }
        if corners < 3 {
            return Err(self.cursor.error(keyword, format_args!(" with {corners} corners, expected at least 3")));
        }
        self.checked.text.push('\n');
        self.checked.is_smooth.push(is_smooth);
        Ok(())
    }

    /// `v`, `v/vt`, `v//vn` or `v/vt/vn`.
    fn corner(&self, word: Token) -> Result<Corner, SourceError> {
        let bad = || self.cursor.error(word, format_args!(", expected a corner like 1, 1/2, 1//3 or 1/2/3"));
        let mut parts = word.text().ok_or_else(bad)?.split('/');
        let mut index = |name: &str, defined: usize| match parts.next() {
            None | Some("") => Ok(None),
            Some(part) => {
                let index: i64 = part.parse().map_err(|_| bad())?;
                let place = if index < 0 { index.saturating_add(defined as i64).saturating_add(1) } else { index };
                usize::try_from(place).ok().filter(|place| (1..=defined).contains(place)).map(Some).ok_or_else(|| {
                    let what = format_args!(" names {name} {index}, expected one of the {defined} defined so far");
                    self.cursor.error(word, what)
                })
            }
        };
        let vertex = index("vertex", self.vertices)?;
        index("texture coordinate", self.texture_coordinates)?;
        let normal = index("normal", self.normals)?;
        match (vertex, parts.next()) {
            (Some(vertex), None) => Ok(Corner { vertex, normal }),
            _ => Err(bad()),
        }
    }

    fn use_material(&mut self) -> Result<(), SourceError> {
        let word = self.cursor.rest_of_line();
        let name = self.name(word, "a material's name")?;
        if !self.materials.contains(name) {
            let what = format_args!(", expected one of the {} materials defined so far", self.materials.len());
            return Err(self.cursor.error(word, what));
        }
        let _ = writeln!(self.checked.text, "usemtl {name}");
        Ok(())
    }

    fn library(&mut self) -> Result<(), SourceError> {
        let word = self.cursor.rest_of_line();
        let name = self.name(word, "a material library's name")?;
        // Naming it again changes nothing, and must not cost anything either.
        if self.checked.libraries.contains_key(name) {
            return Ok(());
        }
        let library =
            (self.read_library)(name).map_err(|error| self.cursor.error(word, format_args!(": {}", error.what)))?;
        let text = mtl::check(&library, &mut self.materials)?;
        self.checked.libraries.insert(name.to_owned(), text);
        let _ = writeln!(self.checked.text, "mtllib {name}");
        Ok(())
    }

    fn name<'w>(&self, word: Token<'w>, what: &str) -> Result<&'w str, SourceError> {
        // As `tobj` trims it.
        let name = word.text().map(str::trim).filter(|name| !name.is_empty());
        name.ok_or_else(|| self.cursor.error(word, format_args!(", expected {what}")))
    }
}
