//! How long answers took: counted in a fixed number of bins, however many there are.

use std::time::Duration;

use serde::Serialize;

/// Bins of each power of two, so that a bin is at most 1/128 of what it counts.
const BINS: usize = 128;
const SHIFT: u32 = BINS.trailing_zeros();
const COUNT: usize = (u64::BITS - SHIFT + 1) as usize * BINS;

/// A histogram of nanoseconds.
#[derive(Clone, Debug)]
pub(super) struct Latencies {
    bins: Vec<u64>,
    count: u64,
    sum: u128,
    min: u64,
    max: u64,
}

/// Microseconds.
#[derive(Clone, Copy, PartialEq, Debug, Default, Serialize)]
pub struct Latency {
    pub min: f64,
    pub mean: f64,
    /// These three are at most 0.8% too large.
    pub p50: f64,
    pub p90: f64,
    pub p99: f64,
    pub max: f64,
}

impl Latencies {
    pub(super) fn new() -> Self {
        Self { bins: vec![0; COUNT], count: 0, sum: 0, min: u64::MAX, max: 0 }
    }

    pub(super) fn add(&mut self, latency: Duration) {
        // 584 years fit.
        let nanoseconds = latency.as_nanos() as u64;
        self.bins[bin(nanoseconds)] += 1;
        self.count += 1;
        self.sum += u128::from(nanoseconds);
        self.min = self.min.min(nanoseconds);
        self.max = self.max.max(nanoseconds);
    }

    pub(super) fn add_all(&mut self, other: &Self) {
        self.bins.iter_mut().zip(&other.bins).for_each(|(bin, other)| *bin += other);
        self.count += other.count;
        self.sum += other.sum;
        self.min = self.min.min(other.min);
        self.max = self.max.max(other.max);
    }

    /// `None` without any.
    pub(super) fn summary(&self) -> Option<Latency> {
        let microseconds = |nanoseconds: u64| nanoseconds as f64 / 1e3;
        let quantile = |share: f64| microseconds(self.quantile(share));
        (self.count > 0).then(|| Latency {
            min: microseconds(self.min),
            mean: self.sum as f64 / self.count as f64 / 1e3,
            p50: quantile(0.5),
            p90: quantile(0.9),
            p99: quantile(0.99),
            max: microseconds(self.max),
        })
    }

    /// The largest that the bin of the share's last latency counts.
    fn quantile(&self, share: f64) -> u64 {
        let rank = ((share * self.count as f64).ceil() as u64).max(1);
        let mut seen = 0;
        let holds = |count: &u64| {
            seen += count;
            seen >= rank
        };
        let bin = self.bins.iter().position(holds).unwrap_or(COUNT - 1);
        largest(bin).clamp(self.min, self.max)
    }
}

/// Exact below 256, then by the eight leading bits.
fn bin(value: u64) -> usize {
    let power = (u64::BITS - value.leading_zeros()).saturating_sub(SHIFT + 1);
    (power as usize) * BINS + (value >> power) as usize
}

fn largest(bin: usize) -> u64 {
    let power = (bin / BINS).saturating_sub(1) as u32;
    let leading = (bin - power as usize * BINS) as u64;
    (leading << power) + ((1 << power) - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_has_a_bin_that_is_narrow() {
        let mut before = 0;
        for value in (0..2000).chain((11..64).flat_map(|power| [(1 << power) - 1, 1 << power, 3 << (power - 1)])) {
            let bin = bin(value);
            assert!(bin < COUNT && (value < 2000 || bin >= before), "{value}");
            before = before.max(bin);
            let top = largest(bin);
            assert!(top >= value && top - value <= value / BINS as u64, "{value}: {top}");
        }
        assert!(bin(u64::MAX) < COUNT && largest(bin(u64::MAX)) == u64::MAX);
    }

    #[test]
    fn quantiles_are_those_of_the_sorted_values() {
        let mut values: Vec<u64> = (0..10_000u64).map(|i| i * i * 7919 % 1_000_003).collect();
        let (mut one, mut other) = (Latencies::new(), Latencies::new());
        for (i, value) in values.iter().enumerate() {
            let of = if i % 3 == 0 { &mut one } else { &mut other };
            of.add(Duration::from_nanos(*value));
        }
        one.add_all(&other);
        values.sort_unstable();
        let summary = one.summary().expect("many");
        for (summary, rank) in [(summary.p50, 5000), (summary.p90, 9000), (summary.p99, 9900)] {
            let exact = values[rank - 1] as f64 / 1e3;
            assert!(summary >= exact && summary <= exact * (1.0 + 1.0 / 128.0), "{summary} for {exact}");
        }
        assert_eq!((summary.min, summary.max), (values[0] as f64 / 1e3, values[9999] as f64 / 1e3));
        let mean = values.iter().sum::<u64>() as f64 / 1e7;
        assert!((summary.mean - mean).abs() < 1e-6);
        assert!(Latencies::new().summary().is_none());
    }
}
