//! How large a local memory is, and how it is divided.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::hardware::specification;
use trace::database::Layout;

/// Fewer lines make no memory: the lines of a record alone would drive each other out.
pub const LINES_MIN: u64 = specification::LocalMemory::LINES_MIN;

/// Bytes of a line of a database.
const LINE_BYTES_MIN: u32 = 16;
pub const LINE_BYTES_MAX: u32 = 256;

/// A local memory of `sets` sets of `ways` lines, as large as it was asked to be, for a database of `database_lines` lines.
///
/// Line `n` of the database belongs to set `n mod sets`.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Geometry {
    /// A power of two, 16 to 256; up to 65,536 for a trace that came from elsewhere.
    pub line_bytes: u32,
    pub database_lines: u32,
    pub sets: u64,
    pub ways: u64,
}

/// One node's local memory, as it was made of what was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct MemoryShape {
    /// For which it has room, in whole sets.
    pub local_bytes: u64,
    pub sets: u64,
    /// The ways; of a fully associative memory, all of its lines.
    pub lines_per_set: u64,
}

impl From<Geometry> for MemoryShape {
    fn from(geometry: Geometry) -> Self {
        Self { local_bytes: geometry.local_bytes(), sets: geometry.sets, lines_per_set: geometry.ways }
    }
}

/// Sets and ways that lines of the database can ever fill: those of a memory that is larger than the database need not be there
/// to be counted.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Slots {
    pub sets: u32,
    pub ways: u32,
}

impl Slots {
    /// More are not simulated: twice the lines of the largest database.
    pub const COUNT_MAX: u64 = 1 << 29;

    pub fn count(self) -> u32 {
        self.sets * self.ways
    }
}

/// Why a local memory cannot be made as its topology says. Each says what was expected.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum GeometryError {
    #[error("a line of {line_bytes} bytes: expected a power of two, 16 to {max}")]
    Line { line_bytes: u32, max: u32 },
    #[error("a share of {numerator}/{denominator}: expected above 0 and at most 1")]
    Share { numerator: u32, denominator: u32 },
    #[error("{bytes} bytes are {} lines of {line_bytes} bytes: expected at least {LINES_MIN} lines, {} bytes",
            bytes / u64::from(*line_bytes), LINES_MIN * u64::from(*line_bytes))]
    TooSmall { bytes: u64, line_bytes: u32 },
    #[error("{ways} ways in a memory of {lines} lines: expected 1 to {lines}")]
    Ways { ways: u32, lines: u64 },
    #[error("{sets} sets of {ways} ways that are referenced: expected at most {} lines in all", Slots::COUNT_MAX)]
    TooManySlots { sets: u64, ways: u64 },
    #[error("plru on sets of {ways} lines in a memory of {lines} lines: expected a power of two of lines in a set, such as {}",
            1u64 << ways.ilog2())]
    WaysOfTree { ways: u64, lines: u64 },
    #[error("the database is empty: expected at least one record")]
    EmptyImage,
}

impl Geometry {
    /// Resolves a topology's local memory for a database, as [`Self::of_lines`] does.
    ///
    /// # Errors
    /// As of `of_lines`; a line that is not a power of two, 16 to 256.
    pub fn new(memory: &specification::LocalMemory, layout: &Layout) -> Result<Self, GeometryError> {
        Self::check_line(memory.line, LINE_BYTES_MAX)?;
        // Sections fill whole granules, and these are lines: at most 2³² bytes in lines of at least 16.
        Self::of_lines(memory, (layout.database_bytes() / u64::from(memory.line)) as u32)
    }

    /// # Errors
    /// A line that is not a power of two, 16 to `max`.
    pub fn check_line(line_bytes: u32, max: u32) -> Result<(), GeometryError> {
        let is_possible = line_bytes.is_power_of_two() && (LINE_BYTES_MIN..=max).contains(&line_bytes);
        if is_possible { Ok(()) } else { Err(GeometryError::Line { line_bytes, max }) }
    }

