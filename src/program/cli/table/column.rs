//! How a person is shown a column: its head with the unit, and its values with one precision. Columns of JSON and CSV keep their
//! names and all digits.

use serde_json::Value;

use crate::study::page::table::grouped;

/// How the values of a column are written.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Shown {
    /// Counts in groups of three digits; other values as they are.
    Plain,
    /// A ratio as a percentage with so many decimals.
    Percent(usize),
    Decimal(usize),
    Scientific,
}

/// The columns that are not shown under their own names, or not plainly.
const COLUMNS: [(&str, &str, Shown); 38] = [
    ("line", "line, bytes", Shown::Plain),
    ("local_bytes", "local memory, bytes", Shown::Plain),
    ("bus_width", "bus width, bytes", Shown::Plain),
    ("latency", "latency, cycles", Shown::Plain),
    ("octree_node", "octree node, cycles", Shown::Plain),
    ("primitive_test", "primitive test, cycles", Shown::Plain),
    ("shading", "shading, cycles", Shown::Plain),
    ("local_access", "local access, cycles", Shown::Plain),
    ("objects_bytes", "objects, bytes", Shown::Plain),
    ("misses_per_record_access", "misses per record access", Shown::Percent(3)),
    ("words_moved_per_word_read", "words moved per word read", Shown::Percent(2)),
    ("misses_per_request", "misses per request", Shown::Percent(3)),
    ("bytes_missed_per_byte_requested", "bytes missed per byte requested", Shown::Percent(3)),
    ("share_of_misses", "share of misses", Shown::Percent(2)),
    ("efficiency", "efficiency", Shown::Percent(2)),
    ("efficiency_least", "efficiency, least", Shown::Percent(2)),
    ("bus_utilisation", "bus utilisation", Shown::Percent(2)),
    ("fixed_utilisation", "fixed utilisation", Shown::Percent(2)),
    ("fixed_efficiency", "fixed efficiency", Shown::Percent(2)),
    ("exponential_utilisation", "exponential utilisation", Shown::Percent(2)),
    ("exponential_efficiency", "exponential efficiency", Shown::Percent(2)),
    ("wait_mean", "mean wait, cycles", Shown::Decimal(2)),
    ("wait_percentile_99", "99th percentile of waits, cycles", Shown::Plain),
    ("fixed_wait", "fixed wait, cycles", Shown::Decimal(2)),
    ("exponential_wait", "exponential wait, cycles", Shown::Decimal(2)),
    ("speed_up", "speed-up", Shown::Decimal(2)),
    ("knee", "knee, nodes", Shown::Decimal(2)),
    ("saturation", "saturation, nodes", Shown::Decimal(2)),
    ("cycles", "cycles", Shown::Plain),
    ("writes_per_write_back", "writes per write-back", Shown::Decimal(3)),
    ("worst_depth_error", "worst relative depth error", Shown::Scientific),
    ("seconds", "processor time, s", Shown::Decimal(1)),
    ("million_rays_per_second", "million rays/s", Shown::Decimal(2)),
    ("false", "false hits", Shown::Plain),
    ("aimed_at", "aimed at", Shown::Plain),
    ("exact", "counts", Shown::Plain),
    ("by", "by", Shown::Plain),
    ("name", "name", Shown::Plain),
];

fn known(column: &str) -> Option<&'static (&'static str, &'static str, Shown)> {
    COLUMNS.iter().find(|known| known.0 == column)
}

/// The column's name for a person, with its unit.
pub(super) fn head(column: &str) -> String {
    match known(column) {
        Some((_, head, Shown::Percent(_))) => format!("{head}, %"),
        Some((_, head, _)) => (*head).to_owned(),
        None => column.replace('_', " "),
    }
}

/// A value of the column, without its unit.
pub(super) fn cell(column: &str, value: &Value) -> String {
    const DECIMALS: usize = 4;
    match (column, value) {
        ("ways", Value::Null) => return "full".to_owned(),
        ("node", Value::Null) => return "all".to_owned(),
        ("exact", Value::Bool(exact)) => return if *exact { "exact" } else { "approximate" }.to_owned(),
        _ => {}
    }
    let shown = known(column).map_or(Shown::Plain, |known| known.2);
    match (value, value.as_f64(), shown) {
        (Value::Null, ..) => "-".to_owned(),
        (Value::String(text), ..) => text.clone(),
        (_, Some(ratio), Shown::Percent(decimals)) => format!("{:.decimals$}", 100.0 * ratio),
        (_, Some(number), Shown::Decimal(decimals)) => format!("{number:.decimals$}"),
        (_, Some(number), Shown::Scientific) => format!("{number:.1e}"),
        (Value::Number(number), Some(value), Shown::Plain) => match number.as_u64() {
            Some(count) => grouped(count),
            None if number.is_f64() => format!("{value:.DECIMALS$}"),
            None => number.to_string(),
        },
        (value, ..) => value.to_string(),
    }
}

/// A setting and its value, in a list of settings.
pub(super) fn setting(column: &str, value: &Value) -> String {
    let (name, unit) = match known(column) {
        Some((_, head, Shown::Percent(_))) => (*head, "%"),
        Some((_, head, _)) => head.split_once(", ").map_or((*head, ""), |(name, unit)| (name, unit)),
        None => return format!("{} {}", column.replace('_', " "), cell(column, value)),
    };
    format!("{name} {} {unit}", cell(column, value)).trim_end().to_owned()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn values_have_one_precision_and_heads_have_units() {
        for (column, value, head_of, expected, as_setting) in [
            ("misses", json!(1_234_567), "misses", "1,234,567", "misses 1,234,567"),
            (
                "misses_per_record_access",
                json!(0.036_936),
                "misses per record access, %",
                "3.694",
                "misses per record access 3.694 %",
            ),
            ("line", json!(64), "line, bytes", "64", "line 64 bytes"),
            ("ways", json!(null), "ways", "full", "ways full"),
            (
                "worst_depth_error",
                json!(1.27e-7),
                "worst relative depth error",
                "1.3e-7",
                "worst relative depth error 1.3e-7",
            ),
            ("wait_mean", json!(0), "mean wait, cycles", "0.00", "mean wait 0.00 cycles"),
            ("conflict_misses", json!(-3), "conflict misses", "-3", "conflict misses -3"),
            ("exact", json!(false), "counts", "approximate", "counts approximate"),
            ("replacement", json!("lru"), "replacement", "lru", "replacement lru"),
        ] {
            assert_eq!(head(column), head_of);
            assert_eq!(cell(column, &value), expected);
            assert_eq!(setting(column, &value), as_setting);
        }
    }
}
