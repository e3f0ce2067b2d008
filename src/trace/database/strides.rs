//! How far apart the records of each section are.

use super::section::Section;

/// Most bytes of a record, 31 lines of 16: wherever it begins, it lies in 32 lines at most, which one fetch can name.
pub const STRIDE_MAX: u32 = 31 * 16;

/// Bytes from one record of a section to the next, by section: the record's content, then padding. A record counts as a
/// whole, with its padding.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Strides([u32; Section::COUNT]);

/// A section whose records cannot be so far apart.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
#[error(
    "records of {bytes} bytes in section {}, expected a multiple of 4 from {} to {STRIDE_MAX}",
    section.name(),
    section.content_bytes()
)]
pub struct StrideError {
    pub section: Section,
    pub bytes: u32,
}

impl Strides {
    /// Nothing is padded.
    pub const CONTENT: Self = {
        let mut bytes = [0; Section::COUNT];
        let mut i = 0;
        while i < Section::COUNT {
            bytes[i] = Section::ALL[i].content_bytes() as u32;
            i += 1;
        }
        Self(bytes)
    };

    /// # Errors
    /// A stride is no whole number of words, is less than the content, or is more than [`STRIDE_MAX`].
    pub fn new(bytes: [u32; Section::COUNT]) -> Result<Self, StrideError> {
        for section in Section::ALL {
            let bytes = bytes[section as usize];
            let least = section.content_bytes() as u32;
            if !bytes.is_multiple_of(4) || !(least..=STRIDE_MAX).contains(&bytes) {
                return Err(StrideError { section, bytes });
            }
        }
        Ok(Self(bytes))
    }

    pub fn of(self, section: Section) -> u32 {
        self.0[section as usize]
    }

    /// By section.
    pub fn bytes(self) -> [u32; Section::COUNT] {
        self.0
    }
}
