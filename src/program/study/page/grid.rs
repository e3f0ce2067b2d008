//! Tables as HTML: the first column remains in sight, the page's script sorts them.

use std::fmt;

use crate::study::page::Escaped;

/// Rows of as many cells as there are columns.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Grid {
    pub columns: Vec<String>,
    pub rows: Vec<Vec<Cell>>,
}

/// What is shown, and what it is sorted by.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    text: String,
    /// `None`: the text.
    value: Option<f64>,
    is_words: bool,
}

impl Cell {
    pub fn number(text: impl Into<String>, value: f64) -> Self {
        Self { text: text.into(), value: Some(value), is_words: false }
    }

    /// To the left, and broken where it is long.
    pub fn words(text: impl Into<String>) -> Self {
        Self { text: text.into(), value: None, is_words: true }
    }

    pub fn empty() -> Self {
        Self { text: String::new(), value: None, is_words: false }
    }
}

impl fmt::Display for Grid {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(out, "<table class=\"sortable\">\n<thead><tr>")?;
        for (i, column) in self.columns.iter().enumerate() {
            let are_words = self.rows.first().and_then(|row| row.get(i)).is_some_and(|cell| cell.is_words);
            let class = if are_words { " class=\"words\"" } else { "" };
            writeln!(out, "<th{class} scope=\"col\">{}</th>", Escaped(column))?;
        }
        writeln!(out, "</tr></thead>\n<tbody>")?;
        for row in &self.rows {
            write!(out, "<tr>")?;
            for cell in row {
                let class = if cell.is_words { " class=\"words\"" } else { "" };
                let value = cell.value.map(|value| format!(" data-value=\"{value}\"")).unwrap_or_default();
                write!(out, "<td{class}{value}>{}</td>", Escaped(&cell.text))?;
            }
            writeln!(out, "</tr>")?;
        }
        writeln!(out, "</tbody>\n</table>")
    }
}
