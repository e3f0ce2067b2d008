//! What follows `v`: three coordinates, and a weight or a colour.

use glam::DVec3;

use crate::scene::cursor::{Cursor, Field, Judged, Token};
use crate::scene::nff::COORDINATE;
use crate::scene::{SourceError, Warnings};

const WEIGHT: Field = Field { name: "a weight", min: -1e30, max: 1e30 };
const COLOUR: Field = Field { name: "a vertex's colour", min: 0.0, max: 1.0 };

pub(super) struct Vertex {
    pub(super) position: DVec3,
    /// Linear RGB.
    pub(super) colour: Option<DVec3>,
}

impl Vertex {
    /// Reads the rest of a statement.
    ///
    /// # Errors
    /// A coordinate or the weight is none.
    pub(super) fn read(cursor: &mut Cursor, warnings: &mut Warnings) -> Result<Self, SourceError> {
        let mut next = || cursor.number_on_line(&COORDINATE);
        let position = DVec3::new(next()?, next()?, next()?);
        let mut others = [Token { at: 0, bytes: &[] }; 5];
        let mut count = 0;
        while let Some(word) = cursor.token_on_line() {
            if let Some(place) = others.get_mut(count) {
                *place = word;
            }
            count += 1;
        }
        match count {
            0 => Ok(Self { position, colour: None }),
            1 => Ok(Self { position: divided(position, others[0], cursor)?, colour: None }),
            2 => {
                let what = " and another word after the coordinates, expected a weight or a colour: both are ignored";
                cursor.warn(warnings, "odd-vertex", others[0], format_args!("{what}"));
                Ok(Self { position, colour: None })
            }
            _ => Ok(Self { position, colour: colour(&others[..count.min(5)], cursor, warnings) }),
        }
    }
}

fn divided(position: DVec3, word: Token, cursor: &Cursor) -> Result<DVec3, SourceError> {
    let position = position / cursor.parse_number(word, &WEIGHT)?;
    // Not so where the weight is 0.
    if position.abs().max_element() <= COORDINATE.max {
        return Ok(position);
    }
    let what =
        format_args!(" is a weight that the coordinates cannot be divided by, expected one that leaves {COORDINATE}");
    Err(cursor.error(word, what))
}

/// Red, green and blue; a fourth word is alpha.
fn colour(words: &[Token], cursor: &Cursor, warnings: &mut Warnings) -> Option<DVec3> {
    let mut colour = DVec3::ZERO;
    for (component, &word) in colour.as_mut().iter_mut().zip(words) {
        *component = match Cursor::judge(word, &COLOUR) {
            Judged::Fits(number) => number,
            Judged::OutOfRange(number) => {
                let is_byte = number > 1.0 && number <= 255.0;
                let bytes = if is_byte { "; colours from 0 to 255 have to be divided by 255" } else { "" };
                let what = format_args!(" is out of range, expected {COLOUR}: it is clamped{bytes}");
                cursor.warn(warnings, "vertex-colour", word, what);
                number.clamp(COLOUR.min, COLOUR.max)
            }
            Judged::Useless => {
                let what = format_args!(" is not a number, expected {COLOUR}: the vertex has none");
                cursor.warn(warnings, "vertex-colour", word, what);
                return None;
            }
        };
    }
    match words {
        [_, _, _, alpha] => {
            cursor.warn(warnings, "vertex-alpha", *alpha, format_args!(" is a vertex's alpha: it is left out"));
        }
        [_, _, _, _, more] => {
            let what = format_args!(" after a vertex's colour, expected the end of the line: is ignored");
            cursor.warn(warnings, "odd-vertex", *more, what);
        }
        _ => {}
    }
    Some(colour)
}
