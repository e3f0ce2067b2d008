//! How large a local memory is, and how it is divided.

use crate::hardware::specification;
use trace::database::Layout;

/// Fewer lines make no memory: the lines of a record alone would drive each other out.
pub const LINES_MIN: u64 = specification::LocalMemory::LINES_MIN;

/// A local memory of `sets` sets of `ways` lines, for an image of `database_lines` lines.
///
/// Line `n` of the image belongs to set `n mod sets`.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Geometry {
    /// A power of two, 16 to 256.
    pub line_bytes: u32,
    pub database_lines: u32,
    pub sets: u32,
    pub ways: u32,
}

/// Why a local memory cannot be made as its topology says. Each says what was expected.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum GeometryError {
    #[error("a line of {0} bytes: expected a power of two, 16 to 256")]
    Line(u32),
    #[error("a share of {numerator}/{denominator}: expected above 0 and at most 1")]
    Share { numerator: u32, denominator: u32 },
    #[error("{bytes} bytes are {} lines of {line_bytes} bytes: expected at least {LINES_MIN} lines, {} bytes",
            bytes / u64::from(*line_bytes), LINES_MIN * u64::from(*line_bytes))]
    TooSmall { bytes: u64, line_bytes: u32 },
    #[error("{ways} ways in a memory of {lines} lines: expected 1 to {lines}")]
    Ways { ways: u32, lines: u32 },
    #[error("plru on sets of {ways} lines in a memory of {lines} lines: expected a power of two of lines in a set, such as {}",
            1u32 << ways.ilog2())]
    WaysOfTree { ways: u32, lines: u32 },
    #[error("the database is empty: expected at least one record")]
    EmptyImage,
}

impl Geometry {
    /// Resolves a topology's local memory for an image. A size is rounded down to whole lines, and these to
    /// whole sets; a share is never less than [`LINES_MIN`] lines, and no memory has more lines than the image.
    ///
    /// # Errors
    /// A value is out of its range, or there are fewer lines than ways.
    pub fn new(memory: &specification::LocalMemory, layout: &Layout) -> Result<Self, GeometryError> {
        Self::of_database(memory, layout.database_bytes())
    }

    /// [`Self::new`] for an image of so many bytes, a multiple of 256, at most 2³².
    ///
    /// # Errors
    /// As of `new`.
    pub fn of_database(memory: &specification::LocalMemory, database_bytes: u64) -> Result<Self, GeometryError> {
        let line_bytes = memory.line;
        if !line_bytes.is_power_of_two() || !(16..=256).contains(&line_bytes) {
            return Err(GeometryError::Line(line_bytes));
        }
        if database_bytes == 0 {
            return Err(GeometryError::EmptyImage);
        }
        assert!(
            database_bytes.is_multiple_of(u64::from(line_bytes)),
            "sections fill whole granules, and these are lines"
        );
        // At most 2³² bytes in lines of at least 16.
        let database_lines = (database_bytes / u64::from(line_bytes)) as u32;

        let asked = Self::lines_asked(memory.size, line_bytes, database_bytes)?;
        let ways = memory.ways.unwrap_or(u32::MAX);
        if ways == 0 || memory.ways.is_some_and(|ways| u64::from(ways) > asked) {
            return Err(GeometryError::Ways { ways, lines: u32::try_from(asked).unwrap_or(u32::MAX) });
        }
        let lines = asked.min(u64::from(database_lines)) as u32;
        let ways = ways.min(lines);
        if memory.replacement == specification::Replacement::Plru && !ways.is_power_of_two() {
            return Err(GeometryError::WaysOfTree { ways, lines });
        }
        Ok(Self { line_bytes, database_lines, sets: lines / ways, ways })
    }

    fn lines_asked(
        size: specification::MemorySize,
        line_bytes: u32,
        database_bytes: u64,
    ) -> Result<u64, GeometryError> {
        let line = u64::from(line_bytes);
        match size {
            specification::MemorySize::All => Ok((database_bytes / line).max(LINES_MIN)),
            specification::MemorySize::Share { numerator, denominator } => {
                if numerator == 0 || numerator > denominator {
                    return Err(GeometryError::Share { numerator, denominator });
                }
                let bytes = u128::from(database_bytes) * u128::from(numerator) / u128::from(denominator);
                Ok((bytes as u64 / line).max(LINES_MIN))
            }
            specification::MemorySize::Bytes(bytes) if bytes < LINES_MIN * line => {
                Err(GeometryError::TooSmall { bytes, line_bytes })
            }
            specification::MemorySize::Bytes(bytes) => Ok(bytes / line),
        }
    }

    pub fn lines(&self) -> u32 {
        self.sets * self.ways
    }

    /// Bytes of data that the memory holds.
    pub fn local_bytes(&self) -> u64 {
        u64::from(self.lines()) * u64::from(self.line_bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hardware::specification::MemorySize::{All, Bytes, Share};

    /// An image of so many granules of 256 bytes, all octree nodes.
    fn image(granules: u64) -> Layout {
        Layout::new([granules * 64, 0, 0, 0, 0, 0, 0, 0]).expect("small")
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
            (1000, Bytes(u64::MAX), 64, Some(4), (1000, 4)), // the image's lines
            (1000, All, 16, None, (1, 16_000)),
            (3, Bytes(4096), 256, None, (1, 3)),    // a small image
            (3, All, 256, Some(16), (1, 3)),        // its lines are fewer than the ways
            (1 << 24, All, 16, None, (1, 1 << 28)), // the largest image
        ];
        for (granules, size, line, ways, expected) in table {
            let geometry = Geometry::new(&memory(size, line, ways), &image(granules)).expect("within ranges");
            assert_eq!((geometry.sets, geometry.ways), expected, "{granules} {size:?} {line} {ways:?}");
            assert!(geometry.lines() <= geometry.database_lines);
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
