//! The Neutral File Format of Eric Haines (NFF, drafts of 1987 to 1996), complete.
//!
//! Entities, as many as you like, in any order; numbers may be spread over lines; `#` starts a comment:
//!
//! | entity | meaning |
//! |---|---|
//! | `v from x y z at x y z up x y z angle a hither h resolution w h` | the view; hither is read and ignored |
//! | `b r g b` | background, black without |
//! | `l x y z [r g b]` | light; without a colour its brightness is 1/√(number of lights) |
//! | `f r g b Kd Ks shine T ior` | material of what follows; white and diffuse without |
//! | `s x y z radius` | sphere; negative: seen from the inside only |
//! | `c x y z radius x y z radius` | open cone or cylinder; both negative: seen from the inside only |
//! | `p n` and n × `x y z` | polygon, concave ones allowed |
//! | `pp n` and n × `x y z nx ny nz` | polygon with vertex normals |

mod view;

use std::fmt;
use std::path::Path;

use glam::DVec3;

use super::cursor::{Cursor, Field, Token};
use super::source::Source;
use super::{Cone, Light, Material, Polygon, Scene, SourceError, Sphere};
use view::View;

/// Larger files are refused. A vertex takes at least six bytes, so no index outgrows 32 bits.
pub const FILE_BYTES_MAX: u64 = 4 << 30;

/// More lights than this are refused: every hit casts a shadow ray to each.
pub const LIGHTS_MAX: usize = 4096;

pub(super) const COORDINATE: Field = Field { name: "a coordinate", min: -1e30, max: 1e30 };
pub(super) const NORMAL: Field = Field { name: "a normal's component", min: -1e30, max: 1e30 };
pub(super) const COLOUR: Field = Field { name: "a colour's component", min: 0.0, max: 1e6 };
const KD: Field = Field { name: "Kd", min: 0.0, max: 1e6 };
const KS: Field = Field { name: "Ks", min: 0.0, max: 1e6 };
const SHINE: Field = Field { name: "shine", min: 0.0, max: 1e9 };
const TRANSMITTANCE: Field = Field { name: "T", min: 0.0, max: 1.0 };
const IOR: Field = Field { name: "an index of refraction", min: 0.0, max: 1e6 };
const RADIUS: Field = Field { name: "a radius", min: -1e30, max: 1e30 };

/// Reads an NFF file.
///
/// # Errors
/// It cannot be read, is larger than [`FILE_BYTES_MAX`], or its first mistake, with line and column.
pub fn load(path: &Path) -> Result<Scene, SourceError> {
    parse(&Source::read(path, FILE_BYTES_MAX)?)
}

fn parse(source: &Source) -> Result<Scene, SourceError> {
    let mut reader = Reader {
        cursor: Cursor::new(source),
        scene: Scene { file: Some(source.file.clone()), ..Scene::default() },
        plain_lights: Vec::new(),
    };
    reader.cursor.warn_of_stray_end(&mut reader.scene.warnings);
    reader.entities()?;
    Ok(reader.finish())
}

struct Reader<'a> {
    cursor: Cursor<'a>,
    scene: Scene,
    /// Lights without a colour: their brightness is known when all lights are counted.
    plain_lights: Vec<usize>,
}

