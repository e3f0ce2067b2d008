//! Where each section of the image lies.

use serde::{Deserialize, Serialize};

use super::section::Section;
use super::strides::{StrideError, Strides};
use ground::ids::Address;

/// Every section starts on, and fills, whole granules, so that no line holds bytes of two allocations.
pub const GRANULE_BYTES: u64 = 256;

/// The largest image that the record formats can address, in bytes.
pub const DATABASE_BYTES_MAX: u64 = 1 << 32;

/// A section's place: `records` records from `base` on.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Span {
    pub base: Address,
    pub records: u64,
}

/// The places of all sections. Only what is laid out here is one, so that it is always consistent.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(into = "Counts", try_from = "Counts")]
pub struct Layout {
    strides: Strides,
    /// Apart, as messages and events carry layouts that are to be small.
    spans: Box<[Span; Section::COUNT]>,
    database_bytes: u64,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
#[error("the database would be {bytes} bytes or more, at most {DATABASE_BYTES_MAX} can be addressed")]
pub struct TooLarge {
    /// With the smallest octree.
    pub bytes: u128,
}

/// What decides a layout.
#[derive(Serialize, Deserialize)]
struct Counts {
    records: [u64; Section::COUNT],
    strides: [u32; Section::COUNT],
}

/// Why there is no such layout.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum LayoutError {
    #[error(transparent)]
    TooLarge(#[from] TooLarge),
    #[error(transparent)]
    Stride(#[from] StrideError),
}

impl Layout {
    /// Lays out sections of so many records each, without padding.
    ///
    /// # Errors
    /// The image would be larger than [`DATABASE_BYTES_MAX`].
    pub fn new(records: [u64; Section::COUNT]) -> Result<Self, TooLarge> {
        Self::padded(records, Strides::CONTENT)
    }

    /// Lays out sections of so many records each, so far apart.
    ///
    /// # Errors
    /// The image would be larger than [`DATABASE_BYTES_MAX`].
    pub fn padded(records: [u64; Section::COUNT], strides: Strides) -> Result<Self, TooLarge> {
        let (layout, bytes) = Self::placed(records, strides);
        if bytes > u128::from(DATABASE_BYTES_MAX) { Err(TooLarge { bytes }) } else { Ok(layout) }
    }

    /// The same records without padding.
    pub(super) fn unpadded(&self) -> Self {
        // It is no larger than this one.
        Self::placed(self.spans.map(|span| span.records), Strides::CONTENT).0
    }

    /// Also how many bytes it has: those in it may be cut off.
    fn placed(records: [u64; Section::COUNT], strides: Strides) -> (Self, u128) {
        let mut spans = Box::new([Span::default(); Section::COUNT]);
        let mut base = 0u128;
        for (section, span) in Section::ALL.into_iter().zip(spans.iter_mut()) {
            let records = records[section as usize];
            *span = Span { base: Address(base as u64), records };
            let bytes = u128::from(records) * u128::from(strides.of(section));
            base += bytes.next_multiple_of(u128::from(GRANULE_BYTES));
        }
        (Self { strides, spans, database_bytes: base as u64 }, base)
    }

    pub fn strides(&self) -> Strides {
        self.strides
    }

    /// Bytes of one record with its padding.
    pub fn record_bytes(&self, section: Section) -> u64 {
        u64::from(self.strides.of(section))
    }

    /// Where a record begins.
    pub fn address(&self, section: Section, index: u32) -> Address {
        Address(self.span(section).base.0 + u64::from(index) * self.record_bytes(section))
    }

    /// Whether polygons are objects, so that the octree lists them and none of their triangles.
    pub fn has_polygons(&self) -> bool {
        self.span(Section::Polygons).records > 0
    }

    /// Whether it is one of those that there were before records could be padded and polygons be objects.
    pub fn is_plain(&self) -> bool {
        self.strides == Strides::CONTENT && !self.has_polygons()
    }

    pub fn span(&self, section: Section) -> Span {
        self.spans[section as usize]
    }

    /// Bytes of the whole image, a multiple of [`GRANULE_BYTES`].
    pub fn database_bytes(&self) -> u64 {
        self.database_bytes
    }

    /// Bytes of a section's records, without the filling of its last granule.
    pub fn section_bytes(&self, section: Section) -> u64 {
        self.span(section).records * self.record_bytes(section)
    }

    /// The section an address lies in; addresses in the filling belong to the section before.
    pub fn section_at(&self, address: Address) -> Option<Section> {
        (address.0 < self.database_bytes).then(|| {
            // Empty sections share their base with the next one: the last that starts here and is not empty.
            *Section::ALL
                .iter()
                .rev()
                .find(|&&s| self.span(s).records > 0 && self.span(s).base <= address)
                .unwrap_or(&Section::OctreeNodes)
        })
    }
}

impl From<Layout> for Counts {
    fn from(layout: Layout) -> Self {
        Self { records: layout.spans.map(|span| span.records), strides: layout.strides.bytes() }
    }
}

impl TryFrom<Counts> for Layout {
    type Error = LayoutError;

    fn try_from(counts: Counts) -> Result<Self, LayoutError> {
        Ok(Self::padded(counts.records, Strides::new(counts.strides)?)?)
    }
}
