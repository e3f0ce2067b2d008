//! Charts that several studies have.

use crate::study::figures::contention::Contention;
use crate::study::figures::levels::Level;
use crate::study::figures::traffic::{CurvePoint, Traffic};
use crate::study::page::Figure;
use crate::study::page::plot::{Axis, Chart, Series, Style};
use machine::replay::contention::table::ContentionRow;

/// From 1/32 to the whole database.
pub fn shares() -> Axis {
    let tick = |power: i32| {
        let label = if power == 0 { "1".to_owned() } else { format!("1/{}", 1 << -power) };
        (libm::exp2(f64::from(power)), label)
    };
    Axis::logarithmic("local memory of one node, of the database", (1.0 / 32.0, 1.0), (-5..=0).map(tick).collect())
}

/// A curve of all sizes from 1/32 on.
pub fn curve(traffic: &Traffic, of: impl Fn(&CurvePoint) -> f64) -> Vec<(f64, f64)> {
    let share = |bytes: u64| bytes as f64 / traffic.conditions.database_bytes as f64;
    let points = traffic.curve.iter().map(|point| (share(point.local_bytes), of(point)));
    points.filter(|&(share, _)| share > 0.99 / 32.0).collect()
}

/// The largest value.
pub fn most(series: &[Series]) -> f64 {
    series.iter().flat_map(|series| &series.points).map(|&(_, y)| y).fold(0.0, f64::max)
}

/// Shares of nodes and of accesses by octree level, per cent.
pub fn levels(levels: &[Level], name: &str, style: Style) -> [Series; 2] {
    let series = |what: &str, of: fn(&Level) -> u64| {
        let all = levels.iter().map(of).sum::<u64>().max(1) as f64;
        let points = levels.iter().map(|level| (f64::from(level.level), 100.0 * of(level) as f64 / all)).collect();
        Series { name: format!("{what}{name}"), points, style }
    };
    [series("nodes", |level| level.nodes), series("accesses", |level| level.accesses)]
}

/// Down to the deepest level of all.
pub fn level_axis(series: &[Series]) -> Axis {
    let deepest = series.iter().map(|series| series.points.len()).max().unwrap_or(1).max(2) as u32 - 1;
    let ticks = (0..=deepest).map(|level| (f64::from(level), level.to_string())).collect();
    Axis::linear("level", (0.0, f64::from(deepest)), ticks)
}

/// Numbers of nodes up to the last one, by powers of two.
pub fn node_axis(last: u16) -> Axis {
    let last = last.max(2);
    let ticks = (0..9).map(|power| 1u16 << power).filter(|&nodes| nodes <= last);
    let ticks = ticks.map(|nodes| (f64::from(nodes), nodes.to_string())).collect();
    Axis::logarithmic("nodes", (1.0, f64::from(last)), ticks)
}

/// Simulated and expected efficiency.
pub fn contention(contention: &Contention) -> Figure {
    let Contention { conditions, local_memory, bus, table, .. } = contention;
    let series = |name: &str, style, of: fn(&ContentionRow) -> f64| Series {
        name: name.to_owned(),
        points: table.rows.iter().map(|row| (f64::from(row.setting.nodes), 100.0 * of(row))).collect(),
        style,
    };
    let last = table.rows.iter().map(|row| row.setting.nodes).max().unwrap_or(2);
    Figure {
        chart: Chart {
            title: format!("Contention: {}, lines of {}", conditions.scene, conditions.line_bytes),
            x: node_axis(last),
            y: Axis::from_zero("per cent", 100.0),
            series: vec![
                series("efficiency, simulated", Style::Marked, |row| row.efficiency),
                series("bus held, simulated", Style::Marked, |row| row.bus_utilisation),
                series("efficiency, fixed service", Style::Dashed, |row| row.fixed_efficiency),
                series("efficiency, exponential service", Style::Dashed, |row| row.exponential_efficiency),
            ],
        },
        caption: format!(
            "{}; local memory {local_memory}, lines of {} bytes, LRU, fully associative; tiles on demand, row by row. Bus of {} bytes a cycle, latency {}. \
             Formulae: closed networks with the mean times of each simulation.",
            conditions.subject(),
            conditions.line_bytes,
            bus.width,
            bus.latency
        ),
    }
}
