//! Walking through a scene file word by word, without copying it.

use std::fmt;

use super::{SourceError, Warnings, source::Source};

/// A place in a [`Source`] that moves on. Lines end in LF, CR LF or CR.
#[derive(Clone, Debug)]
pub(super) struct Cursor<'a> {
    source: &'a Source,
    /// Without what other systems put behind the end of a text.
    bytes: &'a [u8],
    at: usize,
    line: u32,
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

/// What a word is where a number is expected.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) enum Judged {
    Fits(f64),
    /// Finite.
    OutOfRange(f64),
    /// Not a number, or an infinite one.
    Useless,
}

impl<'a> Cursor<'a> {
    pub(super) fn new(source: &'a Source) -> Self {
        const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";
        let at = if source.bytes.starts_with(BYTE_ORDER_MARK) { BYTE_ORDER_MARK.len() } else { 0 };
        let text = source.bytes.iter().rposition(|b| !is_stray(*b) && !b.is_ascii_whitespace()).map_or(0, |i| i + 1);
        let stray = source.bytes[text..].iter().position(|&b| is_stray(b));
        let bytes = stray.map_or(&source.bytes[..], |stray| &source.bytes[..text + stray]);
        Self { source, bytes, at: at.min(bytes.len()), line: 1 }
    }

    /// Warns of bytes behind the end of the text: the end mark of old systems (^Z), or NULs that fill a block.
    pub(super) fn warn_of_stray_end(&self, warnings: &mut Warnings) {
        let stray = self.source.bytes.len() - self.bytes.len();
        if stray > 0 {
            warnings.add(&self.source.file, "stray-end", || {
                let what = format!("the file ends in NUL or ^Z ({stray} of them), expected text: they are ignored");
                self.source.error(self.bytes.len(), what)
            });
        }
    }

    /// Bytes that are left.
    pub(super) fn remaining(&self) -> usize {
        self.bytes.len() - self.at
    }

    /// The line, from 1.
    pub(super) fn line(&self) -> u32 {
        self.line
    }

