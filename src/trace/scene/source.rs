//! The bytes of a file that a person wrote or chose, read with a bound, and where in them something is.

use std::io::Read;
use std::path::{Path, PathBuf};

use super::SourceError;
use ground::regular_file;

/// The bytes of a file that is not trusted.
#[derive(Clone, Debug)]
pub struct Source {
    pub file: PathBuf,
    pub bytes: Vec<u8>,
    /// Whether errors may show its words.
    pub is_quoted: bool,
}

impl Source {
    /// Reads a whole file.
    ///
    /// # Errors
    /// It cannot be read, is not a regular file (reading a pipe or a device may never end), or is larger
    /// than `bytes_max`.
    pub fn read(file: &Path, bytes_max: u64) -> Result<Self, SourceError> {
        let error = |what: String| SourceError::new(file, None, what);
        let unreadable = |e: std::io::Error| error(format!("cannot be read ({e}), expected a readable file"));
        let opened = regular_file::open(file).map_err(|e| match regular_file::is_refused(&e) {
            true => error(e.to_string()),
            false => unreadable(e),
        })?;
        let too_large = |bytes: u64| error(format!("{bytes} bytes are too many, expected at most {bytes_max}"));
        let bytes = opened.metadata().map_err(unreadable)?.len();
        if bytes > bytes_max {
            return Err(too_large(bytes));
        }
        let mut bytes = Vec::new();
        // One more than is allowed: the file may grow while it is read.
        opened.take(bytes_max + 1).read_to_end(&mut bytes).map_err(unreadable)?;
        if bytes.len() as u64 > bytes_max {
            return Err(too_large(bytes.len() as u64));
        }
        Ok(Self { file: file.to_owned(), bytes: as_utf8(bytes), is_quoted: true })
    }

    /// [`Self::read`] of a file that another file names. Errors say where its mistakes are, and show none of its words:
    /// the file may be one that the author of the other could not read, and the reader of the error should not.
    ///
    /// # Errors
    /// As of `read`.
    pub fn read_unquoted(file: &Path, bytes_max: u64) -> Result<Self, SourceError> {
        Ok(Self { is_quoted: false, ..Self::read(file, bytes_max)? })
    }

    /// An error at a byte of this file. Line and column (in characters) are counted only now.
    pub fn error(&self, at: usize, what: impl Into<String>) -> SourceError {
        let at = at.min(self.bytes.len());
        let is_line_end = |&i: &usize| match self.bytes[i] {
            b'\n' => true,
            b'\r' => self.bytes.get(i + 1) != Some(&b'\n'),
            _ => false,
        };
        let line = 1 + (0..at).filter(is_line_end).count();
        let line_start = (0..at).rev().find(is_line_end).map_or(0, |end| end + 1);
        let column = 1 + String::from_utf8_lossy(&self.bytes[line_start..at]).chars().count();
        let count = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        SourceError::new(&self.file, Some((count(line), count(column))), what)
    }
}

impl Source {
    /// What `file` is named in errors; nothing is read.
    pub fn from_bytes(file: &str, bytes: impl Into<Vec<u8>>) -> Self {
        Self { file: PathBuf::from(file), bytes: as_utf8(bytes.into()), is_quoted: true }
    }
}

/// What begins with a byte-order mark of UTF-16 is UTF-16; other bytes are left as they are.
fn as_utf8(bytes: Vec<u8>) -> Vec<u8> {
    let unit: fn([u8; 2]) -> u16 = match bytes.first_chunk() {
        Some(b"\xff\xfe") => u16::from_le_bytes,
        Some(b"\xfe\xff") => u16::from_be_bytes,
        _ => return bytes,
    };
    let units = bytes[2..].as_chunks().0.iter().map(|&pair| unit(pair));
    let characters = char::decode_utf16(units).map(|character| character.unwrap_or(char::REPLACEMENT_CHARACTER));
    characters.collect::<String>().into_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_count_from_one_in_characters() {
        let source = Source::from_bytes("x", "ab\né f\n\n");
        let place = |at| source.error(at, "").place;
        assert_eq!(place(0), Some((1, 1)));
        assert_eq!(place(2), Some((1, 3)));
        assert_eq!(place(3), Some((2, 1)));
        assert_eq!(place(6), Some((2, 3)), "é is two bytes and one column");
        assert_eq!(place(8), Some((3, 1)));
        assert_eq!(place(9), Some((4, 1)));
        assert_eq!(place(1000), Some((4, 1)), "past the end is the end");
        let source = Source::from_bytes("x", "a\rb\r\nc\r\rd");
        let places: Vec<_> = [0, 1, 2, 3, 4, 5, 8].map(|at| source.error(at, "").place.expect("a place")).into();
        assert_eq!(places, [(1, 1), (1, 2), (2, 1), (2, 2), (2, 3), (3, 1), (5, 1)], "CR, CR LF, CR, CR");
    }

    #[test]
    fn utf_16_is_read_in_both_orders() {
        let text = "v 1 2\nusemtl Größe 🦀\n";
        for to_bytes in [u16::to_le_bytes, u16::to_be_bytes] {
            let units = ['\u{feff}'].into_iter().chain(text.chars()).collect::<String>();
            let mut bytes: Vec<u8> = units.encode_utf16().flat_map(to_bytes).collect();
            assert_eq!(Source::from_bytes("x", bytes.clone()).bytes, text.as_bytes());
            // Half a surrogate pair, and half a unit.
            bytes.extend(to_bytes(0xd800));
            bytes.push(b'x');
            assert_eq!(Source::from_bytes("x", bytes).bytes, format!("{text}\u{fffd}").as_bytes());
        }
    }

    #[test]
    fn what_is_no_bounded_regular_file_is_refused() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let file = folder.path().join("scene.nff");
        std::fs::write(&file, "12345").expect("a file");
        assert_eq!(Source::read(&file, 5).expect("five bytes").bytes, b"12345");
        let what = |path: &Path, bytes_max| Source::read(path, bytes_max).expect_err("refused").what;
        assert_eq!(what(&file, 4), "5 bytes are too many, expected at most 4");
        assert_eq!(what(folder.path(), 4), "is not a regular file, expected one");
        assert_eq!(what(Path::new("/dev/zero"), 4), "is not a regular file, expected one");
        assert!(what(&folder.path().join("none"), 4).starts_with("cannot be read ("));
    }
}
