//! Traces as JSON, an object a line, as `marti replay … --export json` writes them.

use std::io::BufRead;
use std::path::Path;

use serde::Deserialize;

use super::access::{Access, AccessKind};
use super::builder::Builder;
use super::imported::Imported;
use super::text_file::TextFile;
use trace::scene::SourceError;

/// Of an object; what else it has is not used.
#[derive(Deserialize)]
struct Record {
    address: u64,
    #[serde(default = "one")]
    bytes: u32,
}

/// Without a size, a reference is to the line that its address lies in.
fn one() -> u32 {
    1
}

/// Reads a trace of objects with `address`, and perhaps `bytes`: all are reads.
///
/// # Errors
/// The place of what is wrong, and what was expected.
pub fn read(file: &Path, input: impl BufRead, line_bytes: u32) -> Result<Imported, SourceError> {
    let mut text = TextFile::new(file, input);
    let mut builder = Builder::of_bytes().map_err(|what| text.whole(what))?;
    while text.next_line()? {
        if text.line.trim_ascii().is_empty() {
            continue;
        }
        let Record { address, bytes } = serde_json::from_slice(&text.line).map_err(|error| {
            // The place within the line is the error's own.
            let what = error.to_string();
            let what = what.split(" at line ").next().unwrap_or_default();
            let expected = "expected an object on its line, with a number \"address\" and perhaps \"bytes\"";
            text.error(error.column().saturating_sub(1), format!("{what}, {expected}"))
        })?;
        let access = builder.access(Access { kind: AccessKind::Read, address, bytes });
        access.map_err(|what| text.error(0, what))?;
    }
    builder.finish(line_bytes).map_err(|what| text.whole(what))
}