    /// The next word, on this line or a later one; `#` hides the rest of its line.
    #[inline]
    pub(super) fn token(&mut self) -> Token<'a> {
        loop {
            match self.bytes.get(self.at) {
                Some(b'\n' | b'\r' | b'#') => self.skip_line(),
                Some(b) if b.is_ascii_whitespace() => self.at += 1,
                _ => return self.take_token(),
            }
        }
    }

    /// The next word on this line; a backslash at a line's end joins the next one to it.
    #[inline]
    pub(super) fn token_on_line(&mut self) -> Option<Token<'a>> {
        loop {
            match self.bytes.get(self.at..)? {
                [] | [b'\n' | b'\r' | b'#', ..] => return None,
                [b'\\', b'\n' | b'\r', ..] => self.skip_line(),
                [b, ..] if b.is_ascii_whitespace() => self.at += 1,
                _ => break,
            }
        }
        let mut word = self.take_token();
        if let [bytes @ .., b'\\'] = word.bytes
            && matches!(self.bytes.get(self.at), Some(b'\n' | b'\r'))
        {
            self.at -= 1;
            word.bytes = bytes;
        }
        Some(word)
    }

    /// What is left of this line, without blanks around it: a name that may hold blanks.
    pub(super) fn rest_of_line(&mut self) -> Token<'a> {
        let line = self.line_left();
        let at = self.at + line.len() - line.trim_ascii_start().len();
        self.at += line.len();
        Token { at, bytes: line.trim_ascii() }
    }

    /// Moves to the start of the next statement, past all lines that backslashes join to this one; `false` at the
    /// end of the file.
    pub(super) fn next_statement(&mut self) -> bool {
        loop {
            let line = self.line_left();
            let is_joined = line.ends_with(b"\\") && !line.contains(&b'#');
            self.at += line.len();
            self.skip_line();
            if !is_joined {
                return self.at < self.bytes.len();
            }
        }
    }

    #[inline]
    fn line_left(&self) -> &'a [u8] {
        let rest = &self.bytes[self.at..];
        let length = rest.iter().position(|b| matches!(b, b'\n' | b'\r')).unwrap_or(rest.len());
        &rest[..length]
    }

    fn skip_line(&mut self) {
        self.at += self.line_left().len();
        let end = match self.bytes[self.at..] {
            [] => return,
            [b'\r', b'\n', ..] => 2,
            _ => 1,
        };
        self.at += end;
        self.line = self.line.saturating_add(1);
    }

    #[inline]
    fn take_token(&mut self) -> Token<'a> {
        let at = self.at;
        let rest = &self.bytes[at..];
        let mut length = rest.iter().position(|b| b.is_ascii_whitespace() || *b == b'#').unwrap_or(rest.len());
        // How some C libraries write what is not a number: 1.#IND, 1.#QNAN. It is not the number 1.
        if let [b'#', b'I' | b'Q' | b'S', ..] = rest[length..]
            && rest[..length].ends_with(b".")
        {
            length = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        }
        self.at += length;
        Token { at, bytes: &rest[..length] }
    }

    /// An error at a word: what is wrong with it, and what was expected.
    #[cold]
    pub(super) fn error(&self, word: Token, what: fmt::Arguments) -> SourceError {
        let subject = match word.bytes {
            [] if word.at >= self.bytes.len() => "the file ends here".into(),
            [] => "the line ends here".into(),
            _ if !self.source.is_quoted => "a word".into(),
            _ => word.to_string(),
        };
        self.source.error(word.at, format!("{subject}{what}"))
    }

    /// A warning at a word: what is wrong with it, what was expected, and how it is repaired.
    pub(super) fn warn(&self, warnings: &mut Warnings, kind: &'static str, word: Token, what: fmt::Arguments) {
        warnings.add(&self.source.file, kind, || self.error(word, what));
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

    /// The next word on this line as a number.
    #[inline]
    pub(super) fn number_on_line(&mut self, field: &Field) -> Result<f64, SourceError> {
        let word = self.expected_token_on_line();
        self.parse_number(word, field)
    }

    /// The next word as a number; one out of range is brought into it, with a warning.
    pub(super) fn clamped_number(&mut self, field: &Field, warnings: &mut Warnings) -> Result<f64, SourceError> {
        let word = self.token();
        self.clamp_number(word, field, warnings).ok_or_else(|| self.bad_number(word, field))
    }

    /// The next three words as numbers of the same field, each brought into its range with a warning.
    pub(super) fn clamped_triple(
        &mut self,
        field: &Field,
        warnings: &mut Warnings,
    ) -> Result<glam::DVec3, SourceError> {
        let mut next = || self.clamped_number(field, warnings);
        Ok(glam::DVec3::new(next()?, next()?, next()?))
    }

    /// A word as a number, brought into its range with a warning; `None` for what is no number.
    pub(super) fn clamp_number(&self, word: Token, field: &Field, warnings: &mut Warnings) -> Option<f64> {
        match Self::judge(word, field) {
            Judged::Fits(number) => Some(number),
            Judged::OutOfRange(number) => {
                let clamped = number.clamp(field.min, field.max);
                warnings.add(&self.source.file, "out-of-range", || {
                    let SourceError { file, place, what } = self.bad_number(word, field);
                    SourceError { file, place, what: format!("{what}: {} is used", Bound(clamped)) }
                });
                Some(clamped)
            }
            Judged::Useless => None,
        }
    }

    /// The next word on this line, an empty one at its end.
    pub(super) fn expected_token_on_line(&mut self) -> Token<'a> {
        self.token_on_line().unwrap_or(Token { at: self.at, bytes: &[] })
    }

    #[inline]
    pub(super) fn parse_number(&self, word: Token, field: &Field) -> Result<f64, SourceError> {
        match Self::judge(word, field) {
            Judged::Fits(number) => Ok(number),
            _ => Err(self.bad_number(word, field)),
        }
    }

    #[inline]
    pub(super) fn judge(word: Token, field: &Field) -> Judged {
        match word.number() {
            // NaN and the infinities are in no range.
            Some(number) if (field.min..=field.max).contains(&number) => Judged::Fits(number),
            Some(number) if number.is_finite() => Judged::OutOfRange(number),
            _ => Judged::Useless,
        }
    }

    /// An error at a word that is no number of a field.
    #[cold]
    pub(super) fn bad_number(&self, word: Token, field: &Field) -> SourceError {
        match word.number() {
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

    #[inline]
    fn number(self) -> Option<f64> {
        self.text()?.parse().ok()
    }

    /// A name that ends at a comment, if it has one: a blank, and `#`.
    pub(super) fn without_comment(self) -> Self {
        let is_comment = |pair: &[u8]| pair[0].is_ascii_whitespace() && pair[1] == b'#';
        let end = self.bytes.windows(2).position(is_comment).unwrap_or(self.bytes.len());
        Self { at: self.at, bytes: self.bytes[..end].trim_ascii_end() }
    }

    /// Its words, between blanks.
    pub(super) fn words(self) -> impl Iterator<Item = Self> {
        let mut at = self.at;
        self.bytes.split(u8::is_ascii_whitespace).filter_map(move |bytes| {
            let word = Self { at, bytes };
            at += bytes.len() + 1;
            (!bytes.is_empty()).then_some(word)
        })
    }
}

fn is_stray(byte: u8) -> bool {
    matches!(byte, 0 | 0x1a)
}

/// In quotes, shortened, and with what is not printable escaped: it goes to a person's terminal.
impl fmt::Display for Token<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const SHOWN_BYTES_MAX: usize = 40;
        let shown = &self.bytes[..self.bytes.len().min(SHOWN_BYTES_MAX)];
        let more = if shown.len() < self.bytes.len() { "…" } else { "" };
        // The last character may be cut.
        let text = std::str::from_utf8(shown).or_else(|error| match error.error_len() {
            None if !more.is_empty() => std::str::from_utf8(&shown[..error.valid_up_to()]),
            _ => Err(error),
        });
        match text {
            Ok(text) => write!(f, "\"{}{more}\"", text.escape_debug()),
            Err(_) => write!(f, "\"{}{more}\"", shown.escape_ascii()),
        }
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
        if self.0 == 0.0 || (1e-4..1e6).contains(&self.0.abs()) {
            write!(f, "{}", self.0)
        } else {
            write!(f, "{:e}", self.0)
        }
    }
}
