//! The statements of an OBJ file, one after the other, into a scene.

use std::fmt;

use glam::DVec3;

use super::libraries::{Libraries, Spelling};
use super::materials::Uses;
use super::smoothing::Smoothing;
use super::statements;
use super::vertex::Vertex;
use crate::picture::Terminator;
use crate::scene::cursor::{Cursor, Judged, Token};
use crate::scene::nff::NORMAL;
use crate::scene::source::Source;
use crate::scene::{Material, Polygon, Scene, SourceError, may_be_flawed};

/// Reads a whole file, and through `read_library` the libraries that it names.
///
/// # Errors
/// The first mistake that changes the geometry, with line and column.
pub(super) fn read(
    source: &Source,
    read_library: impl Fn(&[u8], Spelling) -> Option<Result<Source, SourceError>>,
) -> Result<Scene, SourceError> {
    let mut reader = Reader {
        source,
        cursor: Cursor::new(source),
        libraries: Libraries::new(read_library),
        scene: Scene { file: Some(source.file.clone()), terminator: Terminator::Soft, ..Scene::default() },
        positions: Vec::new(),
        unreadable: Vec::new(),
        normals: Vec::new(),
        colours: Vec::new(),
        uses: Uses::default(),
        group: None,
        smoothing: Smoothing::default(),
        face: Face::default(),
    };
    reader.cursor.warn_of_stray_end(&mut reader.scene.warnings);
    loop {
        if let Some(keyword) = reader.cursor.token_on_line() {
            reader.statement(keyword)?;
        }
        if !reader.cursor.next_statement() {
            return Ok(reader.finish());
        }
    }
}

struct Reader<'a, R> {
    source: &'a Source,
    cursor: Cursor<'a>,
    libraries: Libraries<R>,
    /// The materials of its polygons are indices into `uses` until the file is read.
    scene: Scene,
    /// Not a number where a vertex cannot be read: no harm is done unless a face uses it.
    positions: Vec<DVec3>,
    /// Indices of those vertices, and where their coordinates begin.
    unreadable: Vec<(u32, Cursor<'a>)>,
    /// Unit; zero where the file gives none that is of use.
    normals: Vec<DVec3>,
    /// Of as many of the first positions as it takes to have the last colour.
    colours: Vec<Option<DVec3>>,
    uses: Uses<'a>,
    /// The smoothing group of the faces that follow.
    group: Option<u32>,
    smoothing: Smoothing,
    /// Used again for every face.
    face: Face,
}

/// The index of a normal that is not there.
const NO_NORMAL: u32 = u32::MAX;

/// Indices of a face's corners.
#[derive(Default)]
struct Face {
    positions: Vec<u32>,
    normals: Vec<Option<u32>>,
}

/// What makes a face impossible.
enum Fault {
    Form,
    /// An index that no vertex has.
    Absent(i64),
    /// A vertex that cannot be read.
    Unreadable(u32),
}

impl<'a, R: Fn(&[u8], Spelling) -> Option<Result<Source, SourceError>>> Reader<'a, R> {
    fn statement(&mut self, keyword: Token<'a>) -> Result<(), SourceError> {
        match keyword.bytes {
            b"v" => self.vertex(),
            // Two names of one statement.
            b"f" | b"fo" => return self.face(keyword),
            b"vn" => self.normal(keyword),
            // Nothing is drawn with texture coordinates; groups and objects have no effect on what is seen.
            b"vt" | b"g" | b"o" => {}
            b"s" => self.smoothing_group(),
            b"usemtl" => self.use_material(keyword),
            b"mtllib" => self.library(keyword),
            _ => return self.other(keyword),
        }
        Ok(())
    }

    fn other(&mut self, keyword: Token<'a>) -> Result<(), SourceError> {
        if let Some(statement) = statements::undrawn(keyword.bytes) {
            // Off is how it is drawn.
            let value = self.cursor.expected_token_on_line();
            if !(statement.is_attribute && matches!(value.bytes, b"off" | b"0")) {
                self.warn(statement.kind, keyword, format_args!(": {}", statement.text));
            }
            return Ok(());
        }
        if let Some(known) = statements::in_other_letters(keyword.bytes) {
            let known = Token { at: keyword.at, bytes: known };
            self.warn("keyword-case", keyword, format_args!(", expected lower case: is read as {known}"));
            return self.statement(known);
        }
        self.warn("unknown-keyword", keyword, format_args!(" starts no statement of OBJ: its line is ignored"));
        Ok(())
    }

    fn vertex(&mut self) {
        let before = self.cursor.clone();
        let Some(Vertex { position, colour }) = Vertex::read(&mut self.cursor, &mut self.scene.warnings) else {
            self.unreadable.push((self.positions.len() as u32, before));
            self.positions.push(DVec3::NAN);
            return;
        };
        if colour.is_some() {
            self.colours.resize(self.positions.len(), None);
            self.colours.push(colour);
        }
        self.positions.push(position);
    }

