//! Other people's traces, to be put through the memories of this program: one format a file.
//!
//! What they hold is references to bytes, or to objects; nothing says which tile or ray they were made for. All of it
//! is one stream of one node. [`import`] reads a file or standard input, plain or compressed; each format has a reader of
//! its own besides.

mod access;
mod binary_file;
mod builder;
pub mod champsim;
pub mod compression;
pub mod csv;
mod csv_columns;
mod csv_fields;
pub mod din;
mod format;
pub mod ids;
mod imported;
mod input;
pub mod json;
pub mod lackey;
pub mod oracle_general;
pub mod ramulator;
mod table_lines;
mod text_file;
pub mod vscsi;

pub use access::{Access, AccessKind};
pub use csv_columns::{Column, CsvOptions, Separator};
pub use format::{FORMATS, ImportFormat};
pub use imported::{Imported, Notes};
pub use input::STANDARD_INPUT;
pub use table_lines::TableLines;

use std::io::Read;
use std::path::Path;

use self::input::Input;
use trace::scene::SourceError;

/// Of a line, at most: recordings have lines of at most 256.
pub const LINE_BYTES_MAX: u32 = 1 << 16;

/// How a trace is read.
#[derive(Clone, Debug)]
pub struct ImportOptions {
    /// `None`: it is recognised.
    pub format: Option<ImportFormat>,
    pub csv: CsvOptions,
    /// The shortest lines that it will be asked for; a power of two of 16 or more.
    pub line_bytes_min: u32,
}

/// Reads a file that a person chose, or standard input ([`STANDARD_INPUT`]).
///
/// # Errors
/// The place of what is wrong, and what was expected.
pub fn import(path: &Path, options: &ImportOptions) -> Result<Imported, SourceError> {
    read(path, Input::open(path)?, options)
}

/// Reads a trace, plain or compressed, as if it were a file of this name.
///
/// # Errors
/// As of [`import`].
pub fn import_from(path: &Path, input: impl Read, options: &ImportOptions) -> Result<Imported, SourceError> {
    let input = Input::new(input).map_err(|error| SourceError::new(path, None, error.to_string()))?;
    read(path, input, options)
}

fn read(path: &Path, Input { prefix, reader }: Input<'_>, options: &ImportOptions) -> Result<Imported, SourceError> {
    let Some(format) = options.format.or_else(|| ImportFormat::recognise(path, &prefix)) else {
        let what = format!("its format is not recognised; --import says which, expected one of {FORMATS}");
        return Err(SourceError::new(path, None, what));
    };
    if format != ImportFormat::Csv && options.csv != CsvOptions::default() {
        return Err(SourceError::new(path, None, "this is no table, expected no option of columns"));
    }
    let line_bytes = options.line_bytes_min;
    match format {
        ImportFormat::Din => din::read(path, reader, line_bytes),
        ImportFormat::OracleGeneral => oracle_general::read(path, reader, line_bytes),
        ImportFormat::Csv => csv::read(path, reader, &options.csv, line_bytes),
        ImportFormat::Ids => ids::read(path, reader, line_bytes),
        ImportFormat::Vscsi => vscsi::read(path, reader, line_bytes),
        ImportFormat::Lackey => lackey::read(path, reader, line_bytes),
        ImportFormat::Champsim => champsim::read(path, reader, line_bytes),
        ImportFormat::Ramulator => ramulator::read(path, reader, line_bytes),
        ImportFormat::Json => json::read(path, reader, line_bytes),
    }
}

#[cfg(test)]
mod tests;
