//! Where a trace comes from: a file or standard input, plain or compressed.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor, Read};
use std::path::Path;

use super::compression::Compression;
use trace::scene::SourceError;

/// The path that stands for standard input.
pub const STANDARD_INPUT: &str = "-";

const BUFFER_BYTES: usize = 1 << 18;

/// How much of a trace is looked at to recognise its format.
const PREFIX_BYTES: usize = 1 << 12;

/// A trace, decompressed, and its beginning.
pub(super) struct Input<'a> {
    /// At most [`PREFIX_BYTES`]; all of a shorter trace.
    pub(super) prefix: Vec<u8>,
    /// All of it.
    pub(super) reader: Box<dyn BufRead + 'a>,
}

impl<'a> Input<'a> {
    /// Opens what a person chose.
    ///
    /// # Errors
    /// It cannot be read, or not be decompressed.
    pub(super) fn open(path: &Path) -> Result<Self, SourceError> {
        let whole = |error: io::Error| SourceError::new(path, None, error.to_string());
        if path.as_os_str() == STANDARD_INPUT {
            return Self::new(io::stdin().lock()).map_err(whole);
        }
        let file = File::open(path).map_err(whole)?;
        Self::new(file).map_err(whole)
    }

    /// # Errors
    /// Its beginning cannot be read, or not be decompressed.
    pub(super) fn new(input: impl Read + 'a) -> io::Result<Self> {
        let (prefix, input) = begin(BufReader::with_capacity(BUFFER_BYTES, input), Compression::PREFIX_BYTES)?;
        let Some(compression) = Compression::of(&prefix) else {
            let (prefix, reader) = begin(input, PREFIX_BYTES)?;
            return Ok(Self { prefix, reader: Box::new(reader) });
        };
        let plain = BufReader::with_capacity(BUFFER_BYTES, compression.decompress(input));
        let (prefix, reader) = begin(plain, PREFIX_BYTES)?;
        Ok(Self { prefix, reader: Box::new(reader) })
    }
}

/// The first bytes, as many as there are, and all of it.
fn begin<R: BufRead>(mut input: R, bytes: usize) -> io::Result<(Vec<u8>, io::Chain<Cursor<Vec<u8>>, R>)> {
    let mut prefix = Vec::new();
    input.by_ref().take(bytes as u64).read_to_end(&mut prefix)?;
    Ok((prefix.clone(), Cursor::new(prefix).chain(input)))
}
