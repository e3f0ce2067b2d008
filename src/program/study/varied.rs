//! Charts and a table of the rows of a sweep: what was varied becomes axes and series, and every row has its ratio to the first.

use serde_json::{Map, Value};

use crate::study::page::Figure;
use crate::study::page::grid::{Cell, Grid};
use crate::study::page::plot::{Axis, Chart, Series, Style};
use crate::study::page::table::{grouped, percent};
use machine::hardware::specification::MemorySize;
use machine::replay::model::evaluation::Row;

/// A setting that may be varied: its column, and how a person reads its values: before the value, and after it.
type Dimension = (&'static str, &'static str, &'static str);

/// The first of those that are numbers are the better x axes.
const NUMBERS: [Dimension; 11] = [
    ("local_memory", "local memory of one node", ""),
    ("nodes", "nodes per cluster", ""),
    ("line", "line", "bytes"),
    ("bus_width", "bus width", "bytes"),
    ("latency", "latency of the cluster memory", "cycles"),
    ("cycles_per_word", "bus word", "cycles"),
    ("clusters", "clusters", ""),
    ("octree_node", "octree node", "cycles"),
    ("primitive_test", "primitive test", "cycles"),
    ("shading", "shading", "cycles"),
    ("local_access", "local access", "cycles"),
];
const NAMES: [Dimension; 6] = [
    ("replacement", "replacement", ""),
    ("ways", "ways", ""),
    ("arbiter", "arbiter", ""),
    ("transactions", "transactions", ""),
    ("assignment", "assignment", ""),
    ("tile_order", "tile order", ""),
];
/// So many series fit into a chart before there are several charts.
const SERIES_MAX: usize = 8;
/// Beyond so many charts of one quantity, all is in one of them: what is too much for it can be switched on.
const PANELS_MAX: usize = 6;

/// A quantity of a row, as charts and table show it.
struct Quantity {
    name: &'static str,
    unit: &'static str,
    of: fn(&Row, &Row) -> Option<f64>,
}

const CHARTED: [Quantity; 3] = [
    Quantity { name: "Misses", unit: "% of record accesses", of: |row, _| Some(100.0 * row.misses_per_record_access) },
    Quantity { name: "Cycles", unit: "million cycles", of: |row, _| Some(row.cycles? as f64 * 1e-6) },
    Quantity { name: "Speed-up over the first row", unit: "times as fast", of: speed_up },
];

fn speed_up(row: &Row, first: &Row) -> Option<f64> {
    Some(first.cycles? as f64 / row.cycles?.max(1) as f64)
}

/// Rows with their settings.
pub struct Varied<'a> {
    rows: &'a [Row],
    settings: Vec<Map<String, Value>>,
    database_bytes: u64,
}

impl<'a> Varied<'a> {
    pub fn new(rows: &'a [Row], database_bytes: u64) -> Self {
        // A setting is an object without maps whose keys are no text.
        let settings = rows.iter().map(|row| match serde_json::to_value(row.setting) {
            Ok(Value::Object(columns)) => columns,
            _ => Map::new(),
        });
        Self { rows, settings: settings.collect(), database_bytes }
    }

    /// A chart of every quantity that was found, or several where one would have too many series.
    pub fn figures(&self) -> Vec<Figure> {
        let Some(first) = self.rows.first() else { return Vec::new() };
        let Some(x) = self.x() else { return Vec::new() };
        let (series, panels) = self.divided(x);
        let mut keys: Vec<String> = Vec::new();
        for i in 0..self.rows.len() {
            let key = self.key(i, &panels);
            if !keys.contains(&key) {
                keys.push(key);
            }
        }
        let mut figures = Vec::new();
        for quantity in &CHARTED {
            if self.rows.iter().all(|row| (quantity.of)(row, first).is_none()) {
                continue;
            }
            for key in &keys {
                let of = |i: usize| (quantity.of)(&self.rows[i], first);
                let of_panel = (0..self.rows.len()).filter(|&i| self.key(i, &panels) == *key);
                let series = self.series(of_panel, x, &series, of);
                figures.push(self.figure(quantity, x, key, series));
            }
        }
        figures
    }