    fn normal(&mut self, keyword: Token<'a>) {
        let mut normal = DVec3::ZERO;
        for component in normal.as_mut() {
            let word = self.cursor.expected_token_on_line();
            let Judged::Fits(number) = Cursor::judge(word, &NORMAL) else {
                self.scene.warnings.add(&self.source.file, "bad-normal", || {
                    let SourceError { file, place, what } = self.cursor.bad_number(word, &NORMAL);
                    SourceError { file, place, what: format!("{what}: faces do without this normal") }
                });
                self.normals.push(DVec3::ZERO);
                return;
            };
            *component = number;
        }
        if let Some(more) = self.cursor.token_on_line() {
            self.warn("bad-normal", more, format_args!(" after a normal, expected the end of the line: is ignored"));
        }
        // Its square may be too small for a number.
        let unit = normal.try_normalize().or_else(|| (normal / normal.abs().max_element()).try_normalize());
        if unit.is_none() {
            let what = format_args!(" without a direction, expected a normal longer than 0: faces do without it");
            self.warn("zero-normal", keyword, what);
        }
        self.normals.push(unit.unwrap_or(DVec3::ZERO));
    }

    fn face(&mut self, keyword: Token<'a>) -> Result<(), SourceError> {
        let line = self.cursor.line();
        self.face.positions.clear();
        self.face.normals.clear();
        let (mut corners, mut fault) = (0, None);
        while let Some(word) = self.cursor.token_on_line() {
            corners += 1;
            if fault.is_none() {
                fault = self.corner(word).err().map(|fault| (word, fault));
            }
        }
        if corners < 3 {
            let what = format_args!(" with {corners} corners, expected at least 3: the face is left out");
            self.warn("short-face", keyword, what);
            return Ok(());
        }
        match fault {
            None => {}
            Some((word, Fault::Form)) => {
                return Err(self.cursor.error(word, format_args!(", expected a corner like 1, 1/2, 1//3 or 1/2/3")));
            }
            Some((word, Fault::Absent(index))) => {
                let defined = self.positions.len();
                let what = format_args!(" names vertex {index}, expected one of the {defined} defined so far");
                return Err(self.cursor.error(word, what));
            }
            Some((_, Fault::Unreadable(position))) => {
                let found = self.unreadable.binary_search_by_key(&position, |(index, _)| *index);
                return Err(Vertex::fault(self.unreadable[found.unwrap_or(0)].1.clone()));
            }
        }
        self.polygon(keyword, line);
        Ok(())
    }

    /// `v`, `v/vt`, `v//vn` or `v/vt/vn`. Only the vertex has to be there.
    fn corner(&mut self, word: Token<'a>) -> Result<(), Fault> {
        let mut parts = word.bytes.split(|&b| b == b'/');
        let index: i64 = parts.next().and_then(integer).ok_or(Fault::Form)?;
        let position = place(index, self.positions.len()).ok_or(Fault::Absent(index))?;
        if self.positions[position as usize].is_nan() {
            return Err(Fault::Unreadable(position));
        }
        self.face.positions.push(position);
        let texture = parts.next().unwrap_or_default();
        if !texture.is_empty() && integer(texture).is_none() {
            let what =
                format_args!(" names no texture coordinate, expected a corner like 1/2 or 1/2/3: that part is ignored");
            self.warn("odd-corner", word, what);
        }
        let normal = parts.next().filter(|part| !part.is_empty()).map(|part| {
            let defined = self.normals.len();
            integer(part).and_then(|index| place(index, defined)).unwrap_or_else(|| {
                let what = format_args!(" names a normal that is not there, expected one of the {defined} defined so far: the face does without");
                self.warn("normal-index", word, what);
                NO_NORMAL
            })
        });
        self.face.normals.push(normal);
        if parts.next().is_some() {
            let what = format_args!(" has more than three parts, expected a corner like 1/2/3: the others are ignored");
            self.warn("odd-corner", word, what);
        }
        Ok(())
    }

