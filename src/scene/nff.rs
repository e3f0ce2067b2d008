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

use std::path::Path;

use glam::DVec3;

use super::cursor::{Cursor, Field, Word};
use super::source::Source;
use super::{Camera, Cone, Light, Material, Polygon, Scene, SourceError, Sphere};
use crate::tracer::view::ImageSettings;

/// Larger files are refused. A vertex takes at least six bytes, so no index outgrows 32 bits.
pub const FILE_BYTES_MAX: u64 = 4 << 30;

/// More lights than this are refused: every hit casts a shadow ray to each.
pub const LIGHTS_MAX: usize = 4096;

pub(super) const COORDINATE: Field = Field { name: "a coordinate", min: -1e30, max: 1e30 };
const NORMAL: Field = Field { name: "a normal's component", min: -1e30, max: 1e30 };
const COLOUR: Field = Field { name: "a colour's component", min: 0.0, max: 1e6 };
const KD: Field = Field { name: "Kd", min: 0.0, max: 1e6 };
const KS: Field = Field { name: "Ks", min: 0.0, max: 1e6 };
const SHINE: Field = Field { name: "shine", min: 0.0, max: 1e9 };
const TRANSMITTANCE: Field = Field { name: "T", min: 0.0, max: 1.0 };
const IOR: Field = Field { name: "an index of refraction", min: 0.0, max: 1e6 };
const RADIUS: Field = Field { name: "a radius", min: -1e30, max: 1e30 };
const ANGLE: Field = Field { name: "an angle in degrees", min: 0.0, max: 180.0 };
const HITHER: Field = Field { name: "a hither distance", min: -1e30, max: 1e30 };

/// Reads an NFF file.
///
/// # Errors
/// It cannot be read, is larger than [`FILE_BYTES_MAX`], or its first mistake, with line and column.
pub fn load(path: &Path) -> Result<Scene, SourceError> {
    parse(&Source::read(path, FILE_BYTES_MAX)?)
}

