//! Records with padding, which counts like the rest of them: all their lines are referenced, and fetched where they are
//! missing. Every one of them is gathered, apart from the reads that are to be fast.

use bytemuck::Pod;

use super::{LineSource, LocalMemory, MemoryError, RECORD_LINES_MAX, Replacement, WORD};
use trace::database::strides::STRIDE_MAX;
use trace::database::{Layout, Section};

/// Words of the largest record with padding.
const PADDED_WORDS_MAX: usize = STRIDE_MAX as usize / WORD;
/// Most lines that it touches, of 16 bytes and from the last word of the first one.
const PADDED_LINES_MAX: usize = PADDED_WORDS_MAX / 4 + 1;

/// Where the records of a section lie; none of one whose records have no padding.
#[derive(Clone, Copy, Debug, Default)]
struct PaddedWords {
    /// Words from the start of the image.
    base: u32,
    records: u32,
    /// Words from one record to the next.
    stride: u32,
}

/// The sections whose records are padded.
#[derive(Clone, Copy, Debug)]
pub(super) struct PaddedSections([PaddedWords; Section::COUNT]);

impl PaddedSections {
    pub(super) fn new(layout: &Layout) -> Self {
        Self(Section::ALL.map(|section| {
            if layout.record_bytes(section) == section.content_bytes() {
                return PaddedWords::default();
            }
            let (span, stride) = (layout.span(section), layout.record_bytes(section) / WORD as u64);
            PaddedWords {
                base: (span.base.0 / WORD as u64) as u32,
                records: span.records as u32,
                stride: stride as u32,
            }
        }))
    }

    pub(super) fn contains(&self, section: Section) -> bool {
        self.0[section as usize].stride > 0
    }

    /// Most lines that a record touches, with padding or without.
    pub(super) fn record_lines_max(&self) -> usize {
        if self.0.iter().any(|section| section.stride > 0) { PADDED_LINES_MAX } else { RECORD_LINES_MAX }
    }
}

impl<R: Replacement, S: LineSource> LocalMemory<R, S> {
    /// A record that is not among those without padding.
    #[cold]
    #[inline(never)]
    pub(super) fn padded_record<T: Pod>(
        &mut self,
        section: Section,
        index: u32,
        class: usize,
    ) -> Result<T, MemoryError<S::Error>> {
        let PaddedWords { base, records, stride } = self.padded.0[section as usize];
        if index >= records {
            return Err(MemoryError::OutOfRange { section, index });
        }
        let mut words = [0; PADDED_WORDS_MAX];
        let record = &mut words[..stride as usize];
        self.gather::<PADDED_LINES_MAX>(section, base.wrapping_add(index.wrapping_mul(stride)), class, record)?;
        Ok(bytemuck::pod_read_unaligned(&bytemuck::cast_slice(record)[..size_of::<T>()]))
    }
}
