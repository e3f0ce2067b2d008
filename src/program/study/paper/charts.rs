//! The study as charts.

use super::{GEARS, LINE, Paper, PaperScene, TEAPOT, Unit, verdicts};
use crate::study::figures::conditions::octree;
use crate::study::figures::traffic::Traffic;
use crate::study::page::charts::{self, curve, most, shares};
use crate::study::page::plot::{Axis, Chart, Series, Style};
use crate::study::page::{Figure, Page};
use crate::study::published;
use trace::scene::procedural::Board;
use trace::tracer::octree::Octree;

/// Charts, then all tables.
pub fn page(paper: &Paper) -> Page {
    let mut figures = vec![figure1(paper)];
    figures.extend([&GEARS, &TEAPOT].map(|scene| traffic(paper, scene)));
    figures.extend([0, 1].map(|scene| table1(paper, scene)));
    figures.push(curves(paper));
    figures.extend(paper.contention.iter().map(charts::contention));
    Page {
        title: "The 1991 paper's figures beside marti's".to_owned(),
        introduction: "M-P. Hébert, M. D. J. McNeill, B. Shah, R. L. Grimsdale, P. F. Lister: MARTI, a Multiprocessor \
                       Architecture for Ray Tracing Images, 1991. Lines are what this program finds; crosses are \
                       what the paper publishes as numbers. Where it leaves a setting open, several are shown, and \
                       how they were chosen is stated."
            .to_owned(),
        first: vec![verdicts::section(paper)],
        figures,
        last: Vec::new(),
        definitions: definitions(),
        text: super::text(paper),
    }
}

/// Words of the charts and tables.
fn definitions() -> Vec<(&'static str, String)> {
    [
        ("p", "Shared memory accesses over local memory accesses: here, misses per record access of a local memory. The paper's bound \
               on the number of nodes is 1/p."),
        ("N*", "(Z + S) / S, where Z is the mean time that a node computes between two transactions, and S the mean time that \
                a transaction holds the bus: the number of nodes from which on the bus, and not the nodes, limits the speed."),
        ("fixed", "What queueing theory expects of a closed network with the means of the simulation, if every transaction holds the \
                   bus for the same time (M/D/1//N)."),
        ("exponential", "The same if these times are distributed exponentially (mean value analysis)."),
        ("efficiency", "The time in which nodes compute, of the time in which they compute or wait for the bus."),
        ("1/32", "A local memory of this share of the database's bytes, for each node."),
    ]
    .map(|(word, meaning)| (word, meaning.to_owned()))
    .to_vec()
}

/// The octree that comes near to Figure 1.
const FIGURE1_SHOWN: Octree = super::leaves(12, 10);

fn figure1(paper: &Paper) -> Figure {
    let mut series = Vec::new();
    for (i, figure) in paper.figure1.iter().filter(|figure| figure.octree == FIGURE1_SHOWN).enumerate() {
        let style = if i == 0 { Style::Marked } else { Style::Dashed };
        let name = format!("{}, {}", figure.scene, octree(figure.octree));
        series.extend(charts::levels(&figure.levels, &format!("; {name}"), style));
    }
    Figure {
        chart: Chart {
            title: "Figure 1: nodes and accesses by octree level, teapot".to_owned(),
            x: charts::level_axis(&series),
            y: Axis::from_zero("per cent", most(&series)),
            series,
        },
        caption: format!(
            "All rays, with mailbox. The paper: {:.1}% of the nodes and {:.1}% of the accesses on the four deepest \
             levels.",
            100.0 * published::DEEPEST_NODES_SHARE,
            100.0 * published::DEEPEST_ACCESSES_SHARE
        ),
    }
}

fn of_scene<'a>(paper: &'a Paper, scene: &PaperScene) -> impl Iterator<Item = &'a Traffic> {
    let name = scene.source().to_string();
    paper.traffic.iter().filter(move |traffic| traffic.conditions.scene == name)
}