fn parse(source: &Source) -> Result<Scene, SourceError> {
    let mut reader = Reader { cursor: Cursor::new(source), scene: Scene::default(), plain_lights: Vec::new() };
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
    fn entities(&mut self) -> Result<(), SourceError> {
        loop {
            let keyword = self.cursor.word();
            match keyword.bytes {
                b"p" => self.polygon(false)?,
                b"pp" => self.polygon(true)?,
                b"s" => self.sphere()?,
                b"c" => self.cone(keyword)?,
                b"f" => self.material()?,
                b"l" => self.light(keyword)?,
                b"v" => self.view(keyword)?,
                b"b" => self.scene.background = self.cursor.triple(&COLOUR)?,
                b"" => return Ok(()),
                _ => return Err(self.cursor.error(keyword, format_args!(", expected v, b, l, f, s, c, p, pp or #"))),
            }
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
        let (word, vertex_count) = self.cursor.count("a polygon's vertex count", 3, u32::MAX)?;
        // A coordinate takes a blank and a digit: what the file cannot hold is refused before it is read.
        let vertex_bytes_min = if smooth { 12 } else { 6 };
        let vertices_max = self.cursor.remaining() / vertex_bytes_min;
        if vertex_count as usize > vertices_max {
            let what =
                format_args!(" vertices, expected at most the {vertices_max} that the rest of the file can hold");
            return Err(self.cursor.error(word, what));
        }
        let first_vertex = self.scene.vertices.len() as u32;
        let first_normal = smooth.then_some(self.scene.normals.len() as u32);
        for _ in 0..vertex_count {
            let vertex = self.cursor.triple(&COORDINATE)?;
            self.scene.vertices.push(vertex);
            if smooth {
                let normal = self.normal()?;
                self.scene.normals.push(normal);
            }
        }
        let material = self.current_material();
        self.scene.polygons.push(Polygon { first_vertex, vertex_count, first_normal, material });
        Ok(())
    }

    fn normal(&mut self) -> Result<DVec3, SourceError> {
        let mut ahead = self.cursor.clone();
        let normal = self.cursor.triple(&NORMAL)?;
        normal.try_normalize().ok_or_else(|| {
            let word = ahead.word();
            self.cursor.error(word, format_args!(" starts a normal without a direction, expected one longer than 0"))
        })
    }

    fn sphere(&mut self) -> Result<(), SourceError> {
        let centre = self.cursor.triple(&COORDINATE)?;
        let word = self.cursor.word();
        let radius = self.cursor.parse_number(word, &RADIUS)?;
        if radius == 0.0 {
            return Err(self.cursor.error(word, format_args!(" is no radius, expected one other than 0")));
        }
        let material = self.current_material();
        self.scene.spheres.push(Sphere { centre, radius, material });
        Ok(())
    }

    fn cone(&mut self, keyword: Word) -> Result<(), SourceError> {
        let base = self.cursor.triple(&COORDINATE)?;
        let base_radius = self.cursor.number(&RADIUS)?;
        let apex = self.cursor.triple(&COORDINATE)?;
        let apex_word = self.cursor.word();
        let apex_radius = self.cursor.parse_number(apex_word, &RADIUS)?;
        if (apex - base).try_normalize().is_none() {
            return Err(self
                .cursor
                .error(keyword, format_args!(" without height, expected an apex away from the base")));
        }
        if base_radius == 0.0 && apex_radius == 0.0 {
            let what = format_args!(" is the second radius that is 0, expected at most one");
            return Err(self.cursor.error(apex_word, what));
        }
        if base_radius * apex_radius < 0.0 {
            let what = format_args!(" is an apex radius of the other sign, expected both positive or both negative");
            return Err(self.cursor.error(apex_word, what));
        }
        let material = self.current_material();
        self.scene.cones.push(Cone { base, base_radius, apex, apex_radius, material });
        Ok(())
    }

    fn material(&mut self) -> Result<(), SourceError> {
        let cursor = &mut self.cursor;
        let colour = cursor.triple(&COLOUR)?;
        let (kd, ks) = (cursor.number(&KD)?, cursor.number(&KS)?);
        let (shine, transmittance) = (cursor.number(&SHINE)?, cursor.number(&TRANSMITTANCE)?);
        let word = cursor.word();
        let ior = cursor.parse_number(word, &IOR)?;
        // An opaque surface has no use for an index, and SPD writes 0 there.
        if transmittance > 0.0 && ior == 0.0 {
            let what = format_args!(" is no index of refraction where T is above 0, expected one above 0");
            return Err(cursor.error(word, what));
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

    fn light(&mut self, keyword: Word) -> Result<(), SourceError> {
        if self.scene.lights.len() == LIGHTS_MAX {
            return Err(self
                .cursor
                .error(keyword, format_args!(" is one too many, expected at most {LIGHTS_MAX} lights")));
        }
        let position = self.cursor.triple(&COORDINATE)?;
        let colour = match self.cursor.word_on_line() {
            Some(red) => {
                let red = self.cursor.parse_number(red, &COLOUR)?;
                DVec3::new(red, self.cursor.number(&COLOUR)?, self.cursor.number(&COLOUR)?)
            }
            None => {
                self.plain_lights.push(self.scene.lights.len());
                DVec3::ONE
            }
        };
        self.scene.lights.push(Light { position, colour });
        Ok(())
    }

    fn view(&mut self, keyword: Word) -> Result<(), SourceError> {
        if self.scene.camera.is_some() {
            return Err(self.cursor.error(keyword, format_args!(" is a second view, expected one")));
        }
        let mut view = View::default();
        loop {
            let before = self.cursor.clone();
            let name = self.cursor.word();
            if !view.read(name, &mut self.cursor)? {
                self.cursor = before;
                break;
            }
        }
        let camera = view.camera().map_err(|what| self.cursor.error(keyword, format_args!(": {what}")))?;
        self.scene.camera = Some(camera);
        Ok(())
    }
}

/// The parts of a view as they come.
#[derive(Default)]
struct View {
    from: Option<DVec3>,
    at: Option<DVec3>,
    up: Option<DVec3>,
    angle_degrees: Option<f64>,
    resolution: Option<(u32, u32)>,
}

impl View {
    /// Reads one part; `false` when the word names none.
    fn read(&mut self, name: Word, cursor: &mut Cursor) -> Result<bool, SourceError> {
        let side_max = ImageSettings::SIDE_MAX;
        match name.bytes {
            b"from" => self.from = Some(cursor.triple(&COORDINATE)?),
            b"at" => self.at = Some(cursor.triple(&COORDINATE)?),
            b"up" => self.up = Some(cursor.triple(&COORDINATE)?),
            b"angle" => {
                let word = cursor.word();
                let angle = cursor.parse_number(word, &ANGLE)?;
                if angle == 0.0 || angle == 180.0 {
                    return Err(
                        cursor.error(word, format_args!(" is out of range, expected an angle between 0 and 180"))
                    );
                }
                self.angle_degrees = Some(angle);
            }
            b"hither" => {
                cursor.number(&HITHER)?;
            }
            b"resolution" => {
                let (_, width) = cursor.count("a width in pixels", 1, side_max)?;
                let (_, height) = cursor.count("a height in pixels", 1, side_max)?;
                self.resolution = Some((width, height));
            }
            _ => return Ok(false),
        }
        Ok(true)
    }

    fn camera(self) -> Result<Camera, String> {
        let missing = |part| format!("the view has no `{part}`, expected from, at, up and angle");
        let camera = Camera {
            from: self.from.ok_or_else(|| missing("from"))?,
            at: self.at.ok_or_else(|| missing("at"))?,
            up: self.up.ok_or_else(|| missing("up"))?,
            angle_degrees: self.angle_degrees.ok_or_else(|| missing("angle"))?,
            resolution: self.resolution,
        };
        camera.check()?;
        Ok(camera)
    }
}
