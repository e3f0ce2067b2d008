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
    /// Reads the rest of a statement; `None` where a coordinate or the weight is none: [`Self::fault`] says which.
    pub(super) fn read(cursor: &mut Cursor, warnings: &mut Warnings) -> Option<Self> {
        let mut position = DVec3::ZERO;
        for coordinate in position.as_mut() {
            let Judged::Fits(number) = Cursor::judge(cursor.token_on_line()?, &COORDINATE) else { return None };
            *coordinate = number;
        }
        let mut others = [Token { at: 0, bytes: &[] }; 5];
        let mut count = 0;
        while let Some(word) = cursor.token_on_line() {
            if let Some(place) = others.get_mut(count) {
                *place = word;
            }
            count += 1;
        }
        match count {
            0 => Some(Self { position, colour: None }),
            1 => Some(Self { position: divided(position, others[0])?, colour: None }),
            2 => {
                let what = " and another word after the coordinates, expected a weight or a colour: both are ignored";
                cursor.warn(warnings, "odd-vertex", others[0], format_args!("{what}"));
                Some(Self { position, colour: None })
            }
            _ => Some(Self { position, colour: colour(&others[..count.min(5)], cursor, warnings) }),
        }
    }

    /// What is wrong with a statement that cannot be read; the cursor is where [`Self::read`] began.
    pub(super) fn fault(mut cursor: Cursor) -> SourceError {
        for _ in 0..3 {
            if let Err(error) = cursor.number_on_line(&COORDINATE) {
                return error;
            }
        }
        let word = cursor.expected_token_on_line();
        let what = format_args!(
            " is a weight that the coordinates cannot be divided by, expected one that leaves {COORDINATE}"
        );
        cursor.parse_number(word, &WEIGHT).err().unwrap_or_else(|| cursor.error(word, what))
    }
}

/// `None` where the weight is none, or what it leaves no coordinates, as with a weight of 0.
fn divided(position: DVec3, word: Token) -> Option<DVec3> {
    let Judged::Fits(weight) = Cursor::judge(word, &WEIGHT) else { return None };
    Some(position / weight).filter(|position| position.abs().max_element() <= COORDINATE.max)
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
