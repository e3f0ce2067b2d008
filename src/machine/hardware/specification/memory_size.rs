//! [`MemorySize`] as text: `all`, `1/8`, `64 KiB`.

use std::fmt;
use std::str::FromStr;

use super::MemorySize;

/// No local memory is larger: 1 TiB.
pub const BYTES_MAX: u64 = 1 << 40;

/// From the largest, so that the first that divides a size is the shortest way to write it.
const UNITS: [(&str, u64); 5] = [("TiB", 1 << 40), ("GiB", 1 << 30), ("MiB", 1 << 20), ("KiB", 1 << 10), ("B", 1)];

/// The text is not a size; [`MemorySize::ACCEPTED`] says what is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected {}", MemorySize::ACCEPTED)]
pub struct NotASize;

impl MemorySize {
    /// What [`FromStr`] takes.
    pub const ACCEPTED: &str =
        r#""all", a share of the database above 0 and at most 1 such as "1/8", or 1 B to 1 TiB such as "64 KiB""#;
}

impl FromStr for MemorySize {
    type Err = NotASize;

    fn from_str(text: &str) -> Result<Self, NotASize> {
        let text = text.trim();
        if text == "all" {
            return Ok(Self::All);
        }
        match text.split_once('/') {
            Some((numerator, denominator)) => share(numerator, denominator),
            None => bytes(text),
        }
        .ok_or(NotASize)
    }
}

fn share(numerator: &str, denominator: &str) -> Option<MemorySize> {
    let (numerator, denominator) = (numerator.trim().parse().ok()?, denominator.trim().parse().ok()?);
    (0 < numerator && numerator <= denominator).then_some(MemorySize::Share { numerator, denominator })
}

/// A decimal number, and a unit unless it is bytes; together a whole number of bytes.
fn bytes(text: &str) -> Option<MemorySize> {
    let (number, unit) = text.split_at(text.find(|c: char| c.is_ascii_alphabetic()).unwrap_or(text.len()));
    let unit = match unit {
        "" => 1,
        unit => UNITS.iter().find(|(name, _)| *name == unit)?.1,
    };
    let number = number.trim_end();
    if !number.bytes().all(|c| c.is_ascii_digit() || c == b'.') {
        return None;
    }
    let bytes = number.parse::<f64>().ok()? * unit as f64;
    (bytes.fract() == 0.0 && (1.0..=BYTES_MAX as f64).contains(&bytes)).then_some(MemorySize::Bytes(bytes as u64))
}

impl fmt::Display for MemorySize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::All => f.write_str("all"),
            Self::Share { numerator, denominator } => write!(f, "{numerator}/{denominator}"),
            Self::Bytes(bytes) => {
                let (name, unit) = UNITS.into_iter().find(|(_, unit)| bytes.is_multiple_of(*unit)).unwrap_or(("B", 1));
                write!(f, "{} {name}", bytes / unit)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn sizes_mean_what_they_say() {
        let share = |numerator, denominator| Ok(MemorySize::Share { numerator, denominator });
        for (text, size) in [
            ("all", Ok(MemorySize::All)),
            ("1/8", share(1, 8)),
            (" 3 / 32 ", share(3, 32)),
            ("1/1", share(1, 1)),
            ("4096", Ok(MemorySize::Bytes(4096))),
            ("4096 B", Ok(MemorySize::Bytes(4096))),
            ("4 KiB", Ok(MemorySize::Bytes(4096))),
            ("64KiB", Ok(MemorySize::Bytes(65_536))),
            ("1.5 MiB", Ok(MemorySize::Bytes(1_572_864))),
            ("1024 GiB", Ok(MemorySize::Bytes(1 << 40))),
            ("1 TiB", Ok(MemorySize::Bytes(1 << 40))),
            ("0.5 TiB", Ok(MemorySize::Bytes(1 << 39))),
        ] {
            assert_eq!(text.parse(), size, "{text}");
        }
    }

    #[test]
    fn what_is_no_size_is_refused() {
        for text in [
            "",
            "All",
            "9/8",
            "0/8",
            "1/0",
            "-1/8",
            "1/8/2",
            "1.5/8",
            "1/5000000000",
            "0",
            "0 KiB",
            "0.3 KiB",
            "1025 GiB",
            "1.5 TiB",
            "2 TiB",
            "4 kB",
            "4 KB",
            "KiB",
            ".",
            "1..5 KiB",
            "-4 KiB",
            "+4 KiB",
            "1e3",
            "inf",
            "NaN KiB",
            "4 KiB x",
            "٤ KiB",
        ] {
            assert_eq!(text.parse::<MemorySize>(), Err(NotASize), "{text}");
        }
    }

    #[test]
    fn bytes_are_written_in_the_largest_unit_that_divides_them() {
        for (bytes, text) in
            [(4096, "4 KiB"), (4097, "4097 B"), (1_572_864, "1536 KiB"), (1 << 30, "1 GiB"), (1 << 40, "1 TiB")]
        {
            assert_eq!(MemorySize::Bytes(bytes).to_string(), text);
        }
    }

    proptest! {
        #[test]
        fn written_sizes_read_back(bytes in 1..=BYTES_MAX) {
            let size = MemorySize::Bytes(bytes);
            prop_assert_eq!(size.to_string().parse(), Ok(size));
        }
    }
}
