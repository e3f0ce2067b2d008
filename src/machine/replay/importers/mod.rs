//! Other people's traces, to be put through the memories of this program: one format a file.
//!
//! What they hold is references to bytes, or to objects; nothing says which tile or ray they were made for. All of it
//! is one stream of one node.

pub mod csv;
pub mod din;
mod imported;
pub mod oracle_general;
mod table_lines;
mod text_file;

pub use imported::Imported;
pub use table_lines::TableLines;

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use trace::scene::SourceError;

/// Reads a trace's format; errors name the file.
pub type Read = fn(&Path, BufReader<File>) -> Result<Imported, SourceError>;

/// Reads a file that a person chose.
///
/// # Errors
/// The place of what is wrong, and what was expected.
pub fn import(path: &Path, read: Read) -> Result<Imported, SourceError> {
    let file = File::open(path).map_err(|error| SourceError::new(path, None, error.to_string()))?;
    read(path, BufReader::with_capacity(1 << 18, file))
}

#[cfg(test)]
mod tests;