    fn figure(&self, quantity: &Quantity, x: Dimension, panel: &str, series: Vec<Series>) -> Figure {
        let all = series.iter().flat_map(|series| series.points.iter().map(|point| point.1));
        let y = Axis::fitting(quantity.unit, all);
        let besides = if panel.is_empty() { String::new() } else { format!(": {panel}") };
        let title = format!("{} by {}{besides}", quantity.name, x.1);
        let approximate = if self.rows.iter().all(|row| row.exact) {
            ""
        } else {
            " Some points are approximate: the table says why."
        };
        let caption = format!("Rows of the table. {}.{approximate}", self.constant());
        Figure { chart: Chart { title, x: self.axis(x), y, series }, caption }
    }

    fn series(
        &self,
        rows: impl Iterator<Item = usize>,
        x: Dimension,
        by: &[Dimension],
        of: impl Fn(usize) -> Option<f64>,
    ) -> Vec<Series> {
        let mut all: Vec<Series> = Vec::new();
        for i in rows {
            let Some(y) = of(i) else { continue };
            let (at, name) = ((self.place(i, x), y), self.key(i, by));
            match all.iter_mut().find(|series| series.name == name) {
                Some(series) => series.points.push(at),
                None => all.push(Series { name, points: vec![at], style: Style::Marked }),
            }
        }
        for series in &mut all {
            series.points.sort_by(|a, b| a.0.total_cmp(&b.0));
            if series.name.is_empty() {
                series.name = "all rows".to_owned();
            }
        }
        all
    }

    /// The setting that is varied most often among numbers; if none is, among names.
    fn x(&self) -> Option<Dimension> {
        let most = |of: &[Dimension]| {
            let varied = of.iter().filter(|dimension| self.values(dimension.0) > 1);
            varied.copied().rev().max_by_key(|dimension| self.values(dimension.0))
        };
        most(&NUMBERS).or_else(|| most(&NAMES))
    }

    /// What else is varied: by series, as long as these are not too many, and by chart.
    fn divided(&self, x: Dimension) -> (Vec<Dimension>, Vec<Dimension>) {
        let (mut series, mut panels) = (Vec::new(), Vec::new());
        let (mut lines, mut charts) = (1, 1);
        for dimension in NAMES.into_iter().chain(NUMBERS) {
            let values = self.values(dimension.0);
            if dimension.0 == x.0 || values < 2 {
            } else if lines * values <= SERIES_MAX {
                lines *= values;
                series.push(dimension);
            } else {
                charts *= values;
                panels.push(dimension);
            }
        }
        if charts > PANELS_MAX {
            series.append(&mut panels);
        }
        (series, panels)
    }

    /// How many values a column has.
    fn values(&self, column: &str) -> usize {
        let mut values: Vec<&Value> = Vec::new();
        for value in self.settings.iter().filter_map(|columns| columns.get(column)) {
            if !values.contains(&value) {
                values.push(value);
            }
        }
        values.len()
    }

    /// A row's values of these settings.
    fn key(&self, i: usize, of: &[Dimension]) -> String {
        let named = |&(column, name, unit): &Dimension| {
            let space = if unit.is_empty() { "" } else { " " };
            format!("{name} {}{space}{unit}", self.shown(i, column))
        };
        of.iter().map(named).collect::<Vec<_>>().join(", ")
    }

    fn shown(&self, i: usize, column: &str) -> String {
        match self.settings[i].get(column) {
            Some(Value::String(text)) => text.clone(),
            Some(Value::Null) | None => "full".to_owned(),
            Some(value) => value.to_string(),
        }
    }

    /// Where a row is on the axis: memories by their share of the database, numbers as they are, names in their order.
    fn place(&self, i: usize, (column, ..): Dimension) -> f64 {
        if column == "local_memory" {
            return match self.rows[i].setting.local_memory {
                MemorySize::All => 1.0,
                MemorySize::Share { numerator, denominator } => f64::from(numerator) / f64::from(denominator),
                MemorySize::Bytes(bytes) => bytes as f64 / self.database_bytes.max(1) as f64,
            };
        }
        let value = |i: usize| &self.settings[i][column];
        value(i).as_f64().unwrap_or_else(|| {
            let mut values: Vec<&Value> = Vec::new();
            for i in 0..self.rows.len() {
                if !values.contains(&value(i)) {
                    values.push(value(i));
                }
            }
            values.iter().position(|other| *other == value(i)).unwrap_or(0) as f64
        })
    }

