//! How far apart the records of each section are.

use super::section::Section;

/// Most bytes of a record, 31 lines of 16: wherever it begins, it lies in 32 lines at most, which one fetch can name.
pub const STRIDE_MAX: u32 = 31 * 16;

/// Most bytes of a section's record.
const fn stride_max(section: Section) -> u32 {
    match section {
        Section::OctreeNodes | Section::LeafLists => section.content_bytes() as u32,
        _ => STRIDE_MAX,
    }
}

/// Bytes from one record of a section to the next, by section: the record's content, then padding. A record counts as a
/// whole, with its padding. Octree nodes and leaf entries, of a word each, have none.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Strides([u32; Section::COUNT]);

/// A section whose records cannot be so far apart.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
#[error(
    "records of {bytes} bytes in section {}, expected a multiple of 4 from {} to {}",
    section.name(),
    section.content_bytes(),
    stride_max(*section)
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
    /// A stride is no whole number of words, is less than the content, or is more than [`STRIDE_MAX`], or octree nodes or leaf entries have padding.
    pub fn new(bytes: [u32; Section::COUNT]) -> Result<Self, StrideError> {
        for section in Section::ALL {
            let bytes = bytes[section as usize];
            let least = section.content_bytes() as u32;
            if !bytes.is_multiple_of(4) || !(least..=stride_max(section)).contains(&bytes) {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_record_is_refused() {
        let with = |section: Section, bytes| {
            let mut strides = Strides::CONTENT.bytes();
            strides[section as usize] = bytes;
            Strides::new(strides)
        };
        for section in Section::ALL {
            let content = section.content_bytes() as u32;
            assert_eq!(with(section, content), Ok(Strides::CONTENT));
            let is_word = content == 4;
            for bytes in [content + 4, STRIDE_MAX] {
                assert_eq!(with(section, bytes).is_err(), is_word, "{section:?} of {bytes}");
            }
            for bytes in [0, content - 4, content + 2, STRIDE_MAX + 4, u32::MAX] {
                assert_eq!(with(section, bytes), Err(StrideError { section, bytes }));
            }
        }
        let error = with(Section::LeafLists, 8).expect_err("of a word").to_string();
        assert_eq!(error, "records of 8 bytes in section leaf_lists, expected a multiple of 4 from 4 to 4");
    }
}