impl Reader<'_> {
    /// A word that starts no entity is an error: numbers may spread over lines, so nothing shows where the next
    /// entity starts.
    fn entities(&mut self) -> Result<(), SourceError> {
        let mut is_empty = true;
        loop {
            let keyword = self.cursor.token();
            match keyword.bytes {
                b"p" => self.polygon(false)?,
                b"pp" => self.polygon(true)?,
                b"s" => self.sphere()?,
                b"c" => self.cone(keyword)?,
                b"f" => self.material()?,
                b"l" => self.light(keyword)?,
                b"v" => self.view(keyword)?,
                b"b" => self.scene.background = self.cursor.clamped_triple(&COLOUR, &mut self.scene.warnings)?,
                // A file that says nothing is none.
                b"" if !is_empty => return Ok(()),
                _ => return Err(self.cursor.error(keyword, format_args!(", expected v, b, l, f, s, c, p, pp or #"))),
            }
            is_empty = false;
        }
    }

    fn finish(mut self) -> Scene {
        let brightness = 1.0 / (self.scene.lights.len() as f64).sqrt();
        for light in self.plain_lights {
            self.scene.lights[light].colour = DVec3::splat(brightness);
        }
        self.scene
    }

    fn polygon(&mut self, smooth: bool) -> Result<(), SourceError> {
        let line = self.cursor.line();
        let word = self.cursor.token();
        let vertex_count = self.cursor.parse_count(word, "a polygon's vertex count", 0, u32::MAX)?;
        // A coordinate takes a blank and a digit: what the file cannot hold is refused before it is read.
        let vertex_bytes_min = if smooth { 12 } else { 6 };
        let vertices_max = self.cursor.remaining() / vertex_bytes_min;
        if vertex_count as usize > vertices_max {
            let what = format_args!(
                " vertices are too many, expected at most the {vertices_max} that the rest of the file can hold"
            );
            return Err(self.cursor.error(word, what));
        }
        let (first_vertex, first_normal) = (self.scene.vertices.len(), self.scene.normals.len());
        let mut has_normals = smooth;
        for _ in 0..vertex_count {
            let vertex = self.cursor.triple(&COORDINATE)?;
            self.scene.vertices.push(vertex);
            if smooth {
                match self.normal()? {
                    Some(normal) => self.scene.normals.push(normal),
                    None => has_normals = false,
                }
            }
        }
        if !has_normals {
            self.scene.normals.truncate(first_normal);
        }
        if vertex_count < 3 {
            self.scene.vertices.truncate(first_vertex);
            self.scene.normals.truncate(first_normal);
            self.warn(
                "short-face",
                word,
                format_args!(" vertices are too few, expected at least 3: the polygon is left out"),
            );
            return Ok(());
        }
        if vertex_count > 3 {
            self.scene.polygon_lines.push((self.scene.polygons.len() as u32, line));
        }
        let material = self.current_material();
        self.scene.polygons.push(Polygon {
            first_vertex: first_vertex as u32,
            vertex_count,
            first_normal: has_normals.then_some(first_normal as u32),
            first_colour: None,
            material,
        });
        Ok(())
    }

    /// `None`, with a warning, for one of length zero.
    fn normal(&mut self) -> Result<Option<DVec3>, SourceError> {
        let mut ahead = self.cursor.clone();
        let normal = self.cursor.triple(&NORMAL)?.try_normalize();
        if normal.is_none() {
            let what = " starts a normal without a direction, expected one longer than 0: the polygon is flat";
            self.warn("zero-normal", ahead.token(), format_args!("{what}"));
        }
        Ok(normal)
    }

    fn sphere(&mut self) -> Result<(), SourceError> {
        let centre = self.cursor.triple(&COORDINATE)?;
        let word = self.cursor.token();
        let radius = self.cursor.parse_number(word, &RADIUS)?;
        if radius == 0.0 {
            let what = format_args!(" is no radius, expected one other than 0: the sphere is left out");
            self.warn("sphere-without-radius", word, what);
            return Ok(());
        }
        let material = self.current_material();
        self.scene.spheres.push(Sphere { centre, radius, material });
        Ok(())
    }

    fn cone(&mut self, keyword: Token) -> Result<(), SourceError> {
        let base = self.cursor.triple(&COORDINATE)?;
        let base_radius = self.cursor.number(&RADIUS)?;
        let apex = self.cursor.triple(&COORDINATE)?;
        let apex_word = self.cursor.token();
        let apex_radius = self.cursor.parse_number(apex_word, &RADIUS)?;
        if base_radius * apex_radius < 0.0 {
            let what = format_args!(" is an apex radius of the other sign, expected both positive or both negative");
            return Err(self.cursor.error(apex_word, what));
        }
        if (apex - base).try_normalize().is_none() {
            let what = format_args!(" without height, expected an apex away from the base: the cone is left out");
            self.warn("cone-without-surface", keyword, what);
            return Ok(());
        }
        if base_radius == 0.0 && apex_radius == 0.0 {
            let what = format_args!(" is the second radius that is 0, expected at most one: the cone is left out");
            self.warn("cone-without-surface", apex_word, what);
            return Ok(());
        }
        let material = self.current_material();
        self.scene.cones.push(Cone { base, base_radius, apex, apex_radius, material });
        Ok(())
    }

    fn material(&mut self) -> Result<(), SourceError> {
        let (cursor, warnings) = (&mut self.cursor, &mut self.scene.warnings);
        let colour = cursor.clamped_triple(&COLOUR, warnings)?;
        let (kd, ks) = (cursor.clamped_number(&KD, warnings)?, cursor.clamped_number(&KS, warnings)?);
        let shine = cursor.clamped_number(&SHINE, warnings)?;
        let transmittance = cursor.clamped_number(&TRANSMITTANCE, warnings)?;
        let mut ahead = cursor.clone();
        let mut ior = cursor.clamped_number(&IOR, warnings)?;
        // An opaque surface has no use for an index, and SPD writes 0 there.
        if transmittance > 0.0 && ior == 0.0 {
            let what = " is no index of refraction where T is above 0, expected one above 0: 1 is used";
            self.warn("refractive-index", ahead.token(), format_args!("{what}"));
            ior = 1.0;
        }
        self.scene.materials.push(Material::from_nff(colour, kd, ks, shine, transmittance, ior));
        Ok(())
    }

    /// Index of the last material, a white and diffuse one when the file has named none yet: the format
    /// has no default.
    #[inline]
    fn current_material(&mut self) -> u32 {
        if self.scene.materials.is_empty() {
            self.scene.materials.push(Material::WHITE);
        }
        self.scene.materials.len() as u32 - 1
    }

    fn light(&mut self, keyword: Token) -> Result<(), SourceError> {
        let position = self.cursor.triple(&COORDINATE)?;
        let mut ahead = self.cursor.clone();
        let is_plain = ahead.token_on_line().is_none();
        let colour =
            if is_plain { DVec3::ONE } else { self.cursor.clamped_triple(&COLOUR, &mut self.scene.warnings)? };
        if self.scene.lights.len() == LIGHTS_MAX {
            let what = format_args!(" is one too many, expected at most {LIGHTS_MAX} lights: it is left out");
            self.warn("too-many-lights", keyword, what);
            return Ok(());
        }
        if is_plain {
            self.plain_lights.push(self.scene.lights.len());
        }
        self.scene.lights.push(Light { position, colour });
        Ok(())
    }

    fn view(&mut self, keyword: Token) -> Result<(), SourceError> {
        let mut view = View::default();
        loop {
            let before = self.cursor.clone();
            let name = self.cursor.token();
            if !view.read(name, &mut self.cursor, &mut self.scene.warnings)? {
                self.cursor = before;
                break;
            }
        }
        if self.scene.camera.is_some() {
            self.warn("second-view", keyword, format_args!(" is a second view, expected one: the first counts"));
            return Ok(());
        }
        let camera = view.camera().map_err(|what| self.cursor.error(keyword, format_args!(": {what}")))?;
        self.scene.camera = Some(camera);
        Ok(())
    }

    fn warn(&mut self, kind: &'static str, word: Token, what: fmt::Arguments) {
        self.cursor.warn(&mut self.scene.warnings, kind, word, what);
    }
}

#[cfg(test)]
mod tests;
