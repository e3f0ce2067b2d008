//! A scene of one's own, put through every combination of memories, nodes and buses.

use serde::Serialize;

use crate::study::figures::conditions::octree;
use crate::study::figures::levels::{self, Level};
use crate::study::figures::traffic::{Traffic, TrafficError};
use crate::study::page::charts::{self, most};
use crate::study::page::plot::{Axis, Chart, Style};
use crate::study::page::{Figure, Page, Section};
use crate::study::runs::traced::{Run, Traced, TracedError};
use crate::study::varied::Varied;
use cluster::topology::Topology;
use machine::hardware::stats::octree_class;
use machine::replay::model::evaluation::{Evaluation, Row, evaluate};
use machine::replay::plan::grid::Grid;
use machine::replay::plan::setting::{Assignment, Setting};
use machine::replay::{Trace, TraceError, parallel};
use machine::tile_order;
use trace::database::RecordLayout;
use trace::database::records::LEVELS;
use trace::picture::{Sides, Tiling};
use trace::preparation::PreparationError;
use trace::scene::Warning;
use trace::tracer::RayKind;
use trace::tracer::octree::Octree;
use trace::tracer::octree::census::Census;

/// How it is printed: raised with every change of meaning.
pub const FORMAT: &str = "marti study sweep 1";

/// All that is found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sweep {
    pub format: &'static str,
    pub topology: String,
    pub scene: String,
    #[serde(flatten)]
    pub octree: Octree,
    /// How records are laid out, where they are not of triangles without padding.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub record_layout: Option<String>,
    pub database_bytes: u64,
    pub tiling: Tiling,
    /// By [`RayKind`].
    pub rays: [u64; RayKind::COUNT],
    pub levels: Vec<Level>,
    /// A row a combination.
    pub rows: Vec<Row>,
    /// LRU memories of all sizes, fully associative, interleaved; by line and nodes.
    pub traffic: Vec<Traffic>,
}

