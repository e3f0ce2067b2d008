//! A text file, line by line, without trusting the length of any.

use std::io::{BufRead, Read};
use std::path::Path;

use trace::scene::SourceError;

/// Bytes of a line, its end included.
const LINE_BYTES_MAX: usize = 1 << 16;

pub(super) struct TextFile<'a, R> {
    file: &'a Path,
    input: R,
    /// Of the line, from 1.
    number: u64,
    /// The line without its end.
    pub(super) line: Vec<u8>,
}

impl<'a, R: BufRead> TextFile<'a, R> {
    pub(super) fn new(file: &'a Path, input: R) -> Self {
        Self { file, input, number: 0, line: Vec::new() }
    }

    /// Moves to the next line; `false` at the end of the file.
    pub(super) fn next_line(&mut self) -> Result<bool, SourceError> {
        const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";
        self.number += 1;
        self.line.clear();
        let read = self.input.by_ref().take(LINE_BYTES_MAX as u64).read_until(b'\n', &mut self.line);
        read.map_err(|error| self.error(0, error.to_string()))?;
        if self.line.is_empty() {
            return Ok(false);
        }
        let whole = self.line.pop_if(|last| *last == b'\n').is_some();
        if !whole && self.line.len() == LINE_BYTES_MAX {
            return Err(self.error(0, format!("a line of {LINE_BYTES_MAX} bytes or more, expected a shorter one")));
        }
        self.line.pop_if(|last| *last == b'\r');
        if self.number == 1 && self.line.starts_with(BYTE_ORDER_MARK) {
            self.line.drain(..BYTE_ORDER_MARK.len());
        }
        Ok(true)
    }

    /// An error at a byte of the line, from 0.
    #[cold]
    pub(super) fn error(&self, at: usize, what: impl Into<String>) -> SourceError {
        let place = (u32::try_from(self.number).unwrap_or(u32::MAX), at as u32 + 1);
        SourceError::new(self.file, Some(place), what)
    }

    /// An error about the whole file.
    #[cold]
    pub(super) fn whole(&self, what: impl Into<String>) -> SourceError {
        SourceError::new(self.file, None, what)
    }
}

/// Bytes that a person wrote, in quotes and shortened.
pub(super) fn quoted(bytes: &[u8]) -> String {
    const SHOWN_BYTES_MAX: usize = 40;
    let shown = &bytes[..bytes.len().min(SHOWN_BYTES_MAX)];
    let more = if shown.len() < bytes.len() { "…" } else { "" };
    format!("\"{}{more}\"", shown.escape_ascii())
}

/// Digits of a base, and nothing else, as a number.
pub(super) fn number(digits: &[u8], radix: u32) -> Option<u64> {
    // `from_str_radix` takes a sign.
    let text = std::str::from_utf8(digits).ok().filter(|text| text.starts_with(|c: char| c.is_digit(radix)))?;
    u64::from_str_radix(text, radix).ok()
}

/// What is after `0x`.
pub(super) fn hexadecimal(bytes: &[u8]) -> Option<&[u8]> {
    bytes.strip_prefix(b"0x").or_else(|| bytes.strip_prefix(b"0X"))
}

/// Where words start that are apart by blanks, and they.
pub(super) fn words(line: &[u8]) -> impl Iterator<Item = (usize, &[u8])> {
    let start = |word: &[u8]| word.as_ptr() as usize - line.as_ptr() as usize;
    line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()).map(move |word| (start(word), word))
}

/// Decimal, or hexadecimal after `0x`.
pub(super) fn unsigned(bytes: &[u8]) -> Option<u64> {
    hexadecimal(bytes).map_or_else(|| number(bytes, 10), |digits| number(digits, 16))
}
