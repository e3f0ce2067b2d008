//! Recorded references in the formats of other tools, one a file.
//!
//! [`din`] and [`oracle_general`] are traces of one memory: they get the tiles of one node process in its order. [`csv`]
//! and [`json`] tell each record that was read with all that is known of it. [`chrome`] and [`vcd`] show a simulated
//! bus. None holds more than a part of a recording at a time.

pub mod accesses;
pub mod chrome;
pub mod csv;
pub mod din;
pub mod json;
pub mod oracle_general;
pub mod vcd;

use std::io;

use crate::hardware::references::{Event, ReferenceWord};
use crate::replay::stream::reads;
use crate::replay::{Lines, Trace, TraceError};

/// Why an export ended early.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    #[error(transparent)]
    Trace(#[from] TraceError),
    #[error(transparent)]
    Io(#[from] io::Error),
}

/// What a word says; an error for one of a kind that no version writes yet.
fn decode(word: u32) -> Result<Event, TraceError> {
    ReferenceWord(word).decode().ok_or_else(|| TraceError(format!("{word:#010x} is no word that this version knows")))
}

/// The lines that the words of a part reference, in order, appended to `referenced`.
fn line_references(words: &[u32], lines: &impl Lines, referenced: &mut Vec<u32>) -> Result<(), TraceError> {
    reads::for_each(words, lines, |first, count| referenced.extend(first..first + count))
}

/// The parts of the tiles in order: the tile's place among these, and the part's number.
fn parts<'a>(trace: &'a (impl Trace + ?Sized), tiles: &'a [u32]) -> impl Iterator<Item = (u32, u32)> + 'a {
    (0..)
        .zip(tiles)
        .flat_map(|(place, &tile)| trace.tiles()[tile as usize].parts.clone().map(move |part| (place, part)))
}

#[cfg(test)]
mod bus_tests;
#[cfg(test)]
mod tests;
