//! Rows of a replay as text, JSON and CSV.

use std::fmt::Write;

use serde_json::Value;

use crate::cli::Failure;
use crate::replay::evaluation::Row;

/// A table for people: what is the same in all rows stands above it.
pub(super) fn text(rows: &[Row]) -> Result<String, Failure> {
    let objects = objects(rows)?;
    let Some(first) = objects.first() else { return Ok(String::new()) };
    let settings = SETTINGS.into_iter().filter(|column| first.contains_key(*column));
    let (varied, same): (Vec<_>, Vec<_>) =
        settings.partition(|&column| objects.iter().any(|row| row.get(column) != first.get(column)));
    let mut out = String::new();
    let same = same.iter().map(|&column| format!("{} {}", column.replace('_', " "), cell(column, &first[column])));
    let _ = writeln!(out, "{}\n", same.collect::<Vec<_>>().join(", "));
    let counted = |column: &&str| objects.iter().any(|row| row.get(*column).is_some_and(|value| !value.is_null()));
    let columns: Vec<&str> = varied.into_iter().chain(COUNTS.into_iter().filter(counted)).collect();
    let mut lines = vec![columns.iter().map(|column| (*column).replace('_', " ")).collect::<Vec<_>>()];
    lines.extend(objects.iter().map(|row| columns.iter().map(|&column| cell(column, &row[column])).collect()));
    let widths: Vec<usize> =
        (0..columns.len()).map(|i| lines.iter().map(|line| line[i].chars().count()).max().unwrap_or(0)).collect();
    for line in lines {
        let cells: Vec<_> = line.iter().zip(&widths).map(|(cell, &width)| format!("{cell:>width$}")).collect();
        let _ = writeln!(out, "{}", cells.join("  ").trim_end());
    }
    for reason in reasons(rows) {
        let _ = writeln!(out, "\napproximate: {reason}");
    }
    Ok(out)
}

const SETTINGS: [&str; 10] = [
    "local_memory",
    "line",
    "ways",
    "replacement",
    "nodes",
    "clusters",
    "tile_order",
    "assignment",
    "bus_width",
    "arbiter",
];
const COUNTS: [&str; 13] = [
    "local_bytes",
    "record_accesses",
    "misses",
    "misses_per_record_access",
    "words_read",
    "words_moved",
    "words_moved_per_word_read",
    "cycles",
    "efficiency",
    "bus_utilisation",
    "wait_mean",
    "wait_percentile_99",
    "exact",
];

fn reasons(rows: &[Row]) -> Vec<&str> {
    let mut reasons: Vec<&str> = rows.iter().filter_map(|row| row.reason.as_deref()).collect();
    reasons.sort_unstable();
    reasons.dedup();
    reasons
}

fn objects(rows: &[Row]) -> Result<Vec<serde_json::Map<String, Value>>, Failure> {
    let object = |row: &Row| match serde_json::to_value(row) {
        Ok(Value::Object(object)) => Ok(object),
        Ok(_) => Err(Failure::failed("a row is no object".to_owned())),
        Err(error) => Err(Failure::failed(error.to_string())),
    };
    rows.iter().map(object).collect()
}

fn cell(column: &str, value: &Value) -> String {
    match (column, value) {
        ("ways", Value::Null) => "full".to_owned(),
        ("exact", Value::Bool(exact)) => if *exact { "exact" } else { "approximate" }.to_owned(),
        (_, Value::Null) => "-".to_owned(),
        (_, Value::String(text)) => text.clone(),
        (_, Value::Number(number)) if number.is_f64() => format!("{:.6}", number.as_f64().unwrap_or_default()),
        (_, value) => value.to_string(),
    }
}

/// One line a row under one of names.
pub(super) fn csv(rows: &[Row]) -> Result<String, Failure> {
    let objects = objects(rows)?;
    let Some(first) = objects.first() else { return Ok(String::new()) };
    let columns: Vec<&String> = first.keys().collect();
    let mut out = columns.iter().map(|column| column.as_str()).collect::<Vec<_>>().join(",") + "\n";
    for row in &objects {
        let cells = columns.iter().map(|&column| match &row[column] {
            Value::Null => String::new(),
            Value::String(text) if text.contains([',', '"', '\n']) => format!("\"{}\"", text.replace('"', "\"\"")),
            Value::String(text) => text.clone(),
            value => value.to_string(),
        });
        out += &(cells.collect::<Vec<_>>().join(",") + "\n");
    }
    Ok(out)
}
