//! Rows as text, JSON and CSV: whatever serialises to an object is a row, and its fields are the columns.

mod column;
mod text;

use std::fmt;

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

/// What rows are compared by, the first that there is: every row with the first one.
const BASELINES: [&str; 3] = ["cycles", "misses", "object_misses"];

/// Lists of columns that mean nothing in a table.
pub(super) type Hidden = &'static [&'static [&'static str]];

/// Rows of one kind.
pub(super) struct Table {
    /// As JSON.
    json: String,
    columns: Vec<String>,
    /// Columns that a person is not shown.
    hidden: Hidden,
    /// A value per column.
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

    /// In this format. As text, columns of `settings` name a row, and what is the same in all rows is above the table.
    pub(super) fn print(&self, format: Format, settings: &[&str]) -> String {
        match format {
            Format::Text => self.text(settings, &BASELINES),
            Format::Json => self.json.clone(),
            Format::Csv => self.csv(),
        }
    }

    /// A line per row, below one of names.
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

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

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
    fn what_is_the_same_is_above_the_table() {
        let text = table().print(Format::Text, &["line", "nodes"]);
        let expected = "line 64 bytes\n\n\
                        \x20                      misses ÷\n\
                        \x20                         first\n\
                        nodes  misses     why     row's\n\
                        \x20   4     100       -     1.000\n\
                        \x20  16       7  a, \"b\"     0.070\n";
        assert_eq!(text, expected);
    }

    #[test]
    fn one_row_is_a_list() {
        let row = Row { line: 64, nodes: 4, misses: 12_345, why: None };
        let text = Table::new(&[row]).expect("a row").print(Format::Text, &["line", "nodes"]);
        assert_eq!(text, "line 64 bytes, nodes 4\n\nmisses  12,345\n");
    }

    #[test]
    fn a_wide_table_is_in_blocks() {
        let row =
            |seed: u64| -> BTreeMap<String, u64> { (0..30).map(|i| (format!("column_{i:02}"), seed + i)).collect() };
        let text = Table::new(&[row(1), row(1_000_000)]).expect("rows").print(Format::Text, &["column_00"]);
        assert!(text.lines().all(|line| line.chars().count() <= 100), "{text}");
        assert_eq!(
            text.matches("\n\n").count() + 1,
            text.matches("1,000,000").count(),
            "each block names its rows: {text}"
        );
        assert_eq!(text.matches("1,000,029").count(), 1);
    }

    #[test]
    fn csv_quotes_what_it_must() {
        let csv = table().print(Format::Csv, &[]);
        assert_eq!(csv, "line,nodes,misses,why\n64,4,100,\n64,16,7,\"a, \"\"b\"\"\"\n");
        let json: Value = serde_json::from_str(&table().print(Format::Json, &[])).expect("JSON");
        assert_eq!((json[1]["nodes"].as_u64(), json[0]["why"].is_null()), (Some(16), true));
    }
}
