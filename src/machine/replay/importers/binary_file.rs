//! A file of records of the same size.

use std::io::{self, BufRead};
use std::path::Path;

use trace::scene::SourceError;

pub(super) struct BinaryFile<'a, R> {
    file: &'a Path,
    input: R,
    /// Where the record begins.
    at: u64,
    /// Where the next one does.
    next: u64,
}

impl<'a, R: BufRead> BinaryFile<'a, R> {
    pub(super) fn new(file: &'a Path, input: R) -> Self {
        Self { file, input, at: 0, next: 0 }
    }

    /// Fills the buffer with the next record; `false` at the end of the file.
    ///
    /// # Errors
    /// The file cannot be read, or ends within the record.
    pub(super) fn next_record(&mut self, record: &mut [u8]) -> Result<bool, SourceError> {
        self.at = self.next;
        let mut filled = 0;
        while filled < record.len() {
            match self.input.read(&mut record[filled..]) {
                Ok(0) if filled == 0 => return Ok(false),
                Ok(0) => return Err(self.error(format!("{filled} bytes of a record, expected {}", record.len()))),
                Ok(read) => filled += read,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(self.error(error.to_string())),
            }
        }
        self.next += filled as u64;
        Ok(true)
    }

    /// An error about the record that begins here.
    #[cold]
    pub(super) fn error(&self, what: impl AsRef<str>) -> SourceError {
        SourceError::new(self.file, None, format!("byte {}: {}", self.at, what.as_ref()))
    }

    /// An error about the whole file.
    #[cold]
    pub(super) fn whole(&self, what: impl Into<String>) -> SourceError {
        SourceError::new(self.file, None, what)
    }
}
