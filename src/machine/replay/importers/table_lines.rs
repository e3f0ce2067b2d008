//! Where the records of an imported trace lie: only what is referenced has a place.

use std::sync::Arc;

use crate::replay::Lines;
use trace::database::layout::{DATABASE_BYTES_MAX, GRANULE_BYTES};

/// A reference's bytes are at most so many.
pub(super) const EXTENT_BYTES_MAX: u32 = 1 << 20;

/// Bytes that are referenced together.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(super) struct Extent {
    address: u64,
    bytes: u32,
}

impl Extent {
    /// # Errors
    /// What is wrong, and what was expected.
    pub(super) fn new(address: u64, bytes: u32) -> Result<Self, String> {
        if !(1..=EXTENT_BYTES_MAX).contains(&bytes) {
            return Err(format!("{bytes} bytes, expected 1 to {EXTENT_BYTES_MAX}"));
        }
        if address.checked_add(u64::from(bytes)).is_none() {
            return Err(format!("address {address:#x} and {bytes} bytes, expected an end within 64 bits"));
        }
        Ok(Self { address, bytes })
    }

    /// 32-bit words, a begun one too.
    pub(super) fn words(self) -> u32 {
        self.bytes.div_ceil(4)
    }

    /// The first granule and the last.
    fn granules(self) -> (u64, u64) {
        (self.address / GRANULE_BYTES, (self.address + u64::from(self.bytes) - 1) / GRANULE_BYTES)
    }
}

/// What an extent's address counts.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Unit {
    Bytes,
    /// Objects, each of which is one line, however long lines are.
    Objects,
}

/// The lines of an imported trace.
///
/// Of all memory only the granules of 256 bytes that are referenced are kept, in ascending order, as an image without
/// gaps: its lines are numbered, and a record's lines follow one another. Sets are those of the true addresses.
#[derive(Clone, Debug)]
pub struct TableLines {
    /// The true number of each granule; of each object.
    granules: Arc<[u64]>,
    /// By record, its first byte in the image, and its last.
    records: Arc<[(u32, u32)]>,
    unit: Unit,
    /// A line's bytes are 2 to this power.
    line_shift: u32,
}

impl TableLines {
    /// # Errors
    /// The image would be larger than any database's.
    pub(super) fn new(records: &[Extent], unit: Unit) -> Result<Self, String> {
        let granules = match unit {
            Unit::Bytes => granules(records.iter().map(|extent| extent.granules()).collect())?,
            Unit::Objects => granules(records.iter().map(|object| (object.address, object.address)).collect())?,
        };
        let place = |extent: &Extent| match unit {
            Unit::Bytes => {
                let granule = granules.partition_point(|&granule| granule < extent.granules().0) as u64;
                let first = granule * GRANULE_BYTES + extent.address % GRANULE_BYTES;
                (first as u32, (first + u64::from(extent.bytes) - 1) as u32)
            }
            Unit::Objects => {
                let granule = granules.partition_point(|&granule| granule < extent.address) as u64;
                ((granule * GRANULE_BYTES) as u32, (granule * GRANULE_BYTES) as u32)
            }
        };
        let records = records.iter().map(place).collect();
        Ok(Self { granules: granules.into(), records, unit, line_shift: GRANULE_BYTES.trailing_zeros() })
    }

    /// The same records in lines of so many bytes, a power of two, 16 to 256.
    pub(super) fn with_line(&self, line_bytes: u32) -> Self {
        Self { line_shift: line_bytes.trailing_zeros(), ..self.clone() }
    }

    pub(super) fn database_bytes(&self) -> u64 {
        self.granules.len() as u64 * GRANULE_BYTES
    }

    pub(super) fn records(&self) -> u32 {
        self.records.len() as u32
    }
}

impl Lines for TableLines {
    #[inline(always)]
    fn of(&self, record: u32) -> (u32, u32) {
        let (first, last) = self.records[record as usize];
        let (first, last) = (first >> self.line_shift, last >> self.line_shift);
        (first, last - first + 1)
    }

    fn count(&self) -> u32 {
        (self.database_bytes() >> self.line_shift) as u32
    }

    #[inline(always)]
    fn set(&self, line: u32, sets: u64) -> u64 {
        let granule_shift = GRANULE_BYTES.trailing_zeros() - self.line_shift;
        let granule = self.granules[(line >> granule_shift) as usize];
        let real = match self.unit {
            Unit::Bytes => granule << granule_shift | u64::from(line & ((1 << granule_shift) - 1)),
            Unit::Objects => granule,
        };
        real % sets
    }
}

/// All granules of these ranges, each once, in ascending order.
fn granules(mut ranges: Vec<(u64, u64)>) -> Result<Vec<u64>, String> {
    ranges.sort_unstable();
    ranges.dedup();
    let limit = DATABASE_BYTES_MAX / GRANULE_BYTES - 1;
    let mut granules = Vec::new();
    for (first, last) in ranges {
        // Ranges are in ascending order: what is there already is their beginning.
        let first = granules.last().map_or(first, |&end: &u64| first.max(end.saturating_add(1)));
        granules.extend(first..=last);
        if granules.len() as u64 > limit {
            return Err(format!(
                "references to more than {limit} different objects or granules of {GRANULE_BYTES} bytes, expected fewer"
            ));
        }
    }
    Ok(granules)
}