#[derive(Debug, thiserror::Error)]
pub enum SweepError {
    #[error(transparent)]
    Preparation(#[from] PreparationError),
    #[error(transparent)]
    Traced(#[from] TracedError),
    #[error(transparent)]
    Traffic(#[from] TrafficError),
    #[error(transparent)]
    Trace(#[from] TraceError),
    /// The combinations cannot be.
    #[error("{0}")]
    Grid(String),
}

/// How many times `tell` is called.
pub const STEPS: u32 = 3;

impl Sweep {
    /// Traces the topology's scene once, and replays it through every combination; what `grid` does not say is as in
    /// the topology. `warn` gets the warnings about the scene, of which there may be none. With `timings` nodes share their buses, in cycles of the topology's costs.
    ///
    /// # Errors
    /// The scene cannot be read or is too large, there is no room for its references, or a combination cannot be.
    pub fn study(
        topology: &Topology,
        grid: &Grid,
        timings: bool,
        tell: impl Fn(&str),
        warn: impl Fn(&[Warning]),
    ) -> Result<Self, SweepError> {
        let base =
            Setting { assignment: assignment(topology), ..Setting::recorded(&topology.cluster, topology.run.order) };
        let settings = grid.settings(base).map_err(SweepError::Grid)?;
        if settings.iter().any(|setting| setting.assignment == Assignment::Recorded) {
            return Err(SweepError::Grid("nothing is recorded: expected interleaved or on-demand".to_owned()));
        }
        tell(&format!("{}: tracing", topology.scene));
        let prepared = topology.prepare()?;
        warn(&prepared.warnings);
        let image = prepared.view.image;
        let tiling = topology.image.tiling(image.width(), image.height()).map_err(SweepError::Grid)?;
        let run = Run {
            scene: topology.scene.to_string(),
            octree: topology.octree,
            tiling,
            seed: topology.run.seed,
            processor: topology.cluster.processor,
            bus: topology.cluster.bus,
        };
        let traced = Traced::new(run, &prepared)?;
        tell(&format!("{} settings", settings.len()));
        let evaluation = Evaluation { timings, ..Evaluation::default() };
        let rows = evaluate(&traced, &settings, &evaluation, |_| {})?;
        tell("memories of all sizes");
        let census = Census::of(&prepared.database);
        let mut accesses = [0; LEVELS];
        for (level, accesses) in (0..).zip(&mut accesses) {
            *accesses = traced.reads.counters.iter().map(|kind| kind[octree_class(level)].record_accesses).sum();
        }
        Ok(Self {
            format: FORMAT,
            topology: topology.name.clone(),
            scene: traced.run.scene.clone(),
            octree: traced.run.octree,
            record_layout: Some(topology.records).filter(|&r| r != RecordLayout::DEFAULT).map(|r| r.to_string()),
            database_bytes: traced.layout.database_bytes(),
            tiling,
            rays: traced.rays,
            levels: levels::levels(&census, &accesses),
            traffic: curves(&traced, &settings)?,
            rows,
        })
    }

    /// Scene, octree and image.
    pub fn heading(&self) -> String {
        let Sides { width, height, tile_width, tile_height } = self.tiling.sides();
        format!(
            "{}, {}{}, database of {} bytes; {width}x{height} pixels in tiles of {tile_width}x{tile_height}, {} rays",
            self.scene,
            octree(self.octree),
            self.record_layout.as_ref().map(|layout| format!(", {layout}")).unwrap_or_default(),
            self.database_bytes,
            self.rays.iter().sum::<u64>()
        )
    }
}

fn assignment(topology: &Topology) -> Assignment {
    match topology.run.assignment {
        tile_order::Assignment::OnDemand => Assignment::OnDemand,
        tile_order::Assignment::Interleaved => Assignment::Interleaved,
    }
}

/// Of each line, order and number of nodes among the settings.
fn curves<T: Trace>(traced: &Traced<T>, settings: &[Setting]) -> Result<Vec<Traffic>, TrafficError> {
    let mut clusters = Vec::new();
    let mut sizes = Vec::new();
    for setting in settings {
        let cluster = (setting.line, setting.tile_order, setting.nodes);
        if !clusters.contains(&cluster) {
            clusters.push(cluster);
        }
        if !sizes.contains(&setting.local_memory) {
            sizes.push(setting.local_memory);
        }
    }
    let traffic = |&(line, order, nodes): &_| Traffic::new(traced, line, order, nodes, &sizes);
    parallel::map(&clusters, traffic).into_iter().collect()
}

/// Charts of what was varied, then the table.
pub fn page(sweep: &Sweep) -> Page {
    let varied = Varied::new(&sweep.rows, sweep.database_bytes);
    let mut figures = varied.figures();
    figures.push(by_level(sweep));
    let approximate = if sweep.rows.iter().all(|row| row.exact) {
        ""
    } else {
        " Approximate rows say why a live run need not count the same."
    };
    let table = Section {
        heading: "Every combination".to_owned(),
        introduction: format!(
            "{}. A click on the head of a column sorts by it. Ratios are to row 1.{approximate}",
            varied.constant()
        ),
        grid: varied.grid(),
    };
    Page {
        title: format!("Sweep of {}", sweep.topology),
        introduction: sweep.heading(),
        figures,
        last: vec![table],
        ..Page::default()
    }
}

fn by_level(sweep: &Sweep) -> Figure {
    let series = charts::levels(&sweep.levels, "", Style::Marked).to_vec();
    let (x, y) = (charts::level_axis(&series), Axis::from_zero("per cent", most(&series)));
    let chart = Chart { title: "Nodes and accesses by octree level".to_owned(), x, y, series };
    Figure {
        chart,
        caption: format!("{}, {}; all rays. It does not depend on what was varied.", sweep.scene, octree(sweep.octree)),
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::study::published::share;
    use cluster::topology::Override;

    fn topology(overrides: &[&str]) -> Topology {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../topologies/teapot.toml");
        let overrides: Vec<Override> = overrides.iter().map(|text| text.parse().expect("an override")).collect();
        Topology::read(&path, &overrides).unwrap_or_else(|error| panic!("{error}"))
    }

    const SMALL: [&str; 4] = ["scene.size=2", "image.width=32", "image.height=32", "image.tile=4"];

    #[test]
    fn every_combination_is_a_row_and_lies_on_its_curve() {
        let topology = topology(&[&SMALL[..], &["run.assignment=interleaved"]].concat());
        let grid =
            Grid { local_memory: vec![share(8), share(2)], line: vec![16, 64], nodes: vec![1, 3], ..Grid::default() };
        let sweep = Sweep::study(&topology, &grid, true, |_| (), |_| ()).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!((sweep.rows.len(), sweep.traffic.len()), (8, 4));
        for row in &sweep.rows {
            let of = |t: &&Traffic| (t.conditions.line_bytes, t.nodes) == (row.setting.line, row.setting.nodes);
            let traffic = sweep.traffic.iter().find(of).expect("a curve");
            let size = traffic.size(row.setting.local_memory).expect("a size");
            assert_eq!((row.counts.misses, row.counts.words_moved, row.counts.words_read), {
                (size.counts.misses, size.counts.words_moved, size.counts.words_read)
            });
            assert!(row.exact && row.efficiency.is_some());
        }
        assert_eq!(sweep.rays[RayKind::Primary as usize], 32 * 32);
        let page = page(&sweep);
        let charts: Vec<_> = page.figures.iter().map(|figure| figure.chart.title.as_str()).collect();
        let by = "by local memory of one node";
        let expected = [
            format!("Misses {by}"),
            format!("Cycles {by}"),
            format!("Speed-up over the first row {by}"),
            "Nodes and accesses by octree level".to_owned(),
        ];
        assert_eq!(charts, expected);
        let misses = &page.figures[0].chart;
        let mut names: Vec<_> = misses.series.iter().map(|series| series.name.as_str()).collect();
        let named = |nodes, line| format!("nodes per cluster {nodes}, line {line} bytes");
        names.sort_unstable();
        assert_eq!(names, [named(1, 16), named(1, 64), named(3, 16), named(3, 64)]);
        for (nodes, line) in [(1, 16), (1, 64), (3, 16), (3, 64)] {
            let series = misses.series.iter().find(|series| series.name == named(nodes, line)).expect("a series");
            let of = |row: &&Row| (row.setting.nodes, row.setting.line) == (nodes, line);
            let values: Vec<f64> =
                sweep.rows.iter().filter(of).map(|row| 100.0 * row.misses_per_record_access).collect();
            let shown: Vec<f64> = series.points.iter().map(|point| point.1).collect();
            assert_eq!(shown, values, "those of the table, from 1/8 to 1/2");
        }
        let grid = &page.last[0].grid;
        assert_eq!((grid.rows.len(), grid.columns.len()), (8, 15));
        assert!(grid.rows.iter().all(|row| row.len() == grid.columns.len()));
    }

    #[test]
    fn nothing_is_recorded() {
        let grid = Grid { assignment: vec![Assignment::Recorded], ..Grid::default() };
        let error = Sweep::study(&topology(&SMALL), &grid, false, |_| (), |_| ()).expect_err("nothing is recorded");
        assert_eq!(error.to_string(), "nothing is recorded: expected interleaved or on-demand");
    }
}
