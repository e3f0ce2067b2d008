//! `marti replay RECORDING --curve`: misses of LRU memories of all sizes.

use serde::Serialize;

use crate::cli::grid_options::SETTINGS;
use crate::cli::table::{Format, Hidden, Table};
use crate::cli::{Failure, print};
use ground::outlet;
use machine::replay::model::counts::ratio;
use machine::replay::model::curve::{LruCurve, curve};
use machine::replay::model::recount::recount;
use machine::replay::plan::schedule::schedule;
use machine::replay::plan::setting::{Assignment, Policy, Setting};
use machine::replay::stream::subject::Subject;
use machine::replay::{Lines, parallel};
use machine::tile_order::TileOrder;

/// Records of which a list is the brute force.
const LIST_RECORDS: u64 = 50_000;

/// A node's curve, or that of all nodes together, at one size of each node's memory.
#[derive(Serialize)]
struct Row {
    /// Bytes.
    line: u32,
    /// As of all rows: that is what a curve is of.
    replacement: Policy,
    ways: Option<u32>,
    nodes: u16,
    clusters: u16,
    tile_order: TileOrder,
    assignment: Assignment,
    /// `None`: all nodes together.
    node: Option<u32>,
    /// Of a node's memory.
    lines: u32,
    local_bytes: u64,
    record_accesses: u64,
    misses: u64,
    line_misses: u64,
    words_moved: u64,
    misses_per_record_access: f64,
    /// Whether a live run would count the same.
    exact: bool,
}

pub(super) fn print_curves<S: Subject>(
    subject: &S,
    settings: &[Setting],
    format: Format,
    is_verified: bool,
    is_damaged: bool,
    hidden: Hidden,
) -> Result<(), Failure> {
    let mut rows = Vec::new();
    let mut seen = Vec::new();
    for setting in settings {
        let of = (setting.line, setting.nodes, setting.clusters, setting.tile_order, setting.assignment);
        if setting.assignment == Assignment::OnDemand {
            return Err(Failure::bad_input("--curve needs a fixed assignment: expected recorded or interleaved"));
        }
        if !seen.contains(&of) {
            seen.push(of);
            curves_of(subject, setting, format, is_verified, &mut rows)?;
        }
    }
    rows.iter_mut().for_each(|row| row.exact = !is_damaged);
    print(&Table::new(&rows)?.hiding(hidden).print(format, &SETTINGS))
}

fn curves_of<S: Subject>(
    subject: &S,
    setting: &Setting,
    format: Format,
    is_verified: bool,
    rows: &mut Vec<Row>,
) -> Result<(), Failure> {
    let failed = |error: machine::replay::TraceError| Failure::failed(error.to_string());
    let lines = subject.lines(setting.line);
    let schedule = schedule(subject, setting);
    let curves = parallel::map(&schedule.nodes, |processes| {
        let mut sum = LruCurve::default();
        for tiles in processes {
            let one = curve(subject, tiles, &lines)?;
            if is_verified {
                check(subject, tiles, &lines, &one)?;
            }
            sum.add(&one);
        }
        Ok(sum)
    });
    let curves = curves.into_iter().collect::<Result<Vec<_>, _>>().map_err(failed)?;
    let mut all = LruCurve::default();
    curves.iter().for_each(|curve| all.add(curve));
    let mut add = |node: Option<u32>, curve: &LruCurve, sizes: &mut dyn Iterator<Item = u32>| {
        for lines in sizes {
            let counts = curve.at(lines);
            rows.push(Row {
                line: setting.line,
                replacement: Policy::Lru,
                ways: None,
                nodes: setting.nodes,
                clusters: setting.clusters,
                tile_order: setting.tile_order,
                assignment: setting.assignment,
                node,
                lines,
                local_bytes: u64::from(lines) * u64::from(setting.line),
                record_accesses: counts.record_accesses,
                misses: counts.record_misses,
                line_misses: counts.line_misses,
                words_moved: counts.line_misses * u64::from(setting.line) / 4,
                misses_per_record_access: ratio(counts.record_misses, counts.record_accesses),
                exact: true,
            });
        }
    };
    if format == Format::Text {
        // For people, doublings up to where nothing changes any more.
        let enough = all.enough().max(1);
        let mut doublings = (0..32).map(|i| 1u32 << i).take_while(|&lines| lines < enough).chain([enough]);
        add(None, &all, &mut doublings);
        return Ok(());
    }
    for (node, curve) in (0..).zip(&curves) {
        add(Some(node), curve, &mut curve.points().into_iter().map(|point| point.lines));
    }
    add(None, &all, &mut all.points().into_iter().map(|point| point.lines));
    Ok(())
}

/// Recomputes a sample of the curve, and reports what does not agree.
fn check<S: Subject>(
    subject: &S,
    tiles: &[u32],
    lines: &impl Lines,
    curve: &LruCurve,
) -> Result<(), machine::replay::TraceError> {
    let enough = curve.enough().max(1);
    let sizes: Vec<u32> = [1, 7, enough / 32, enough / 8, enough / 2, enough]
        .into_iter()
        .filter(|&size| size >= 1 && size <= lines.count())
        .collect();
    let compared = recount(subject, tiles, lines, curve, &sizes, LIST_RECORDS)?;
    if let Some(wrong) = compared.iter().find(|one| !one.agrees()) {
        return Err(machine::replay::TraceError(format!("the curve is not what brute force counts: {wrong:?}")));
    }
    outlet::say(format_args!("{} sizes recomputed by brute force: all agree", compared.len()));
    Ok(())
}
