//! The ratios that can be made of what the local memories of a cluster counted.

use serde::Serialize;

use machine::replay::model::counts::{Counts, ratio};

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

#[cfg(test)]
mod tests {
    use super::*;
    use machine::replay::model::replayer::Counters;

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
