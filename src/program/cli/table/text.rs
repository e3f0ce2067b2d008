//! A table for a person: at most 100 columns wide, what is the same in all rows above it.

use std::fmt::Write;

use serde_json::Value;

use super::Table;
use super::column::{cell, head, setting};

/// Characters per line, whether a terminal or a pipe reads it.
const WIDTH_MAX: usize = 100;
/// Heads are wrapped at this width, or where the cells are wider, at theirs.
const HEAD_WIDTH: usize = 10;
const GAP: &str = "  ";

/// A column as it is printed.
struct Column {
    head: Vec<String>,
    cells: Vec<String>,
    width: usize,
}

impl Column {
    fn new(name: &str, cells: Vec<String>) -> Self {
        let widest = cells.iter().map(|cell| cell.chars().count()).max().unwrap_or(0);
        let word = name.split(' ').map(|word| word.chars().count()).max().unwrap_or(0);
        let head = wrapped(name.split(' ').map(str::to_owned), " ", widest.max(word).max(HEAD_WIDTH));
        let width = head.iter().map(|line| line.chars().count()).max().unwrap_or(0).max(widest);
        Self { head, cells, width }
    }

    /// A line of the head, of so many, which end at the table; or a cell.
    fn head_line(&self, line: usize, lines: usize) -> &str {
        (line + self.head.len()).checked_sub(lines).map_or("", |line| &self.head[line])
    }
}

impl Table {
    /// The rows, below what is the same in all of them. Columns of `settings` that vary name a row. Where there is a `baseline`, the
    /// last column is its ratio to that of the first row.
    pub(super) fn text(&self, settings: &[&str], baseline: &[&str]) -> String {
        let Some(first) = self.rows.first() else { return String::new() };
        let varies = |i: usize| self.rows.iter().any(|row| row[i] != first[i]);
        // Rows that are the same in everything are a table nevertheless.
        let any_varies = (0..self.columns.len()).any(|i| !settings.contains(&self.columns[i].as_str()) && varies(i));
        let (mut same, mut names, mut values) = (Vec::new(), Vec::new(), Vec::new());
        for (i, column) in self.columns.iter().enumerate() {
            let is_setting = settings.contains(&column.as_str());
            let is_filled = self.rows.iter().any(|row| !row[i].is_null());
            if self.is_hidden(column) || column == "reason" || (!is_setting && !is_filled) {
            } else if varies(i) || (!is_setting && !any_varies) {
                let cells = self.rows.iter().map(|row| cell(column, &row[i])).collect();
                let column = Column::new(&head(column), cells);
                if is_setting { names.push(column) } else { values.push(column) }
            } else if is_setting || self.rows.len() > 1 {
                same.push(setting(column, &first[i]));
            } else {
                values.push(Column::new(&head(column), vec![cell(column, &first[i])]));
            }
        }
        let mut out = String::new();
        if !same.is_empty() {
            let _ = writeln!(out, "{}\n", list(same));
        }
        if self.rows.len() == 1 {
            write_one(&mut out, &values);
            return out;
        }
        values.extend(self.ratios(baseline));
        let blocks = blocks(&names, values);
        for (at, values) in blocks.iter().enumerate() {
            if at > 0 {
                out.push('\n');
            }
            write_block(&mut out, &names.iter().chain(values).collect::<Vec<_>>(), self.rows.len());
        }
        out
    }

    /// The first of these columns that has numbers only, as ratios to the first row.
    fn ratios(&self, baseline: &[&str]) -> Option<Column> {
        let numbers = |name: &&str| {
            let i = self.columns.iter().position(|column| column == name)?;
            let numbers: Option<Vec<f64>> = self.rows.iter().map(|row| row[i].as_f64()).collect();
            let numbers = numbers.filter(|numbers| !self.is_hidden(name) && numbers[0] > 0.0)?;
            let cells = numbers.iter().map(|number| format!("{:.3}", number / numbers[0])).collect();
            Some(Column::new(&format!("{} ÷ first row's", head(name)), cells))
        };
        baseline.iter().find_map(numbers)
    }

    /// The settings of the first row, for what is no table.
    pub(in crate::cli) fn heading(&self, settings: &[&str]) -> String {
        let Some(first) = self.rows.first() else { return String::new() };
        let is_shown = |column: &str| settings.contains(&column) && !self.is_hidden(column);
        let shown = self.columns.iter().zip(first).filter(|(column, _): &(&String, &Value)| is_shown(column));
        list(shown.map(|(column, value)| setting(column, value)).collect())
    }
}

/// One row: a line per value.
fn write_one(out: &mut String, values: &[Column]) {
    let names: Vec<String> = values.iter().map(|value| value.head.join(" ")).collect();
    let width = |lengths: &mut dyn Iterator<Item = usize>| lengths.max().unwrap_or(0);
    let name_width = width(&mut names.iter().map(|name| name.chars().count()));
    let value_width = width(&mut values.iter().map(|value| value.width.min(value.cells[0].chars().count())));
    for (name, value) in names.iter().zip(values) {
        let _ = writeln!(out, "{name:<name_width$}{GAP}{:>value_width$}", value.cells[0]);
    }
}

/// As many columns side by side as there is room for, each time beside those that name the rows.
fn blocks(names: &[Column], values: Vec<Column>) -> Vec<Vec<Column>> {
    let room = |columns: &[Column]| columns.iter().map(|column| column.width + GAP.len()).sum::<usize>();
    let mut blocks: Vec<Vec<Column>> = vec![Vec::new()];
    for value in values {
        let is_full = room(names) + blocks.last().map_or(0, |block| room(block)) + value.width > WIDTH_MAX;
        match blocks.last_mut() {
            Some(block) if !is_full || block.is_empty() => block.push(value),
            _ => blocks.push(vec![value]),
        }
    }
    blocks
}

fn write_block(out: &mut String, columns: &[&Column], rows: usize) {
    let lines = columns.iter().map(|column| column.head.len()).max().unwrap_or(0);
    let mut write_line = |of: &dyn Fn(&Column) -> String| {
        let cells: Vec<_> = columns.iter().map(|column| format!("{:>1$}", of(column), column.width)).collect();
        let _ = writeln!(out, "{}", cells.join(GAP).trim_end());
    };
    for line in 0..lines {
        write_line(&|column| column.head_line(line, lines).to_owned());
    }
    for row in 0..rows {
        write_line(&|column| column.cells[row].clone());
    }
}

/// Settings between commas, in lines.
fn list(settings: Vec<String>) -> String {
    let last = settings.len().saturating_sub(1);
    let with_comma = |(i, setting): (usize, String)| if i < last { setting + "," } else { setting };
    wrapped(settings.into_iter().enumerate().map(with_comma), " ", WIDTH_MAX).join("\n")
}

/// Words in lines of at most so many characters, where none is longer.
fn wrapped(words: impl Iterator<Item = String>, between: &str, width: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in words {
        match lines.last_mut() {
            Some(line) if line.chars().count() + between.len() + word.chars().count() <= width => {
                line.push_str(between);
                line.push_str(&word);
            }
            _ => lines.push(word),
        }
    }
    lines
}