    /// The face as a polygon of the scene.
    fn polygon(&mut self, keyword: Token<'a>, line: u32) {
        let scene = &mut self.scene;
        let id = scene.polygons.len() as u32;
        let vertex_count = self.face.positions.len() as u32;
        let mut polygon = Polygon {
            first_vertex: scene.vertices.len() as u32,
            vertex_count,
            first_normal: None,
            first_colour: None,
            material: self.uses.current(),
        };
        scene.vertices.extend(self.face.positions.iter().map(|&position| self.positions[position as usize]));
        if may_be_flawed(&scene.vertices[polygon.first_vertex as usize..]) {
            scene.polygon_lines.push((id, line));
        }
        let colour = |&position: &u32| self.colours.get(position as usize).copied().flatten();
        if !self.colours.is_empty() && self.face.positions.iter().any(|position| colour(position).is_some()) {
            polygon.first_colour = Some(scene.colours.len() as u32);
            scene.colours.extend(self.face.positions.iter().map(|position| colour(position).unwrap_or(DVec3::ONE)));
        }
        let first_normal = scene.normals.len();
        let of_corner = |index: &Option<u32>| index.and_then(|index| self.normals.get(index as usize)).copied();
        let usable = self.face.normals.iter().map_while(of_corner).filter(|normal| *normal != DVec3::ZERO);
        scene.normals.extend(usable);
        if scene.normals.len() - first_normal == vertex_count as usize {
            polygon.first_normal = Some(first_normal as u32);
        } else {
            scene.normals.truncate(first_normal);
            if let Some(group) = self.group {
                self.smoothing.add(group, id, keyword.at, &self.face.positions);
            }
        }
        scene.polygons.push(polygon);
        if self.face.normals.iter().any(Option::is_some) && self.face.normals.iter().any(Option::is_none) {
            let what = format_args!(" with normals at some corners, expected all or none: the face does without");
            self.warn("mixed-normals", keyword, what);
        }
    }

    fn smoothing_group(&mut self) {
        let word = self.cursor.expected_token_on_line();
        let group = if word.bytes == b"off" {
            Some(0)
        } else {
            integer(word.bytes).and_then(|group| u32::try_from(group).ok())
        };
        if group.is_none() {
            let what = format_args!(
                ", expected a smoothing group, a whole number from 0 to {}, or off: is read as off",
                u32::MAX
            );
            self.warn("smoothing-group", word, what);
        }
        self.group = group.filter(|&group| group != 0);
    }

    fn use_material(&mut self, keyword: Token<'a>) {
        let name = self.cursor.rest_of_line();
        if name.bytes.is_empty() {
            self.warn(
                "nameless-material",
                keyword,
                format_args!(" without a name, expected a material's: white is used"),
            );
        }
        self.uses.add(name);
    }

    fn library(&mut self, keyword: Token<'a>) {
        let line = self.cursor.rest_of_line();
        if line.bytes.is_empty() {
            self.warn(
                "nameless-library",
                keyword,
                format_args!(" without a name, expected a material library's: is ignored"),
            );
        }
        self.libraries.add(line, &self.cursor, &mut self.scene.warnings);
    }

    fn finish(mut self) -> Scene {
        let (source, cursor, file) = (self.source, &self.cursor, &self.source.file);
        let mut warnings = std::mem::take(&mut self.scene.warnings);
        for (_, statement) in &self.unreadable {
            warnings.add(file, "unused-vertex", || {
                let SourceError { file, place, what } = Vertex::fault(statement.clone());
                SourceError { file, place, what: format!("{what}: no face uses this vertex") }
            });
        }
        self.smoothing.smooth(&mut self.scene, self.positions.len(), |at| {
            let what = "the normals around a corner of this face cancel out in its smoothing group: the face is flat";
            warnings.add(file, "smoothing-cancels", || source.error(at, what));
        });
        let (materials, of_libraries, libraries) = self.libraries.finish();
        // Of faces whose material is not there, and of those that name none.
        let white = materials.count();
        let of_uses = self.uses.resolve(&materials, white, |name| {
            warnings.add(file, "undefined-material", || {
                cursor.error(name, format_args!(": no such material, white is used"))
            });
        });
        self.scene.materials = materials.into_list();
        for polygon in &mut self.scene.polygons {
            polygon.material = of_uses[polygon.material as usize];
        }
        if self.scene.polygons.iter().any(|polygon| polygon.material == white) {
            self.scene.materials.push(Material::WHITE);
        }
        warnings.extend(of_libraries);
        Scene { warnings, libraries, ..self.scene }
    }

    fn warn(&mut self, kind: &'static str, word: Token, what: fmt::Arguments) {
        self.cursor.warn(&mut self.scene.warnings, kind, word, what);
    }
}

/// A whole number, as the parts of a corner are.
fn integer(bytes: &[u8]) -> Option<i64> {
    std::str::from_utf8(bytes).ok()?.parse().ok()
}

/// Where an index of a file points, from 0: it counts from 1, or from −1 backwards.
fn place(index: i64, defined: usize) -> Option<u32> {
    let from_zero = if index < 0 { index.checked_add(defined as i64)? } else { index - 1 };
    u32::try_from(from_zero).ok().filter(|&place| (place as usize) < defined)
}
