//! Lists and ranges as they are typed: `1,2,8`, `1..16`, `16..256x2`.

use std::str::FromStr;

use cluster::topology::value::{Cycles, CyclesPerWord, Nodes, Quantum, Ways, Width};
use machine::hardware::specification::{Arbiter, MemorySize};
use machine::replay::plan::setting::ArbiterName;

/// Longer lists are slips of the keyboard.
const VALUES_MAX: usize = 4096;

/// Values of an option, one after the other.
#[derive(Clone, PartialEq, Debug)]
pub(super) struct List<T>(pub Vec<T>);

impl<T> Default for List<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

/// A value that lists are made of.
pub(super) trait Value: Sized + PartialOrd + Copy {
    /// # Errors
    /// What was expected.
    fn parse(text: &str) -> Result<Self, String>;

    /// The next one of a range: `factor` as in `x2`, else whatever comes next.
    fn next(self, factor: Option<u32>) -> Option<Self>;
}

impl<T: Value> FromStr for List<T> {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut values = Vec::new();
        for item in text.split(',') {
            match item.split_once("..") {
                None => values.push(T::parse(item)?),
                Some((first, rest)) => {
                    let (last, factor) = match rest.split_once('x') {
                        Some((last, factor)) => {
                            let factor = factor.parse().ok().filter(|&factor| factor > 1);
                            (last, Some(factor.ok_or("expected a factor of at least 2 after x")?))
                        }
                        None => (rest, None),
                    };
                    let last = T::parse(last)?;
                    let mut next = Some(T::parse(first)?).filter(|first| *first <= last);
                    if next.is_none() {
                        return Err(format!("the range {item} is empty, expected the smaller value first"));
                    }
                    while let Some(value) = next.filter(|value| *value <= last && values.len() <= VALUES_MAX) {
                        values.push(value);
                        next = value.next(factor);
                    }
                }
            }
        }
        if values.len() > VALUES_MAX {
            return Err(format!("expected at most {VALUES_MAX} values"));
        }
        Ok(Self(values))
    }
}

/// A size of local memory. Ranges double.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Size(pub MemorySize);

impl PartialOrd for Size {
    /// A share and a number of bytes cannot be compared.
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        match (self.0, other.0) {
            (MemorySize::Bytes(a), MemorySize::Bytes(b)) => a.partial_cmp(&b),
            (MemorySize::Share { numerator, denominator }, MemorySize::Share { numerator: n, denominator: d }) => {
                (u64::from(numerator) * u64::from(d)).partial_cmp(&(u64::from(n) * u64::from(denominator)))
            }
            _ => None,
        }
    }
}

impl Value for Size {
    fn parse(text: &str) -> Result<Self, String> {
        text.parse().map(Self).map_err(|error: machine::hardware::specification::NotASize| error.to_string())
    }

    fn next(self, factor: Option<u32>) -> Option<Self> {
        let factor = factor.unwrap_or(2);
        Some(Self(match self.0 {
            MemorySize::Bytes(bytes) => MemorySize::Bytes(bytes.checked_mul(u64::from(factor))?),
            MemorySize::Share { numerator, denominator } if denominator.is_multiple_of(factor) => {
                MemorySize::Share { numerator, denominator: denominator / factor }
            }
            MemorySize::Share { numerator, denominator } => {
                MemorySize::Share { numerator: numerator.checked_mul(factor)?, denominator }
            }
            MemorySize::All => return None,
        }))
    }
}

macro_rules! integers {
    ($($(#[$doc:meta])* $name:ident($type:ty): $value:ty, $step:expr;)*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, PartialEq, PartialOrd, Debug)]
        pub(super) struct $name(pub $type);

        impl Value for $name {
            fn parse(text: &str) -> Result<Self, String> {
                text.trim().parse::<$value>().map(|value| Self(value.0))
            }

            fn next(self, factor: Option<u32>) -> Option<Self> {
                let step: fn($type, Option<$type>) -> Option<$type> = $step;
                let factor = factor.map(<$type>::try_from).transpose().ok()?;
                step(self.0, factor).map(Self)
            }
        }
    )*};
}

/// Bytes of a line of a trace that came from elsewhere; recordings have shorter ones, which their geometry checks.
struct ImportedLine(u32);

impl FromStr for ImportedLine {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        const MAX: u32 = machine::replay::importers::LINE_BYTES_MAX;
        let bytes = text.parse().ok().filter(|bytes: &u32| bytes.is_power_of_two() && (16..=MAX).contains(bytes));
        bytes.map(Self).ok_or_else(|| format!("expected a power of two, 16 to {MAX}"))
    }
}

