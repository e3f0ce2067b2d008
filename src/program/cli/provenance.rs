//! What a study's page says of itself: how it can be repeated, and where it was made.

use std::env;
use std::fs;
use std::thread;
use std::time::{SystemTime, UNIX_EPOCH};

use crate::study::page::Provenance;

/// Of this process, now.
pub(super) fn here() -> Provenance {
    let seconds = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    let arguments = env::args_os().map(|argument| quoted(&argument.to_string_lossy()));
    let unknown = || "unknown".to_owned();
    let host =
        fs::read_to_string("/proc/sys/kernel/hostname").map_or_else(|_| unknown(), |name| name.trim().to_owned());
    let information = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let processors = thread::available_parallelism().map_or(1, usize::from);
    Provenance {
        command: arguments.collect::<Vec<_>>().join(" "),
        version: format!("marti {}", env!("CARGO_PKG_VERSION")),
        date: date(seconds),
        host,
        processor: format!("{}, {processors} processors", model(&information).unwrap_or_else(unknown)),
    }
}

/// As Linux calls it; not every architecture has a name.
fn model(information: &str) -> Option<String> {
    let line = information.lines().find(|line| line.starts_with("model name"))?;
    line.split_once(':').map(|(_, name)| name.trim().to_owned())
}

/// As a shell reads it.
fn quoted(argument: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./=,:+%@".contains(c);
    if !argument.is_empty() && argument.chars().all(is_plain) {
        argument.to_owned()
    } else {
        format!("'{}'", argument.replace('\'', "'\\''"))
    }
}

/// Seconds since 1970 in UTC. The days are counted from 1 March, so that a leap day is the last of its year: E. G. Richards,
/// *Calendars*, 2013.
fn date(seconds: u64) -> String {
    let (days, second) = (seconds / 86_400, seconds % 86_400);
    let shifted = days + 719_468;
    let (era, day_of_era) = (shifted / 146_097, shifted % 146_097);
    let year_of_era = (day_of_era - day_of_era / 1_460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    let year = era * 400 + year_of_era + u64::from(month <= 2);
    format!("{year}-{month:02}-{day:02} {:02}:{:02} UTC", second / 3_600, second / 60 % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_those_of_the_calendar() {
        for (seconds, expected) in [
            (0, "1970-01-01 00:00 UTC"),
            (951_782_399, "2000-02-28 23:59 UTC"),
            (951_782_400, "2000-02-29 00:00 UTC"),
            (1_735_689_599, "2024-12-31 23:59 UTC"),
            (4_107_542_400, "2100-03-01 00:00 UTC"),
        ] {
            assert_eq!(date(seconds), expected);
        }
    }

    #[test]
    fn arguments_are_quoted_where_a_shell_would_divide_them() {
        assert_eq!(["a=1/8", "4 KiB", "", "it's"].map(quoted), ["a=1/8", "'4 KiB'", "''", "'it'\\''s'"]);
        assert_eq!(model("x: 1\nmodel name\t: A B\n"), Some("A B".to_owned()));
    }
}