    fn axis(&self, x: Dimension) -> Axis {
        let mut ticks: Vec<(f64, String)> = Vec::new();
        for i in 0..self.rows.len() {
            let place = self.place(i, x);
            if ticks.iter().all(|tick| tick.0 != place) {
                ticks.push((place, self.shown(i, x.0)));
            }
        }
        ticks.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (first, last) = (ticks[0].0, ticks[ticks.len() - 1].0);
        let label = match x.2 {
            _ if x.0 == "local_memory" => format!("{}, of the database", x.1),
            "" => x.1.to_owned(),
            unit => format!("{}, {unit}", x.1),
        };
        // All memories of one size are one place.
        let last = if last > first { last } else { first + 1.0 };
        let range = (first, last);
        if first > 0.0 && last >= 3.0 * first {
            Axis::logarithmic(&label, range, ticks)
        } else {
            Axis::linear(&label, range, ticks)
        }
    }

    /// What is the same in all rows.
    pub fn constant(&self) -> String {
        let same = |dimension: &&Dimension| self.values(dimension.0) == 1;
        let constant: Vec<Dimension> = NUMBERS.iter().chain(&NAMES).filter(same).copied().collect();
        format!("The same in all rows: {}", self.key(0, &constant))
    }

    /// What is varied, what was found, and how it compares with the first row.
    pub fn grid(&self) -> Grid {
        let Some(first) = self.rows.first() else { return Grid::default() };
        let varied: Vec<Dimension> =
            NUMBERS.iter().chain(&NAMES).filter(|dimension| self.values(dimension.0) > 1).copied().collect();
        let is_timed = self.rows.iter().any(|row| row.cycles.is_some());
        let mut columns: Vec<String> = vec!["row".to_owned()];
        columns.extend(varied.iter().map(|&(_, name, unit)| match unit {
            "" => name.to_owned(),
            unit => format!("{name}, {unit}"),
        }));
        let mut counted =
            vec!["misses", "misses, % of record accesses", "misses, × first row", "words fetched, % of words read"];
        if is_timed {
            counted.extend([
                "cycles",
                "speed-up, × first row",
                "efficiency, %",
                "bus held, %",
                "mean wait, cycles",
                "99% wait, cycles",
            ]);
        }
        columns.extend(counted.into_iter().chain(["exact?"]).map(str::to_owned));
        let rows = self.rows.iter().enumerate().map(|(i, row)| {
            let mut cells = vec![Cell::number((i + 1).to_string(), (i + 1) as f64)];
            cells.extend(varied.iter().map(|&dimension| {
                let is_number = NUMBERS.contains(&dimension);
                let shown = self.shown(i, dimension.0);
                if is_number { Cell::number(shown, self.place(i, dimension)) } else { Cell::words(shown) }
            }));
            cells.extend([
                count(row.counts.misses),
                share(row.misses_per_record_access),
                times(row.counts.misses as f64 / first.counts.misses.max(1) as f64),
                share(row.words_moved_per_word_read),
            ]);
            if is_timed {
                cells.extend([
                    row.cycles.map_or_else(Cell::empty, count),
                    speed_up(row, first).map_or_else(Cell::empty, times),
                    row.efficiency.map_or_else(Cell::empty, share),
                    row.bus_utilisation.map_or_else(Cell::empty, share),
                    row.wait_mean.map_or_else(Cell::empty, |cycles| Cell::number(format!("{cycles:.1}"), cycles)),
                    row.wait_percentile_99.map_or_else(Cell::empty, count),
                ]);
            }
            cells.push(Cell::words(match &row.reason {
                Some(reason) => format!("approximate: {reason}"),
                None => if row.exact { "exact" } else { "approximate" }.to_owned(),
            }));
            cells
        });
        Grid { columns, rows: rows.collect() }
    }
}

fn count(count: u64) -> Cell {
    Cell::number(grouped(count), count as f64)
}

fn share(share: f64) -> Cell {
    Cell::number(percent(share, 3).trim_end_matches('%'), share)
}

fn times(ratio: f64) -> Cell {
    Cell::number(format!("{ratio:.3}"), ratio)
}
