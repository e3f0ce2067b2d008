//! Walking through a scene file word by word, without copying it.

use std::fmt;

use super::{SourceError, source::Source};

/// A place in a [`Source`] that moves on.
#[derive(Clone, Debug)]
pub(super) struct Cursor<'a> {
    source: &'a Source,
    at: usize,
}

/// Bytes between blanks (or before a comment), and where they start.
#[derive(Clone, Copy, Debug)]
pub(super) struct Token<'a> {
    pub(super) at: usize,
    /// Empty at the end of the file.
    pub(super) bytes: &'a [u8],
}

/// What a number stands for, and its range, both ends included.
#[derive(Clone, Copy, Debug)]
pub(super) struct Field {
    pub(super) name: &'static str,
    pub(super) min: f64,
    pub(super) max: f64,
}

impl<'a> Cursor<'a> {
    pub(super) fn new(source: &'a Source) -> Self {
        const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";
        let at = if source.bytes.starts_with(BYTE_ORDER_MARK) { BYTE_ORDER_MARK.len() } else { 0 };
        Self { source, at }
    }

    /// Bytes that are left.
    pub(super) fn remaining(&self) -> usize {
        self.source.bytes.len() - self.at
    }

    /// The next word, on this line or a later one; `#` hides the rest of its line.
    #[inline]
    pub(super) fn token(&mut self) -> Token<'a> {
        let bytes = &self.source.bytes;
        loop {
            match bytes.get(self.at) {
                Some(b) if b.is_ascii_whitespace() => self.at += 1,
                Some(b'#') => self.skip_line(),
                _ => return self.take_token(),
            }
        }
    }

    /// The next word if it stands on this line; a backslash at a line's end joins the next one to it.
    pub(super) fn token_on_line(&mut self) -> Option<Token<'a>> {
        loop {
            match self.source.bytes.get(self.at..)? {
                [b'\\', b'\n', ..] => self.at += 2,
                [b'\\', b'\r', b'\n', ..] => self.at += 3,
                [] | [b'\n' | b'#', ..] => return None,
                [b, ..] if b.is_ascii_whitespace() => self.at += 1,
                _ => return Some(self.take_token()),
            }
        }
    }

    /// What is left of this line, without blanks around it: a name that may hold blanks.
    pub(super) fn rest_of_line(&mut self) -> Token<'a> {
        let rest = &self.source.bytes[self.at..];
        let line = rest.split(|&b| b == b'\n').next().unwrap_or_default();
        let at = self.at + line.len() - line.trim_ascii_start().len();
        self.at += line.len();
        Token { at, bytes: line.trim_ascii() }
    }

    /// Moves to the start of the next line; `false` at the end of the file.
    pub(super) fn next_line(&mut self) -> bool {
        self.skip_line();
        self.at < self.source.bytes.len()
    }

    fn skip_line(&mut self) {
        let rest = &self.source.bytes[self.at..];
        self.at += rest.iter().position(|&b| b == b'\n').map_or(rest.len(), |newline| newline + 1);
    }

    #[inline]
    fn take_token(&mut self) -> Token<'a> {
        let at = self.at;
        let rest = &self.source.bytes[at..];
        let length = rest.iter().position(|b| b.is_ascii_whitespace() || *b == b'#').unwrap_or(rest.len());
        self.at += length;
        Token { at, bytes: &rest[..length] }
    }

    /// An error at a word: what is wrong with it, and what was expected.
    #[cold]
    pub(super) fn error(&self, word: Token, what: fmt::Arguments) -> SourceError {
        let subject = match word.bytes {
            [] if word.at >= self.source.bytes.len() => "the file ends here".into(),
            [] => "the line ends here".into(),
            _ if !self.source.is_quoted => "a word".into(),
            _ => word.to_string(),
        };
        self.source.error(word.at, format!("{subject}{what}"))
    }

    /// The next word as a number.
    #[inline]
    pub(super) fn number(&mut self, field: &Field) -> Result<f64, SourceError> {
        let word = self.token();
        self.parse_number(word, field)
    }

    /// The next three words as numbers of the same field.
    #[inline]
    pub(super) fn triple(&mut self, field: &Field) -> Result<glam::DVec3, SourceError> {
        Ok(glam::DVec3::new(self.number(field)?, self.number(field)?, self.number(field)?))
    }

    /// The next word as a number; it must stand on this line.
    pub(super) fn number_on_line(&mut self, field: &Field) -> Result<(Token<'a>, f64), SourceError> {
        let word = self.expected_token_on_line();
        Ok((word, self.parse_number(word, field)?))
    }

    /// The next word on this line, an empty one at its end.
    pub(super) fn expected_token_on_line(&mut self) -> Token<'a> {
        self.token_on_line().unwrap_or(Token { at: self.at, bytes: &[] })
    }

    /// Nothing but a comment may follow on this line.
    pub(super) fn expect_end_of_line(&mut self) -> Result<(), SourceError> {
        match self.token_on_line() {
            None => Ok(()),
            Some(word) => Err(self.error(word, format_args!(", expected the end of the line"))),
        }
    }

    #[inline]
    pub(super) fn parse_number(&self, word: Token, field: &Field) -> Result<f64, SourceError> {
        let number = word.text().and_then(|text| text.parse::<f64>().ok());
        match number {
            // NaN and the infinities are in no range.
            Some(number) if (field.min..=field.max).contains(&number) => Ok(number),
            _ => Err(self.bad_number(word, number, field)),
        }
    }

    #[cold]
    fn bad_number(&self, word: Token, number: Option<f64>, field: &Field) -> SourceError {
        match number {
            None if word.bytes.is_empty() => self.error(word, format_args!(", expected {field}")),
            None => self.error(word, format_args!(" is not a number, expected {field}")),
            Some(_) => self.error(word, format_args!(" is out of range, expected {field}")),
        }
    }

    /// A word as a whole number from `min` to `max`.
    pub(super) fn parse_count(&self, word: Token, name: &str, min: u32, max: u32) -> Result<u32, SourceError> {
        match word.text().and_then(|text| text.parse().ok()) {
            Some(count) if (min..=max).contains(&count) => Ok(count),
            _ => Err(self.error(word, format_args!(", expected {name}, a whole number from {min} to {max}"))),
        }
    }
}

impl<'a> Token<'a> {
    /// `None` for bytes that are not text.
    #[inline]
    pub(super) fn text(self) -> Option<&'a str> {
        std::str::from_utf8(self.bytes).ok()
    }
}

/// In quotes, shortened, and with what is not printable escaped: it goes to a person's terminal.
impl fmt::Display for Token<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const SHOWN_BYTES_MAX: usize = 40;
        let shown = &self.bytes[..self.bytes.len().min(SHOWN_BYTES_MAX)];
        let more = if shown.len() < self.bytes.len() { "…" } else { "" };
        write!(f, "\"{}{more}\"", shown.escape_ascii())
    }
}

impl fmt::Display for Field {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} from {} to {}", self.name, Bound(self.min), Bound(self.max))
    }
}

/// `1e30` rather than thirty zeros.
struct Bound(f64);

impl fmt::Display for Bound {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0 == 0.0 || (1e-4..1e4).contains(&self.0.abs()) {
            write!(f, "{}", self.0)
        } else {
            write!(f, "{:e}", self.0)
        }
    }
}
