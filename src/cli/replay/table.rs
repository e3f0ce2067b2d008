//! Rows as text, JSON and CSV: whatever serialises to an object is a row, and its fields are the columns.

use std::fmt::Write;

use clap::ValueEnum;
use serde::Serialize;
use serde_json::{Map, Value};

use crate::cli::{Failure, json};

/// How a table is printed.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
pub(in crate::cli) enum Format {
    Text,
    Json,
    Csv,
}

/// Rows of one kind.
pub(in crate::cli) struct Table {
    rows: Vec<Map<String, Value>>,
}

impl Table {
    pub(in crate::cli) fn new(rows: &[impl Serialize]) -> Result<Self, Failure> {
        let object = |row| match serde_json::to_value(row) {
            Ok(Value::Object(object)) => Ok(object),
            Ok(_) => Err(Failure::failed("a row is no object")),
            Err(error) => Err(Failure::failed(error.to_string())),
        };
        Ok(Self { rows: rows.iter().map(object).collect::<Result<_, _>>()? })
    }

    /// In this format. As text, what is the same in all rows of the columns `settings` stands above the table.
    pub(in crate::cli) fn print(&self, format: Format, settings: &[&str]) -> Result<String, Failure> {
        match format {
            Format::Text => Ok(self.text(settings)),
            Format::Json => json(&self.rows),
            Format::Csv => Ok(self.csv()),
        }
    }

    fn columns(&self) -> Vec<&str> {
        self.rows.first().into_iter().flat_map(Map::keys).map(String::as_str).collect()
    }

    fn text(&self, settings: &[&str]) -> String {
        let Some(first) = self.rows.first() else { return String::new() };
        let varies = |column: &str| self.rows.iter().any(|row| row.get(column) != first.get(column));
        let is_filled = |column: &str| self.rows.iter().any(|row| row.get(column).is_some_and(|v| !v.is_null()));
        let (mut heading, mut columns) = (Vec::new(), Vec::new());
        for column in self.columns() {
            if settings.contains(&column) && !varies(column) {
                heading.push(format!("{} {}", column.replace('_', " "), cell(column, &first[column])));
            } else if column != "reason" && (settings.contains(&column) || is_filled(column)) {
                columns.push(column);
            }
        }
        let mut lines = vec![columns.iter().map(|column| column.replace('_', " ")).collect::<Vec<_>>()];
        lines.extend(self.rows.iter().map(|row| columns.iter().map(|&column| cell(column, &row[column])).collect()));
        let width = |i: usize| lines.iter().map(|line| line[i].chars().count()).max().unwrap_or(0);
        let widths: Vec<usize> = (0..columns.len()).map(width).collect();
        let mut out = String::new();
        if !heading.is_empty() {
            let _ = writeln!(out, "{}\n", heading.join(", "));
        }
        for line in &lines {
            let cells: Vec<_> = line.iter().zip(&widths).map(|(cell, &width)| format!("{cell:>width$}")).collect();
            let _ = writeln!(out, "{}", cells.join("  ").trim_end());
        }
        out
    }

    /// One line a row under one of names.
    fn csv(&self) -> String {
        let columns = self.columns();
        let mut out = columns.join(",") + "\n";
        for row in &self.rows {
            let cells = columns.iter().map(|&column| match &row[column] {
                Value::Null => String::new(),
                Value::String(text) if text.contains([',', '"', '\n']) => format!("\"{}\"", text.replace('"', "\"\"")),
                Value::String(text) => text.clone(),
                value => value.to_string(),
            });
            out += &(cells.collect::<Vec<_>>().join(",") + "\n");
        }
        out
    }
}

fn cell(column: &str, value: &Value) -> String {
    match (column, value) {
        ("ways", Value::Null) => "full".to_owned(),
        ("exact", Value::Bool(exact)) => if *exact { "exact" } else { "approximate" }.to_owned(),
        (_, Value::Null) => "-".to_owned(),
        (_, Value::String(text)) => text.clone(),
        (_, Value::Number(number)) if number.is_f64() => {
            let value = number.as_f64().unwrap_or_default();
            if value.abs() < 10.0 { format!("{value:.6}") } else { format!("{value:.2}") }
        }
        (_, value) => value.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Serialize)]
    struct Row {
        line: u32,
        nodes: u32,
        misses: u64,
        why: Option<&'static str>,
    }

    fn table() -> Table {
        let row = |nodes, misses, why| Row { line: 64, nodes, misses, why };
        Table::new(&[row(4, 100, None), row(16, 7, Some("a, \"b\""))]).expect("rows")
    }

    #[test]
    fn what_is_the_same_stands_above_the_table() {
        let text = table().print(Format::Text, &["line", "nodes"]).expect("text");
        assert_eq!(text, "line 64\n\nnodes  misses        why\n    4     100          -\n   16       7  a, \"b\"\n");
    }

    #[test]
    fn csv_quotes_what_it_must() {
        let csv = table().print(Format::Csv, &[]).expect("text");
        assert_eq!(csv, "line,nodes,misses,why\n64,4,100,\n64,16,7,\"a, \"\"b\"\"\"\n");
        let json: Value = serde_json::from_str(&table().print(Format::Json, &[]).expect("text")).expect("JSON");
        assert_eq!((json[1]["nodes"].as_u64(), json[0]["why"].is_null()), (Some(16), true));
    }
}
