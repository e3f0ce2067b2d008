//! The study as charts.

use super::{GEARS, LINES, Paper, PaperScene, TEAPOT};
use crate::study::figures::conditions::octree;
use crate::study::figures::ratio::Ratio;
use crate::study::figures::traffic::Traffic;
use crate::study::page::charts::{self, curve, most, shares};
use crate::study::page::plot::{Axis, Chart, Series, Style};
use crate::study::page::{Figure, Page};
use crate::study::published;
use trace::tracer::octree::Octree;

/// Charts, then all tables.
pub fn page(paper: &Paper) -> Page {
    let mut figures = vec![figure1(paper)];
    figures.extend([&GEARS, &TEAPOT].map(|scene| traffic(paper, scene)));
    figures.extend([&GEARS, &TEAPOT].map(|scene| table1(paper, scene)));
    figures.push(curves(paper));
    figures.extend(paper.contention.iter().map(charts::contention));
    Page {
        title: "The 1991 paper's figures beside marti's".to_owned(),
        introduction: "M-P. Hébert, M. D. J. McNeill, B. Shah, R. L. Grimsdale, P. F. Lister: MARTI, a Multiprocessor \
                       Architecture for Ray Tracing Images, 1991. Lines are what this program finds; black crosses are \
                       what the paper publishes as numbers. Where it leaves a setting open, several are shown: \
                       nothing is tuned that is not said."
            .to_owned(),
        figures,
        text: super::text(paper),
    }
}

fn figure1(paper: &Paper) -> Figure {
    let mut series = Vec::new();
    for (i, figure) in paper.figure1.iter().enumerate() {
        let style = if i == 0 { Style::Marked } else { Style::Dashed };
        let name = octree(figure.octree);
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
            "{}, all rays, with mailbox. The paper: {:.1}% of the nodes and {:.1}% of the accesses on the four deepest \
             levels.",
            TEAPOT.source(),
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
    let first = scene.octrees.first().copied().unwrap_or(Octree::DEFAULT);
    let shown: Vec<_> = of_scene(paper, scene).filter(|traffic| traffic.conditions.octree == first).collect();
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
            octree(first)
        ),
    }
}

fn table1(paper: &Paper, scene: &PaperScene) -> Figure {
    let at = |values: [f64; 4]| -> Vec<(f64, f64)> {
        [1.0 / 4.0, 1.0 / 8.0, 1.0 / 16.0, 1.0 / 32.0].into_iter().zip(values).collect()
    };
    let name = scene.source().to_string();
    let mut series = Vec::new();
    for table in
        paper.table1.iter().filter(|table| table.conditions.scene == name && table.conditions.line_bytes == LINES[0])
    {
        let style = match table.ratio {
            Ratio::MissesPerRecordAccess => Style::Marked,
            Ratio::WordsMovedPerWordRead => Style::Dashed,
            Ratio::LineMissesPerLineAccess | Ratio::MissesPerWordRead => continue,
        };
        let name = format!("{}; {}", table.ratio.name(), octree(table.conditions.octree));
        series.push(Series { name, points: at(table.found), style });
    }
    series.push(Series { name: "published".to_owned(), points: at(scene.table), style: Style::Published });
    Figure {
        chart: Chart {
            title: format!("Table 1: shared / local memory accesses, {}", scene.source()),
            x: shares(),
            // The legend is above.
            y: Axis::from_zero("ratio", 1.4 * most(&series)),
            series,
        },
        caption: format!(
            "{} nodes, lines of {} bytes, LRU, fully associative; tiles row by row, interleaved. Two of the four \
             definitions of the ratio; the tables have all, and lines of {}.",
            published::TABLE_NODES,
            LINES[0],
            LINES[1]
        ),
    }
}

fn curves(paper: &Paper) -> Figure {
    let shown = paper
        .traffic
        .iter()
        .filter(|traffic| traffic.nodes == published::TABLE_NODES && traffic.conditions.line_bytes == LINES[1]);
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
            LINES[1]
        ),
    }
}
