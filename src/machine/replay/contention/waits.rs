//! How long transactions waited, all of them, in little room.

use super::Cycle;

/// A histogram: exact below 512 cycles, above in classes whose width is at most 1/256 of what they hold.
#[derive(Clone, Debug, Default)]
pub(super) struct Waits {
    /// By class, as far as any was counted.
    classes: Vec<u64>,
    count: u64,
    sum: u128,
    max: Cycle,
}

impl Waits {
    /// An octave has 2 to this power classes.
    const BITS: u32 = 8;

    pub(super) fn add(&mut self, wait: Cycle) {
        let class = Self::class(wait);
        if class >= self.classes.len() {
            self.classes.resize(class + 1, 0);
        }
        self.classes[class] += 1;
        self.count += 1;
        self.sum += u128::from(wait);
        self.max = self.max.max(wait);
    }

    /// Exact; 0 of none.
    pub(super) fn mean(&self) -> f64 {
        if self.count == 0 { 0.0 } else { self.sum as f64 / self.count as f64 }
    }

    pub(super) fn max(&self) -> Cycle {
        self.max
    }

    /// The shortest wait that at least `percent` of all do not exceed, rounded up within its class; 0 of none.
    pub(super) fn percentile(&self, percent: u32) -> Cycle {
        let rank = (u128::from(self.count) * u128::from(percent)).div_ceil(100);
        let mut seen = 0;
        for (class, &count) in self.classes.iter().enumerate() {
            seen += u128::from(count);
            if seen >= rank {
                return Self::longest(class).min(self.max);
            }
        }
        self.max
    }

    /// Waits with the same leading bits are in one class.
    fn class(wait: Cycle) -> usize {
        let octave = (u64::BITS - wait.leading_zeros()).saturating_sub(Self::BITS + 1);
        ((wait >> octave) + (u64::from(octave) << Self::BITS)) as usize
    }

    /// The longest wait of a class.
    fn longest(class: usize) -> Cycle {
        let class = class as u64;
        let octave = (class >> Self::BITS).saturating_sub(1);
        let first = class - (octave << Self::BITS);
        (first << octave) + ((1 << octave) - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn classes_follow_one_another_and_are_narrow() {
        for wait in (0..5000).chain([1 << 20, (1 << 20) + 12_345, 1 << 40, u64::MAX - 1, u64::MAX]) {
            let class = Waits::class(wait);
            let longest = Waits::longest(class);
            assert!(wait <= longest && longest - wait <= wait / 256, "{wait} {longest}");
            assert!(wait >= 512 || longest == wait, "{wait} is exact");
            assert_eq!(Waits::class(longest), class);
            assert!(longest == u64::MAX || Waits::class(longest + 1) == class + 1, "{wait}");
        }
    }

    #[test]
    fn percentiles_are_ranks() {
        let mut waits = Waits::default();
        assert_eq!((waits.mean(), waits.percentile(99), waits.max()), (0.0, 0, 0));
        (1..=200).rev().for_each(|wait| waits.add(wait));
        assert_eq!((waits.mean(), waits.max()), (100.5, 200));
        assert_eq!([1, 50, 99, 100].map(|percent| waits.percentile(percent)), [2, 100, 198, 200]);
    }
}
