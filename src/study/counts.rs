//! What the local memories of a cluster counted, and the ratios that can be made of it.

use serde::Serialize;

use crate::replay::count::Counters;

/// Of all nodes together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    pub record_accesses: u64,
    /// Record accesses with at least one line missing: each is one transaction on the bus.
    pub misses: u64,
    pub line_accesses: u64,
    pub line_misses: u64,
    /// 32-bit words.
    pub words_read: u64,
    pub words_moved: u64,
}

impl Counts {
    /// `words_read` are those of all record accesses.
    pub fn new(totals: &Counters, words_read: u64, line_bytes: u32) -> Self {
        Self {
            record_accesses: totals.record_accesses,
            misses: totals.record_misses,
            line_accesses: totals.line_accesses,
            line_misses: totals.line_misses,
            words_read,
            words_moved: totals.line_misses * u64::from(line_bytes / 4),
        }
    }

    pub fn bus_bytes(&self) -> u64 {
        4 * self.words_moved
    }
}

/// What "shared memory accesses over local memory accesses" may mean: the paper does not say.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Ratio {
    MissesPerRecordAccess,
    LineMissesPerLineAccess,
    WordsMovedPerWordRead,
    MissesPerWordRead,
}

impl Ratio {
    pub const ALL: [Self; 4] = [
        Self::MissesPerRecordAccess,
        Self::LineMissesPerLineAccess,
        Self::WordsMovedPerWordRead,
        Self::MissesPerWordRead,
    ];

    pub const fn name(self) -> &'static str {
        match self {
            Self::MissesPerRecordAccess => "misses / record accesses",
            Self::LineMissesPerLineAccess => "line misses / line accesses",
            Self::WordsMovedPerWordRead => "words moved / words read",
            Self::MissesPerWordRead => "misses / words read",
        }
    }

    /// 0 where nothing was read.
    pub fn of(self, counts: &Counts) -> f64 {
        let (part, whole) = match self {
            Self::MissesPerRecordAccess => (counts.misses, counts.record_accesses),
            Self::LineMissesPerLineAccess => (counts.line_misses, counts.line_accesses),
            Self::WordsMovedPerWordRead => (counts.words_moved, counts.words_read),
            Self::MissesPerWordRead => (counts.misses, counts.words_read),
        };
        ratio(part, whole)
    }
}

/// 0 of nothing.
pub fn ratio(part: u64, whole: u64) -> f64 {
    if whole == 0 { 0.0 } else { part as f64 / whole as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ratios_are_those_worked_by_hand() {
        // Lines of 16 bytes: seven missing are 28 words.
        let totals = Counters { record_accesses: 100, record_misses: 5, line_accesses: 140, line_misses: 7 };
        let counts = Counts::new(&totals, 400, 16);
        assert_eq!((counts.words_moved, counts.bus_bytes()), (28, 112));
        assert_eq!(Ratio::ALL.map(|ratio| ratio.of(&counts)), [0.05, 0.05, 0.07, 0.0125]);
        assert_eq!(Ratio::ALL.map(|ratio| ratio.of(&Counts::default())), [0.0; 4]);
    }
}
