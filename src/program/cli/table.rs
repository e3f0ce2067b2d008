//! Rows as text, JSON and CSV: whatever serialises to an object is a row, and its fields are the columns.

use std::fmt::{self, Write};

use clap::ValueEnum;
use serde::Serialize;
use serde::de::{Deserialize, Deserializer, MapAccess, Visitor};
use serde_json::Value;

use crate::cli::Failure;

/// How a table is printed.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
pub(super) enum Format {
    Text,
    Json,
    Csv,
}

/// Lists of columns that mean nothing in a table.
pub(super) type Hidden = &'static [&'static [&'static str]];

/// Rows of one kind.
pub(super) struct Table {
    /// As JSON.
    json: String,
    columns: Vec<String>,
    /// Columns that a person is not shown.
    hidden: Hidden,
    /// A value a column.
    rows: Vec<Vec<Value>>,
}

/// An object's fields in their own order.
struct Fields(Vec<(String, Value)>);

impl<'de> Deserialize<'de> for Fields {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct InOrder;
        impl<'de> Visitor<'de> for InOrder {
            type Value = Fields;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an object")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Fields, A::Error> {
                let mut fields = Vec::new();
                while let Some(field) = map.next_entry()? {
                    fields.push(field);
                }
                Ok(Fields(fields))
            }
        }
        deserializer.deserialize_map(InOrder)
    }
}

impl Table {
    pub(super) fn new(rows: &[impl Serialize]) -> Result<Self, Failure> {
        let failed = |error: serde_json::Error| Failure::failed(error.to_string());
        let json = serde_json::to_string_pretty(rows).map_err(failed)? + "\n";
        let fields: Vec<Fields> = serde_json::from_str(&json).map_err(failed)?;
        let columns = fields.first().iter().flat_map(|row| row.0.iter().map(|field| field.0.clone())).collect();
        let rows = fields.into_iter().map(|row| row.0.into_iter().map(|field| field.1).collect()).collect();
        Ok(Self { json, columns, hidden: &[], rows })
    }

    fn is_hidden(&self, column: &str) -> bool {
        self.hidden.iter().any(|hidden| hidden.contains(&column))
    }

    /// The same table, as text without these columns: they mean nothing in it.
    pub(super) fn hiding(self, hidden: Hidden) -> Self {
        Self { hidden, ..self }
    }

    /// The settings of the first row, for what is no table.
    pub(super) fn heading(&self, settings: &[&str]) -> String {
        let Some(first) = self.rows.first() else { return String::new() };
        let shown = self
            .columns
            .iter()
            .zip(first)
            .filter(|(column, _)| settings.contains(&column.as_str()) && !self.is_hidden(column));
        wrapped(shown.map(|(column, value)| setting(column, value)))
    }

    /// In this format. As text, what is the same in all rows of the columns `settings` is above the table.
    pub(super) fn print(&self, format: Format, settings: &[&str]) -> String {
        match format {
            Format::Text => self.text(settings),
            Format::Json => self.json.clone(),
            Format::Csv => self.csv(),
        }
    }

    fn text(&self, settings: &[&str]) -> String {
        let Some(first) = self.rows.first() else { return String::new() };
        let varies = |i: usize| self.rows.iter().any(|row| row[i] != first[i]);
        let is_filled = |i: usize| self.rows.iter().any(|row| !row[i].is_null());
        let (mut heading, mut columns) = (Vec::new(), Vec::new());
        for (i, column) in self.columns.iter().enumerate() {
            let is_setting = settings.contains(&column.as_str());
            if self.is_hidden(column) {
            } else if is_setting && !varies(i) {
                heading.push(setting(column, &first[i]));
            } else if column != "reason" && (is_setting || is_filled(i)) {
                columns.push(i);
            }
        }
        let mut lines = vec![columns.iter().map(|&i| self.columns[i].replace('_', " ")).collect::<Vec<_>>()];
        lines.extend(self.rows.iter().map(|row| columns.iter().map(|&i| cell(&self.columns[i], &row[i])).collect()));
        let width = |i: usize| lines.iter().map(|line| line[i].chars().count()).max().unwrap_or(0);
        let widths: Vec<usize> = (0..columns.len()).map(width).collect();
        let mut out = String::new();
        if !heading.is_empty() {
            let _ = writeln!(out, "{}\n", wrapped(heading.into_iter()));
        }
        for line in &lines {
            let cells: Vec<_> = line.iter().zip(&widths).map(|(cell, &width)| format!("{cell:>width$}")).collect();
            let _ = writeln!(out, "{}", cells.join("  ").trim_end());
        }
        out
    }

    /// One line a row under one of names.
    fn csv(&self) -> String {
        let mut out = self.columns.join(",") + "\n";
        for row in &self.rows {
            let cells = row.iter().map(|value| match value {
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

/// A setting and its value.
fn setting(column: &str, value: &Value) -> String {
    format!("{} {}", column.replace('_', " "), cell(column, value))
}

/// Settings between commas, in lines that a terminal has room for.
fn wrapped(settings: impl Iterator<Item = String>) -> String {
    const COLUMNS_MAX: usize = 100;
    let (mut lines, mut line) = (Vec::new(), String::new());
    for setting in settings {
        if !line.is_empty() && line.len() + setting.len() + 3 > COLUMNS_MAX {
            lines.push(std::mem::take(&mut line) + ",");
        }
        if !line.is_empty() {
            line += ", ";
        }
        line += &setting;
    }
    lines.push(line);
    lines.join("\n")
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
        let text = table().print(Format::Text, &["line", "nodes"]);
        assert_eq!(text, "line 64\n\nnodes  misses     why\n    4     100       -\n   16       7  a, \"b\"\n");
    }

    #[test]
    fn csv_quotes_what_it_must() {
        let csv = table().print(Format::Csv, &[]);
        assert_eq!(csv, "line,nodes,misses,why\n64,4,100,\n64,16,7,\"a, \"\"b\"\"\"\n");
        let json: Value = serde_json::from_str(&table().print(Format::Json, &[])).expect("JSON");
        assert_eq!((json[1]["nodes"].as_u64(), json[0]["why"].is_null()), (Some(16), true));
    }
}
