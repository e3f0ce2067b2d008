//! "Thirty-seven processors per cluster": the bound 1/p, and what it takes for granted.

use serde::Serialize;

use crate::study::figures::conditions::Conditions;
use crate::study::figures::ratio::Ratio;
use crate::study::figures::traffic::Traffic;
use crate::study::published;
use machine::replay::model::counts::ratio;

/// At 1/32 of the database. If a share p of all accesses needs the bus, and each holds it for as long as an access to
/// local memory takes, then 1/p processors that do nothing but access keep it busy all the time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Processors {
    #[serde(flatten)]
    pub conditions: Conditions,
    pub nodes: u16,
    pub misses_per_access: f64,
    /// 1 / that.
    pub by_accesses: f64,
    pub words_moved_per_word_read: f64,
    pub by_words: f64,
    pub words_an_access: f64,
    pub bytes_a_miss: f64,
    /// The bus width, in bytes a cycle, with which a miss takes as long as an access to a local memory that gives a word a
    /// cycle: what `by_accesses` takes for granted. `by_words` takes a word a cycle, four bytes.
    pub presupposed_bus_bytes: f64,
    pub published: u32,
}

impl Processors {
    pub(super) fn of(traffic: &Traffic) -> Option<Self> {
        let size = traffic.size(published::share(32))?;
        let counts = &size.counts;
        let (misses_per_access, words) =
            (size.ratio(Ratio::MissesPerRecordAccess), size.ratio(Ratio::WordsMovedPerWordRead));
        let words_an_access = ratio(counts.words_read, counts.record_accesses);
        let bytes_a_miss = ratio(size.bus_bytes, counts.misses);
        Some(Self {
            conditions: traffic.conditions.clone(),
            nodes: traffic.nodes,
            misses_per_access,
            by_accesses: 1.0 / misses_per_access,
            words_moved_per_word_read: words,
            by_words: 1.0 / words,
            words_an_access,
            bytes_a_miss,
            presupposed_bus_bytes: bytes_a_miss / words_an_access,
            published: published::PROCESSORS,
        })
    }
}
