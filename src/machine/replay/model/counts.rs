//! What the local memories of a cluster counted, with what moved.

use serde::Serialize;

use crate::replay::model::replayer::Counters;

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

    /// Without what moved.
    pub fn counters(&self) -> Counters {
        Counters {
            record_accesses: self.record_accesses,
            record_misses: self.misses,
            line_accesses: self.line_accesses,
            line_misses: self.line_misses,
        }
    }

    pub fn bus_bytes(&self) -> u64 {
        4 * self.words_moved
    }
}

/// 0 of nothing.
pub fn ratio(part: u64, whole: u64) -> f64 {
    if whole == 0 { 0.0 } else { part as f64 / whole as f64 }
}