    /// Resolves a local memory for a database of so many lines of its size. Bytes and shares are rounded down to whole lines, and
    /// these to whole sets; a share is never less than [`LINES_MIN`] lines, and `all` is rounded up to whole sets.
    ///
    /// # Errors
    /// A value is out of its range, or there are fewer lines than ways.
    pub fn of_lines(memory: &specification::LocalMemory, database_lines: u32) -> Result<Self, GeometryError> {
        if database_lines == 0 {
            return Err(GeometryError::EmptyImage);
        }
        let line_bytes = memory.line;
        let lines = Self::lines_asked(memory.size, line_bytes, database_lines)?;
        let ways = memory.ways.map_or(lines, u64::from);
        let (sets, is_possible) = match memory.size {
            specification::MemorySize::All => (lines.div_ceil(ways.max(1)), ways > 0),
            _ => (lines / ways.max(1), (1..=lines).contains(&ways)),
        };
        if !is_possible {
            return Err(GeometryError::Ways { ways: memory.ways.unwrap_or(0), lines });
        }
        if memory.replacement == specification::Replacement::Plru && !ways.is_power_of_two() {
            return Err(GeometryError::WaysOfTree { ways, lines });
        }
        Ok(Self { line_bytes, database_lines, sets, ways })
    }

    fn lines_asked(
        size: specification::MemorySize,
        line_bytes: u32,
        database_lines: u32,
    ) -> Result<u64, GeometryError> {
        let (line, all) = (u64::from(line_bytes), u64::from(database_lines));
        match size {
            specification::MemorySize::All => Ok(all.max(LINES_MIN)),
            specification::MemorySize::Share { numerator, denominator } => {
                if numerator == 0 || numerator > denominator {
                    return Err(GeometryError::Share { numerator, denominator });
                }
                Ok((all * u64::from(numerator) / u64::from(denominator)).max(LINES_MIN))
            }
            specification::MemorySize::Bytes(bytes) if bytes < LINES_MIN * line => {
                Err(GeometryError::TooSmall { bytes, line_bytes })
            }
            specification::MemorySize::Bytes(bytes) => Ok(bytes / line),
        }
    }

    /// As large as the memory is.
    pub fn lines(&self) -> u64 {
        self.sets * self.ways
    }

    /// Bytes of data for which the memory has room.
    pub fn local_bytes(&self) -> u64 {
        self.lines() * u64::from(self.line_bytes)
    }

