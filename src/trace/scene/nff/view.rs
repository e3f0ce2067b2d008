//! The view of an NFF file, part by part.

use glam::DVec3;

use super::COORDINATE;
use crate::picture::ImageSettings;
use crate::scene::cursor::{Cursor, Field, Judged, Token};
use crate::scene::{Camera, SourceError, Warnings};

const ANGLE: Field = Field { name: "an angle in degrees", min: 0.0, max: 180.0 };
const HITHER: Field = Field { name: "a hither distance", min: -1e30, max: 1e30 };
const SIDE: Field = Field { name: "a side in pixels", min: 1.0, max: ImageSettings::SIDE_MAX as f64 };

/// The parts of a view as they come.
#[derive(Default)]
pub(super) struct View {
    from: Option<DVec3>,
    at: Option<DVec3>,
    up: Option<DVec3>,
    angle_degrees: Option<f64>,
    resolution: Option<(u32, u32)>,
}

impl View {
    /// Reads one part; `false` when the word names none.
    pub(super) fn read(
        &mut self,
        name: Token,
        cursor: &mut Cursor,
        warnings: &mut Warnings,
    ) -> Result<bool, SourceError> {
        match name.bytes {
            b"from" => self.from = Some(cursor.triple(&COORDINATE)?),
            b"at" => self.at = Some(cursor.triple(&COORDINATE)?),
            b"up" => self.up = Some(cursor.triple(&COORDINATE)?),
            b"angle" => {
                let word = cursor.token();
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
                let words = [cursor.token(), cursor.token()];
                let [mut width, mut height] = [0, 0];
                for (side, word) in [(&mut width, words[0]), (&mut height, words[1])] {
                    match Cursor::judge(word, &SIDE) {
                        Judged::Fits(number) if number.fract() == 0.0 => *side = number as u32,
                        Judged::Useless => return Err(cursor.bad_number(word, &SIDE)),
                        _ => {
                            let what = format_args!(", expected {SIDE}, a whole number: the resolution is left out");
                            cursor.warn(warnings, "resolution", word, what);
                        }
                    }
                }
                self.resolution = (width > 0 && height > 0).then_some((width, height));
            }
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// The whole view.
    ///
    /// # Errors
    /// A part is missing, or they make no view together.
    pub(super) fn camera(self) -> Result<Camera, String> {
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
