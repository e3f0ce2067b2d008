//! Lists of ids, one a line: each is an object of size 1, as in libCacheSim's `txt`.

use std::io::BufRead;
use std::path::Path;

use super::access::{AccessKind, ObjectId};
use super::builder::Builder;
use super::imported::Imported;
use super::text_file::TextFile;
use trace::scene::SourceError;

/// Reads a list. An id is a number (decimal without leading zeros, or hexadecimal after `0x`) or any other text; blanks
/// around it do not count, and empty lines are left out.
///
/// # Errors
/// The place of what is wrong, and what was expected.
pub fn read(file: &Path, input: impl BufRead, line_bytes: u32) -> Result<Imported, SourceError> {
    let mut text = TextFile::new(file, input);
    let mut builder = Builder::of_objects().map_err(|what| text.whole(what))?;
    while text.next_line()? {
        let id = text.line.trim_ascii();
        if !id.is_empty() {
            builder.object(AccessKind::Read, ObjectId::parse(id), 1).map_err(|what| text.error(0, what))?;
        }
    }
    builder.finish(line_bytes).map_err(|what| text.whole(what))
}