fn traffic(paper: &Paper, scene: &PaperScene) -> Figure {
    let shown: Vec<_> = of_scene(paper, scene).collect();
    let line = |traffic: &&Traffic| Series {
        name: format!("{} nodes, lines of {}", traffic.nodes, traffic.conditions.line_bytes),
        points: curve(traffic, |point| point.bus_bytes as f64 * 1e-6),
        style: Style::Line,
    };
    let series: Vec<Series> = shown.iter().map(line).collect();
    let messages = shown.first().map_or(0.0, |traffic| traffic.messages.bytes() as f64 * 1e-6);
    Figure {
        chart: Chart {
            title: format!("{}: cluster bus communication, {}", scene.figure, scene.source()),
            x: shares(),
            y: Axis::from_zero("million bytes on the bus", most(&series)),
            series,
        },
        caption: format!(
            "{}, {}; LRU, fully associative; tiles row by row, interleaved. Messages are {messages:.2} million bytes \
             besides. The paper's curves bear no numbers.",
            scene.source(),
            octree(super::OCTREE)
        ),
    }
}

fn table1(paper: &Paper, scene: usize) -> Figure {
    let at = |values: [f64; 4]| -> Vec<(f64, f64)> {
        [1.0 / 4.0, 1.0 / 8.0, 1.0 / 16.0, 1.0 / 32.0].into_iter().zip(values).collect()
    };
    // The best of each kind.
    let mut best: Vec<_> = paper.settings.iter().collect();
    best.sort_by(|a, b| a.rmse.total_cmp(&b.rmse));
    let kind = |setting: &super::Setting| (setting.board, matches!(setting.unit, Unit::Whole { .. }));
    let mut kinds = Vec::new();
    best.retain(|found| {
        let is_new = !kinds.contains(&kind(&found.setting));
        kinds.push(kind(&found.setting));
        is_new
    });
    let name = |setting: &super::Setting| match (setting.unit, setting.board) {
        (Unit::Whole { .. }, _) => "polygons of 300 bytes",
        (_, Board::None) => "lines, without the board",
        (_, Board::Squares) => "lines, with the board",
    };
    let style = |setting: &super::Setting| match (setting.unit, setting.board) {
        (Unit::Whole { .. }, _) => Style::Line,
        (_, Board::None) => Style::Marked,
        (_, Board::Squares) => Style::Dashed,
    };
    let mut series: Vec<Series> = best
        .iter()
        .map(|found| Series {
            name: name(&found.setting).to_owned(),
            points: at(found.cells[scene].found),
            style: style(&found.setting),
        })
        .collect();
    let of = [&GEARS, &TEAPOT][scene];
    series.push(Series { name: "published".to_owned(), points: at(of.table), style: Style::Published });
    Figure {
        chart: Chart {
            title: format!("Table 1: shared / local memory accesses, {}", of.scene.kind),
            x: shares(),
            y: Axis::from_zero("misses / accesses", most(&series)),
            series,
        },
        caption: format!(
            "{} nodes, LRU, fully associative; tiles row by row. The best setting of each kind, the same in both charts; the tables have them.",
            published::TABLE_NODES
        ),
    }
}

fn curves(paper: &Paper) -> Figure {
    let shown = paper
        .traffic
        .iter()
        .filter(|traffic| traffic.nodes == published::TABLE_NODES && traffic.conditions.line_bytes == LINE);
    let line = |traffic: &Traffic| {
        let accesses = traffic.sizes.first().map_or(1.0, |size| size.counts.record_accesses as f64);
        Series {
            name: format!("{}, {}", traffic.conditions.scene, octree(traffic.conditions.octree)),
            points: curve(traffic, |point| point.misses as f64 / accesses),
            style: if traffic.conditions.scene == GEARS.source().to_string() { Style::Dashed } else { Style::Line },
        }
    };
    let series: Vec<Series> = shown.map(line).collect();
    Figure {
        chart: Chart {
            title: "LRU: misses / record accesses, all sizes".to_owned(),
            x: shares(),
            y: Axis::from_zero("misses / record accesses", most(&series)),
            series,
        },
        caption: format!(
            "{} nodes, lines of {} bytes, fully associative; tiles row by row, interleaved. One pass by stack distances.",
            published::TABLE_NODES,
            LINE
        ),
    }
}