    /// What the lines of a database without gaps can fill: line `n` belongs to set `n mod sets` of these too.
    pub fn slots(&self) -> Slots {
        let lines = u64::from(self.database_lines);
        let sets = self.sets.min(lines);
        // At most the database's lines, and so many bits.
        Slots { sets: sets as u32, ways: self.ways.min(lines.div_ceil(sets)) as u32 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hardware::specification::MemorySize::{All, Bytes, Share};

    /// An image of so many granules of 256 bytes, all octree nodes.
    fn image(granules: u64) -> Layout {
        Layout::new([granules * 64, 0, 0, 0, 0, 0, 0, 0, 0]).expect("small")
    }

    fn memory(size: specification::MemorySize, line: u32, ways: Option<u32>) -> specification::LocalMemory {
        specification::LocalMemory { size, line, ways, replacement: specification::Replacement::Lru }
    }

    #[test]
    fn sizes_are_resolved() {
        let share = |numerator, denominator| Share { numerator, denominator };
        // Granules of the image, size, line, ways; sets and ways expected.
        let table = [
            (1000, share(1, 8), 64, None, (1, 500)),
            (1001, share(1, 8), 64, None, (1, 500)),   // 500.5 lines
            (1000, share(1, 8), 64, Some(8), (62, 8)), // 500 lines are 62 sets and 4 lines
            (1000, share(1, 1), 256, Some(1), (1000, 1)),
            (1000, share(1, 4096), 256, None, (1, 16)), // the least
            (1000, Bytes(4096), 64, None, (1, 64)),
            (1000, Bytes(4096 + 63), 64, Some(4), (16, 4)),
            (1000, Bytes(1 << 40), 64, Some(4), (1 << 32, 4)), // larger than the image
            (1000, All, 16, None, (1, 16_000)),
            (10, Bytes(1 << 20), 256, Some(7), (585, 7)),
            (10, All, 256, Some(7), (3, 7)),      // all of it has room
            (3, Bytes(4096), 256, None, (1, 16)), // a small image
            (3, All, 256, Some(16), (1, 16)),
            (1 << 24, All, 16, None, (1, 1 << 28)), // the largest image
        ];
        for (granules, size, line, ways, expected) in table {
            let geometry = Geometry::new(&memory(size, line, ways), &image(granules)).expect("within ranges");
            assert_eq!((geometry.sets, geometry.ways), expected, "{granules} {size:?} {line} {ways:?}");
        }
    }

    #[test]
    fn what_cannot_be_filled_has_no_slot() {
        let geometry = |database_lines, sets, ways| Geometry { line_bytes: 16, database_lines, sets, ways };
        for (geometry, sets, ways) in [
            (geometry(10, 585, 7), 10, 1),
            (geometry(10, 3, 7), 3, 4),
            (geometry(10, 3, 2), 3, 2),
            (geometry(10, 1, 1 << 36), 1, 10),
            (geometry(1 << 28, (1 << 28) - 1, 16), (1 << 28) - 1, 2),
        ] {
            assert_eq!(geometry.slots(), Slots { sets, ways }, "{geometry:?}");
            assert!(u64::from(geometry.slots().count()) <= Slots::COUNT_MAX);
        }
    }

    #[test]
    fn errors_say_what_was_expected() {
        let share = |numerator, denominator| Share { numerator, denominator };
        let table = [
            (memory(All, 48, None), "a line of 48 bytes: expected a power of two, 16 to 256"),
            (memory(All, 512, None), "a line of 512 bytes: expected a power of two, 16 to 256"),
            (memory(All, 0, None), "a line of 0 bytes: expected a power of two, 16 to 256"),
            (memory(share(9, 8), 64, None), "a share of 9/8: expected above 0 and at most 1"),
            (memory(share(0, 0), 64, None), "a share of 0/0: expected above 0 and at most 1"),
            (memory(Bytes(512), 64, None), "512 bytes are 8 lines of 64 bytes: expected at least 16 lines, 1024 bytes"),
            (memory(Bytes(1024), 64, Some(17)), "17 ways in a memory of 16 lines: expected 1 to 16"),
            (memory(Bytes(1024), 64, Some(0)), "0 ways in a memory of 16 lines: expected 1 to 16"),
        ];
        for (memory, expected) in table {
            let error = Geometry::new(&memory, &image(1000)).expect_err(expected);
            assert_eq!(error.to_string(), expected);
        }
        assert_eq!(Geometry::new(&memory(All, 64, None), &image(0)), Err(GeometryError::EmptyImage));
    }

    #[test]
    fn a_tree_needs_a_power_of_two_of_ways() {
        let geometry = |size, ways| {
            let plru =
                specification::LocalMemory { replacement: specification::Replacement::Plru, ..memory(size, 64, ways) };
            Geometry::new(&plru, &image(1000)).map(|geometry| (geometry.sets, geometry.ways))
        };
        assert_eq!(geometry(Share { numerator: 1, denominator: 8 }, Some(8)), Ok((62, 8)));
        assert_eq!(geometry(Bytes(4096), None), Ok((1, 64)));
        let table = [
            (Share { numerator: 1, denominator: 8 }, None, "sets of 500 lines in a memory of 500 lines", 256),
            (Bytes(4096), Some(3), "sets of 3 lines in a memory of 64 lines", 2),
        ];
        for (size, ways, what, example) in table {
            let expected = format!("plru on {what}: expected a power of two of lines in a set, such as {example}");
            assert_eq!(geometry(size, ways).map_err(|error| error.to_string()), Err(expected));
        }
    }
}
