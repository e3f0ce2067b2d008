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
            let keyword = self.cursor.token();
            match keyword.bytes {
                b"p" => self.polygon(false)?,
                b"pp" => self.polygon(true)?,
                b"s" => self.sphere()?,
                b"c" => self.cone(keyword)?,
                b"f" => self.material()?,
                b"l" => self.light(keyword)?,
                b"v" => self.view(keyword)?,
                b"b" => self.scene.background = self.cursor.triple(&COLOUR)?,
                // A file that says nothing is none.
                b"" if self.scene != Scene::default() => return Ok(()),
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
        let word = self.cursor.token();
        let vertex_count = self.cursor.parse_count(word, "a polygon's vertex count", 3, u32::MAX)?;
        // A coordinate takes a blank and a digit: what the file cannot hold is refused before it is read.
        let vertex_bytes_min = if smooth { 12 } else { 6 };
        let vertices_max = self.cursor.remaining() / vertex_bytes_min;
        if vertex_count as usize > vertices_max {
            let what = format_args!(
                " vertices are too many, expected at most the {vertices_max} that the rest of the file can hold"
            );
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
        self.scene.polygons.push(Polygon { first_vertex, vertex_count, first_normal, first_colour: None, material });
        Ok(())
    }

    fn normal(&mut self) -> Result<DVec3, SourceError> {
        let mut ahead = self.cursor.clone();
        let normal = self.cursor.triple(&NORMAL)?;
        normal.try_normalize().ok_or_else(|| {
            let word = ahead.token();
            self.cursor.error(word, format_args!(" starts a normal without a direction, expected one longer than 0"))
        })
    }

    fn sphere(&mut self) -> Result<(), SourceError> {
        let centre = self.cursor.triple(&COORDINATE)?;
        let word = self.cursor.token();
        let radius = self.cursor.parse_number(word, &RADIUS)?;
        if radius == 0.0 {
            return Err(self.cursor.error(word, format_args!(" is no radius, expected one other than 0")));
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
        let word = cursor.token();
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

    fn light(&mut self, keyword: Token) -> Result<(), SourceError> {
        if self.scene.lights.len() == LIGHTS_MAX {
            return Err(self
                .cursor
                .error(keyword, format_args!(" is one too many, expected at most {LIGHTS_MAX} lights")));
        }
        let position = self.cursor.triple(&COORDINATE)?;
        let colour = match self.cursor.token_on_line() {
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

    fn view(&mut self, keyword: Token) -> Result<(), SourceError> {
        if self.scene.camera.is_some() {
            return Err(self.cursor.error(keyword, format_args!(" is a second view, expected one")));
        }
        let mut view = View::default();
        loop {
            let before = self.cursor.clone();
            let name = self.cursor.token();
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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn read(text: impl Into<Vec<u8>>) -> Result<Scene, String> {
        parse(&Source::from_bytes("x.nff", text)).map_err(|error| error.to_string())
    }

    const EVERYTHING: &str = "\
# Everything the format has.
b 0.1 0.2 0.3
v
from 0 -5 1
at 0 0 0
up 0 0 1
angle 40
hither 0.1
resolution 320 240
l 1 2 3
l 4 5 6 0.5 0.25 1e0 # with a colour
f 1 .5 0 0.5 0.25 10 0 0
s 1 2 3 -0.5
c 0 0 0 1 0 0 2 0
c
 0 0 0 -1
 0 0 2 -2
f 1 1 1 +1 0 5. 0.5 1.5
p 4
 0 0 0
 2 0 0 # a comment within
 2 2 0
 1 1 0
pp 3
0 0 0  0 0 2
1 0 0  0 3 4
0 1 0  1 0 0
";

    #[test]
    fn every_entity_is_read() {
        let scene = read(EVERYTHING).expect("valid");
        let v = DVec3::new;
        assert_eq!(scene.background, v(0.1, 0.2, 0.3));
        let camera = scene.camera.expect("a camera");
        assert_eq!((camera.from, camera.at, camera.up), (v(0.0, -5.0, 1.0), DVec3::ZERO, DVec3::Z));
        assert_eq!((camera.angle_degrees, camera.resolution), (40.0, Some((320, 240))));
        assert_eq!(scene.lights[0], Light { position: v(1.0, 2.0, 3.0), colour: DVec3::splat(1.0 / 2f64.sqrt()) });
        assert_eq!(scene.lights[1], Light { position: v(4.0, 5.0, 6.0), colour: v(0.5, 0.25, 1.0) });
        assert_eq!(scene.materials[0], Material::from_nff(v(1.0, 0.5, 0.0), 0.5, 0.25, 10.0, 0.0, 0.0));
        assert_eq!(scene.materials[1], Material::from_nff(DVec3::ONE, 1.0, 0.0, 5.0, 0.5, 1.5));
        assert_eq!(scene.spheres, [Sphere { centre: v(1.0, 2.0, 3.0), radius: -0.5, material: 0 }]);
        let cone = |base_radius, apex_radius| Cone {
            base: DVec3::ZERO,
            base_radius,
            apex: v(0.0, 0.0, 2.0),
            apex_radius,
            material: 0,
        };
        assert_eq!(scene.cones, [cone(1.0, 0.0), cone(-1.0, -2.0)]);
        let polygon = |first_vertex, vertex_count, first_normal| Polygon {
            first_vertex,
            vertex_count,
            first_normal,
            first_colour: None,
            material: 1,
        };
        assert_eq!(scene.polygons, [polygon(0, 4, None), polygon(4, 3, Some(0))]);
        assert_eq!(scene.corners(&scene.polygons[0])[3], v(1.0, 1.0, 0.0));
        assert_eq!(scene.normals, [DVec3::Z, v(0.0, 3.0, 4.0).normalize(), DVec3::X]);
    }

    #[test]
    fn line_ends_and_byte_order_marks_of_other_systems_are_read() {
        let windows = format!("\u{feff}{}", EVERYTHING.replace('\n', "\r\n"));
        assert_eq!(read(windows), read(EVERYTHING));
        assert_eq!(read(EVERYTHING.trim_end()), read(EVERYTHING));
    }

    #[test]
    fn without_entities_there_are_defaults() {
        assert_eq!(read("b 0 0 1").map(|scene| scene.background), Ok(DVec3::Z));
        let scene = read("s 0 0 0 1#one\nf 1 0 0 1 0 1 0 1 s 1 1 1 1").expect("valid");
        assert_eq!(scene.materials[0], Material::WHITE);
        assert_eq!((scene.spheres[0].material, scene.spheres[1].material), (0, 1));
    }

    #[test]
    fn mistakes_are_told_with_their_place() {
        let lights = "l 0 0 0\n".repeat(LIGHTS_MAX + 1);
        let table: &[(&[u8], &str)] = &[
            (b"", "1:1: the file ends here, expected v, b, l, f, s, c, p, pp or #"),
            (b"# only a comment\n", "2:1: the file ends here, expected v, b, l, f, s, c, p, pp or #"),
            (b"x 1", "1:1: \"x\", expected v, b, l, f, s, c, p, pp or #"),
            (b"s 0 0 0 1 2", "1:11: \"2\", expected v, b, l, f, s, c, p, pp or #"),
            (
                b"\x7fELF\x02\x01\x01\0\0",
                "1:1: \"\\x7fELF\\x02\\x01\\x01\\x00\\x00\", expected v, b, l, f, s, c, p, pp or #",
            ),
            (b"s 0 0 \xff\xfe 1", "1:7: \"\\xff\\xfe\" is not a number, expected a coordinate from -1e30 to 1e30"),
            (b"s 0 0 \0 1", "1:7: \"\\x00\" is not a number, expected a coordinate from -1e30 to 1e30"),
            (b"s 0 0 0", "1:8: the file ends here, expected a radius from -1e30 to 1e30"),
            (b"# \n\ns 0 0 0 0", "3:9: \"0\" is no radius, expected one other than 0"),
            (b"s nan 0 0 1", "1:3: \"nan\" is out of range, expected a coordinate from -1e30 to 1e30"),
            (b"s 0 -inf 0 1", "1:5: \"-inf\" is out of range, expected a coordinate from -1e30 to 1e30"),
            (b"s 0 1e400 0 1", "1:5: \"1e400\" is out of range, expected a coordinate from -1e30 to 1e30"),
            (b"s 0 2e30 0 1", "1:5: \"2e30\" is out of range, expected a coordinate from -1e30 to 1e30"),
            (b"s 0 0,5 0 1", "1:5: \"0,5\" is not a number, expected a coordinate from -1e30 to 1e30"),
            (b"f 1 1 1 -1 0 1 0 1", "1:9: \"-1\" is out of range, expected Kd from 0 to 1e6"),
            (b"f 1 1 1 1 -0.1 1 0 1", "1:11: \"-0.1\" is out of range, expected Ks from 0 to 1e6"),
            (b"f 1 1 1 1 0 1 1.5 1", "1:15: \"1.5\" is out of range, expected T from 0 to 1"),
            (b"f 1 1 1 1 0 1 0.5 0", "1:19: \"0\" is no index of refraction where T is above 0, expected one above 0"),
            (b"f 1 -1 1 1 0 1 0 1", "1:5: \"-1\" is out of range, expected a colour's component from 0 to 1e6"),
            (
                b"p 2\n0 0 0\n1 1 1",
                "1:3: \"2\", expected a polygon's vertex count, a whole number from 3 to 4294967295",
            ),
            (b"p -3", "1:3: \"-3\", expected a polygon's vertex count, a whole number from 3 to 4294967295"),
            (b"p 3.5", "1:3: \"3.5\", expected a polygon's vertex count, a whole number from 3 to 4294967295"),
            (
                b"p 4000000000\n0 0 0\n",
                "1:3: \"4000000000\" vertices are too many, expected at most the 1 that the rest of the file can hold",
            ),
            (
                b"p 99999999999",
                "1:3: \"99999999999\", expected a polygon's vertex count, a whole number from 3 to 4294967295",
            ),
            (b"p 3\n0.5 0.5 0\n1 0 0\n0 1 ", "4:5: the file ends here, expected a coordinate from -1e30 to 1e30"),
            (
                b"pp 3\n0 0 0 0 0 0\n1 0 0 0 0 1\n0 1 0 0 0 1",
                "2:7: \"0\" starts a normal without a direction, expected one longer than 0",
            ),
            (b"c 0 0 0 1 0 0 0 1", "1:1: \"c\" without height, expected an apex away from the base"),
            (b"c 0 0 0 0 0 0 1 0", "1:17: \"0\" is the second radius that is 0, expected at most one"),
            (
                b"c\n0 0 0 1\n0 0 1 -1",
                "3:7: \"-1\" is an apex radius of the other sign, expected both positive or both negative",
            ),
            (b"l 0 0", "1:6: the file ends here, expected a coordinate from -1e30 to 1e30"),
            (b"l 0 0 0 1\ns 0 0 0 1", "2:1: \"s\" is not a number, expected a colour's component from 0 to 1e6"),
            (lights.as_bytes(), "4097:1: \"l\" is one too many, expected at most 4096 lights"),
            (
                b"v\nfrom 1 0 0\nat 0 0 0\nangle 45\n",
                "1:1: \"v\": the view has no `up`, expected from, at, up and angle",
            ),
        ];
        for (text, expected) in table {
            let error = read(*text).expect_err("malformed");
            assert_eq!(error, format!("x.nff:{expected}"), "{}", text.escape_ascii());
        }
    }

    #[test]
    fn impossible_views_are_told_with_their_place() {
        for (right, wrong, expected) in [
            ("at 0 0 0", "at 0 -5 1", "3:1: \"v\": from and at are the same point, expected two"),
            ("up 0 0 1", "up 0 5 -1", "3:1: \"v\": up is along the view direction, expected it to point aside"),
            ("up 0 0 1", "up 0 0 0", "3:1: \"v\": up has no direction, expected a vector longer than 0"),
            ("up 0 0 1\n", "", "3:1: \"v\": the view has no `up`, expected from, at, up and angle"),
            ("angle 40", "angle 180", "7:7: \"180\" is out of range, expected an angle between 0 and 180"),
            ("angle 40", "angle -1", "7:7: \"-1\" is out of range, expected an angle in degrees from 0 to 180"),
            ("320 240", "0 240", "9:12: \"0\", expected a width in pixels, a whole number from 1 to 65536"),
            ("320 240", "320 65537", "9:16: \"65537\", expected a height in pixels, a whole number from 1 to 65536"),
            ("s 1 2 3 -0.5", "v", "13:1: \"v\" is a second view, expected one"),
        ] {
            let error = read(EVERYTHING.replace(right, wrong)).expect_err("malformed");
            assert_eq!(error, format!("x.nff:{expected}"));
        }
    }

    proptest! {
        #[test]
        fn arbitrary_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            let _ = read(bytes);
        }

        #[test]
        fn a_damaged_file_is_read_or_refused(
            cut in 0..=EVERYTHING.len(),
            at in prop::collection::vec((0..EVERYTHING.len(), prop::sample::select(b"0-19e. \n#pcsvlfb\xff".to_vec())), 0..6),
        ) {
            let mut bytes = EVERYTHING.as_bytes().to_vec();
            for (place, byte) in at {
                bytes[place] = byte;
            }
            bytes.truncate(cut);
            if let Ok(scene) = read(bytes) {
                prop_assert!(scene.vertices.iter().chain(&scene.normals).all(|v| v.is_finite()));
                prop_assert!(scene.polygons.iter().all(|p| (p.material as usize) < scene.materials.len()));
            }
        }
    }
}