integers! {
    /// Processing nodes. Ranges count.
    NodeCount(u16): Nodes, |nodes, factor| match factor {
        Some(factor) => nodes.checked_mul(factor),
        None => nodes.checked_add(1),
    };
    /// Bytes of a line. Ranges double.
    LineBytes(u32): ImportedLine, |line, factor| line.checked_mul(factor.unwrap_or(2));
    /// Bytes of a bus word. Ranges double.
    BusWidth(u32): Width, |width, factor| width.checked_mul(factor.unwrap_or(2));
    /// Cycles. Ranges double; after 0 comes 1.
    CycleCount(u32): Cycles, |cycles, factor| match cycles {
        0 => Some(1),
        cycles => cycles.checked_mul(factor.unwrap_or(2)),
    };
    /// Cycles in which a word crosses the bus. Ranges double.
    WordCycles(u32): CyclesPerWord, |cycles, factor| cycles.checked_mul(factor.unwrap_or(2));
}

/// Lines of a set, or `full`. Ranges double.
#[derive(Clone, Copy, PartialEq, PartialOrd, Debug)]
pub(super) struct WayCount(pub Option<u32>);

impl Value for WayCount {
    fn parse(text: &str) -> Result<Self, String> {
        match text.trim() {
            "full" => Ok(Self(None)),
            text => text
                .parse::<Ways>()
                .map(|ways| Self(Some(ways.0)))
                .map_err(|error| format!("{error}, or full for all lines of the memory")),
        }
    }

    fn next(self, factor: Option<u32>) -> Option<Self> {
        self.0?.checked_mul(factor.unwrap_or(2)).map(|ways| Self(Some(ways)))
    }
}

/// An arbiter as it is typed: `fifo`, `round_robin`, `round_robin:QUANTUM`, `fixed_priority`; also with `-` for `_`.
pub(super) fn arbiter(text: &str) -> Result<ArbiterName, String> {
    let quantum = |text: &str| text.parse::<Quantum>().map(|quantum| quantum.0);
    let text = &text.replace('-', "_");
    match text.split_once(':').map_or((text.as_str(), None), |(name, quantum)| (name, Some(quantum))) {
        ("fifo", None) => Ok(ArbiterName(Arbiter::Fifo)),
        ("fixed_priority", None) => Ok(ArbiterName(Arbiter::FixedPriority)),
        ("round_robin", None) => Ok(ArbiterName(Arbiter::RoundRobin { quantum: 1 })),
        ("round_robin", Some(text)) => Ok(ArbiterName(Arbiter::RoundRobin { quantum: quantum(text)? })),
        _ => Err("expected fifo, round_robin, round_robin:QUANTUM or fixed_priority".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn nodes(text: &str) -> Result<Vec<u16>, String> {
        text.parse::<List<NodeCount>>().map(|list| list.0.into_iter().map(|nodes| nodes.0).collect())
    }

    fn sizes(text: &str) -> Result<Vec<String>, String> {
        text.parse::<List<Size>>().map(|list| list.0.into_iter().map(|size| size.0.to_string()).collect())
    }

    #[test]
    fn lists_and_ranges_mean_what_they_say() {
        assert_eq!(nodes("1,4..6,9"), Ok(vec![1, 4, 5, 6, 9]));
        assert_eq!(nodes("1..256x4"), Ok(vec![1, 4, 16, 64, 256]));
        assert_eq!(nodes("3..20x2"), Ok(vec![3, 6, 12]));
        assert_eq!(sizes("1/32..1/4,all"), Ok(["1/32", "1/16", "1/8", "1/4", "all"].map(str::to_owned).to_vec()));
        assert_eq!(sizes("4 KiB..16 KiB"), Ok(["4 KiB", "8 KiB", "16 KiB"].map(str::to_owned).to_vec()));
        let cycles: List<CycleCount> = "0..8,0..100x10".parse().expect("ranges");
        assert_eq!(cycles.0.iter().map(|cycles| cycles.0).collect::<Vec<_>>(), [0, 1, 2, 4, 8, 0, 1, 10, 100]);
        let lines: List<LineBytes> = "16..256".parse().expect("a range");
        assert_eq!(lines.0.len(), 5);
        let ways: List<WayCount> = "1..8,full".parse().expect("a range");
        assert_eq!(ways.0.iter().map(|ways| ways.0).collect::<Vec<_>>(), [Some(1), Some(2), Some(4), Some(8), None]);
    }

    #[test]
    fn what_is_none_is_refused() {
        for (text, told) in [
            ("", "expected an integer from 1 to 256"),
            ("0", "expected an integer from 1 to 256"),
            ("4..2", "is empty"),
            ("1..4x1", "factor of at least 2"),
            ("1..4x", "factor of at least 2"),
            ("1,,2", "expected an integer"),
            (
                "1..256,1..256,1..256,1..256,1..256,1..256,1..256,1..256,1..256,1..256,1..256,1..256,1..256,1..256,1..256,1..256,1..256",
                "at most 4096",
            ),
        ] {
            let error = nodes(text).expect_err(text);
            assert!(error.contains(told), "{text}: {error}");
        }
        assert!(sizes("1/8..64 KiB").expect_err("not comparable").contains("is empty"));
        assert!(arbiter("round_robin:0").is_err());
        assert!(arbiter("priority").is_err());
    }
}
