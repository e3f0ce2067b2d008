//! The counts that are recorded beside this bench, and what is compared with them.

use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

/// Further from what is recorded is an error, in either direction: what became faster is recorded, too.
pub(crate) const TOLERANCE: f64 = 0.01;

#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub(crate) struct Recorded {
    /// Why it was recorded last.
    pub(crate) reason: String,
    /// By whose code: `rustc --version`.
    pub(crate) compiler: String,
    #[serde(rename = "path")]
    pub(crate) counts: Vec<Count>,
}

#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(crate) struct Count {
    #[serde(rename = "name")]
    pub(crate) path: String,
    /// What a path does many times.
    pub(crate) unit: String,
    pub(crate) units: u64,
    /// Of all units together.
    pub(crate) instructions: u64,
}

impl Count {
    fn per_unit(&self) -> f64 {
        self.instructions as f64 / self.units as f64
    }
}

/// Where the counts are.
pub(crate) fn file() -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), "benches", "instructions", "recorded.toml"].iter().collect()
}

impl Recorded {
    /// # Errors
    /// There are no recorded counts, or they cannot be read.
    pub(crate) fn read() -> Result<Self, String> {
        let file = file();
        let named = |error: &dyn std::fmt::Display| format!("{}: {error}", file.display());
        let text = fs::read_to_string(&file).map_err(|error| named(&error))?;
        toml::from_str(&text).map_err(|error| named(&error))
    }

    /// Counted ÷ recorded, per unit; `None` where the path is not recorded.
    pub(crate) fn ratio(&self, count: &Count) -> Option<f64> {
        let recorded = self.counts.iter().find(|recorded| recorded.path == count.path)?;
        Some(count.per_unit() / recorded.per_unit())
    }

    /// Paths that differ too much, or are not recorded at all.
    pub(crate) fn off(&self, counts: &[Count]) -> Vec<String> {
        let off = |count: &&Count| self.ratio(count).is_none_or(|ratio| (ratio - 1.0).abs() > TOLERANCE);
        counts.iter().filter(off).map(|count| count.path.clone()).collect()
    }
}

/// One row per path.
pub(crate) fn table(counts: &[Count], recorded: Option<&Recorded>) -> String {
    let mut text = format!("{:<24}{:>12}{:>16}  {:<12}{:>10}\n", "path", "units", "instructions", "per", "recorded");
    for count in counts {
        let ratio = recorded.and_then(|recorded| recorded.ratio(count));
        let change = ratio.map_or(String::new(), |ratio| format!("{:+.2} %", 100.0 * (ratio - 1.0)));
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{:<24}{:>12}{:>16.1}  {:<12}{change:>10}",
            count.path,
            count.units,
            count.per_unit(),
            count.unit
        );
    }
    text
}
