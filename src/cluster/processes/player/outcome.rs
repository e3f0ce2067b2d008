//! What came of playing a recording.

use std::fmt::Write;

use serde::Serialize;

use super::Pace;
use super::latency::Latency;

/// All but the upload, unless a name states otherwise.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub struct PlayOutcome {
    pub pace: Pace,
    /// Nodes that sent requests.
    pub nodes: u64,
    pub uploaded_bytes: u64,
    pub upload_seconds: f64,
    pub transactions: u64,
    pub fetches: u64,
    pub bulk_reads: u64,
    /// Modelled: not answered.
    pub jobs: u64,
    pub pixels: u64,
    /// Fetched and read in bulk.
    pub moved_bytes: u64,
    /// Of jobs and pixels.
    pub modelled_bytes: u64,
    /// Answers that were not the recorded ones.
    pub mismatches: u64,
    /// The one of the lowest sequence.
    pub first_mismatch: Option<String>,
    /// From sending a request to having all of its answer, in microseconds; `None` when nothing was answered.
    pub latency_microseconds: Option<Latency>,
    pub seconds: f64,
    /// What the same transactions took when they were recorded.
    pub recorded_seconds: f64,
    pub transactions_per_second: f64,
    /// Of moved bytes.
    pub mebibytes_per_second: f64,
    /// At recorded pace: the most that a request came later than it was due.
    pub late_microseconds_max: Option<f64>,
    /// Why the rest of a damaged recording was not played.
    pub left_out: Option<String>,
}

impl PlayOutcome {
    /// Lines for a person.
    pub fn text(&self) -> String {
        let mut text = String::new();
        let mut line = |name: &str, value: String| {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "{name:<13}{value}");
        };
        let pace = match self.pace {
            Pace::Recorded => "as recorded",
            Pace::Fastest => "as fast as it goes, one request a node at a time",
        };
        line("pace", pace.to_owned());
        line("uploaded", format!("{} bytes in {:.3} s", self.uploaded_bytes, self.upload_seconds));
        line("transactions", format!("{} by {} nodes and the master", self.transactions, self.nodes));
        let [fetches, bulk_reads, jobs, pixels] = [self.fetches, self.bulk_reads, self.jobs, self.pixels];
        line("", format!("{fetches} fetches, {bulk_reads} bulk reads, {jobs} jobs, {pixels} tiles of pixels"));
        line("bytes", format!("{} moved, {} modelled", self.moved_bytes, self.modelled_bytes));
        line("mismatches", self.mismatches.to_string());
        if let Some(first) = &self.first_mismatch {
            line("", format!("first: {first}"));
        }
        match self.latency_microseconds {
            None => line("latency", "nothing was answered".to_owned()),
            Some(Latency { min, mean, p50, p90, p99, max }) => line(
                "latency",
                format!("min {min:.1}, mean {mean:.1}, p50 {p50:.1}, p90 {p90:.1}, p99 {p99:.1}, max {max:.1} us"),
            ),
        }
        line(
            "throughput",
            format!("{:.0} transactions/s, {:.2} MiB/s", self.transactions_per_second, self.mebibytes_per_second),
        );
        line("wall", format!("{:.3} s, recorded in {:.3} s", self.seconds, self.recorded_seconds));
        if let Some(late) = self.late_microseconds_max {
            line("late", format!("at most {late:.1} us"));
        }
        if let Some(why) = &self.left_out {
            line("left out", why.clone());
        }
        text
    }
}
