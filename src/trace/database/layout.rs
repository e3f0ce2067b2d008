//! Where each section of the image lies.

use serde::{Deserialize, Serialize};

use super::records::{Cone, LeafEntry, Material, Normals, OctreeWord, Sphere, Surface, Triangle};
use ground::ids::Address;

/// Every section starts on, and fills, whole granules, so that no line holds bytes of two allocations.
pub const GRANULE_BYTES: u64 = 256;

/// The largest image that the record formats can address, in bytes.
pub const DATABASE_BYTES_MAX: u64 = 1 << 32;

/// One kind of record each, in this order in the image.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u8)]
pub enum Section {
    OctreeNodes,
    LeafLists,
    Triangles,
    Spheres,
    Cones,
    Surfaces,
    Normals,
    Materials,
}

impl Section {
    pub const COUNT: usize = 8;
    pub const ALL: [Self; Self::COUNT] = [
        Self::OctreeNodes,
        Self::LeafLists,
        Self::Triangles,
        Self::Spheres,
        Self::Cones,
        Self::Surfaces,
        Self::Normals,
        Self::Materials,
    ];

    /// Bytes of one record.
    pub const fn record_bytes(self) -> u64 {
        (match self {
            Self::OctreeNodes => size_of::<OctreeWord>(),
            Self::LeafLists => size_of::<LeafEntry>(),
            Self::Triangles => size_of::<Triangle>(),
            Self::Spheres => size_of::<Sphere>(),
            Self::Cones => size_of::<Cone>(),
            Self::Surfaces => size_of::<Surface>(),
            Self::Normals => size_of::<Normals>(),
            Self::Materials => size_of::<Material>(),
        }) as u64
    }

    /// The name used in reports and recordings.
    pub const fn name(self) -> &'static str {
        match self {
            Self::OctreeNodes => "octree_nodes",
            Self::LeafLists => "leaf_lists",
            Self::Triangles => "triangles",
            Self::Spheres => "spheres",
            Self::Cones => "cones",
            Self::Surfaces => "surfaces",
            Self::Normals => "normals",
            Self::Materials => "materials",
        }
    }
}

/// A section's place: `records` records from `base` on.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
pub struct Span {
    pub base: Address,
    pub records: u64,
}

/// The places of all sections. Only [`Layout::new`] makes one, so that it is always consistent.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(into = "[u64; Section::COUNT]", try_from = "[u64; Section::COUNT]")]
pub struct Layout {
    spans: [Span; Section::COUNT],
    database_bytes: u64,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
#[error("the database would be {bytes} bytes or more, at most {DATABASE_BYTES_MAX} can be addressed")]
pub struct TooLarge {
    /// With the smallest octree.
    pub bytes: u128,
}

impl Layout {
    /// Lays out sections of so many records each.
    ///
    /// # Errors
    /// The image would be larger than [`DATABASE_BYTES_MAX`].
    pub fn new(records: [u64; Section::COUNT]) -> Result<Self, TooLarge> {
        let mut spans = [Span::default(); Section::COUNT];
        let mut base = 0u128;
        for (section, span) in Section::ALL.into_iter().zip(&mut spans) {
            let records = records[section as usize];
            *span = Span { base: Address(base as u64), records };
            let bytes = u128::from(records) * u128::from(section.record_bytes());
            base += bytes.next_multiple_of(u128::from(GRANULE_BYTES));
        }
        if base > u128::from(DATABASE_BYTES_MAX) {
            return Err(TooLarge { bytes: base });
        }
        Ok(Self { spans, database_bytes: base as u64 })
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
        self.span(section).records * section.record_bytes()
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

impl From<Layout> for [u64; Section::COUNT] {
    fn from(layout: Layout) -> Self {
        layout.spans.map(|span| span.records)
    }
}

impl TryFrom<[u64; Section::COUNT]> for Layout {
    type Error = TooLarge;

    fn try_from(records: [u64; Section::COUNT]) -> Result<Self, TooLarge> {
        Self::new(records)
    }
}
