//! The paper's own figures: both scenes traced as the paper traced them, under several settings where it leaves them
//! open, beside what it publishes.

mod charts;
mod figure1;
mod processors;
mod replaced;
mod rows;
mod table1;
mod text;

use serde::Serialize;

pub use charts::page;
pub use figure1::{Factor, Figure1};
pub use processors::Processors;
pub use replaced::Replaced;
pub use rows::csv;
pub use table1::Table1;
pub use text::text;

use crate::study::figures::conditions;
use crate::study::figures::contention::{Contention, SMALLEST};
use crate::study::figures::traffic::{Traffic, TrafficError};
use crate::study::published;
use crate::study::runs::traced::{Run, Traced, TracedError};
use machine::hardware::specification::{Bus, MemorySize, Processor};
use machine::replay::parallel;
use machine::tile_order::TileOrder;
use trace::picture::{ImageSettings, Sides, Tiling};
use trace::preparation::{self, PreparationError, Prepared, ViewChoices};
use trace::scene::SceneSource;
use trace::scene::procedural::{Board, Kind, Procedural};
use trace::tracer::octree::Octree;

/// How it is printed: raised with every change of meaning.
pub const FORMAT: &str = "marti study paper 1";

/// Line sizes that are tried, bytes.
pub const LINES: [u32; 2] = [16, 64];
/// Numbers of nodes that share a bus.
pub const NODES: [u16; 15] = [1, 2, 3, 4, 6, 8, 9, 12, 16, 24, 32, 37, 48, 56, 64];
/// Bus widths that are tried, bytes.
pub const WIDTHS: [u32; 4] = [4, 8, 16, 32];
/// Local memories of Figures 6 and 7.
pub const SIZES: [MemorySize; 7] = [
    published::share(32),
    published::share(16),
    published::share(8),
    published::share(4),
    published::share(2),
    published::share(1),
    MemorySize::All,
];

/// One of the paper's scenes, and the octrees that are tried on it: the first is the nearest to what the paper tells.
#[derive(Clone, Copy, Debug)]
pub struct PaperScene {
    pub scene: Procedural,
    /// The figure that shows its traffic.
    pub figure: &'static str,
    pub octrees: &'static [Octree],
    pub table: [f64; 4],
}

const fn leaves(leaf_size: u32, max_depth: u32) -> Octree {
    Octree { leaf_size, max_depth, mailbox: true }
}

pub const GEARS: PaperScene = PaperScene {
    scene: Procedural { kind: Kind::Gears, size: 2, board: Board::Squares },
    figure: "Figure 6",
    octrees: &[leaves(16, 8), leaves(8, 8), leaves(3, 12)],
    table: published::TABLE_GEARS,
};

pub const TEAPOT: PaperScene = PaperScene {
    scene: Procedural { kind: Kind::Teapot, size: 12, board: Board::Squares },
    figure: "Figure 7",
    octrees: &[leaves(12, 10), leaves(8, 10)],
    table: published::TABLE_TEAPOT,
};

/// All that is found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Paper {
    pub format: &'static str,
    pub tiling: Tiling,
    /// Reflections and refractions in a row.
    pub depth: u32,
    pub figure1: Vec<Figure1>,
    /// Figures 6 and 7: by octree, line and nodes; LRU.
    pub traffic: Vec<Traffic>,
    pub table1: Vec<Table1>,
    /// The sizes of Table 1 under other replacement policies, with each scene's first octree and lines of 64.
    pub replacements: Vec<Replaced>,
    pub processors: Vec<Processors>,
    /// With each scene's first octree, at 1/32.
    pub contention: Vec<Contention>,
    /// The same of [`published::PROCESSORS`] nodes on other buses.
    pub widths: Vec<Contention>,
}

#[derive(Debug, thiserror::Error)]
pub enum PaperError {
    #[error(transparent)]
    Preparation(#[from] PreparationError),
    #[error(transparent)]
    Traced(#[from] TracedError),
    #[error(transparent)]
    Traffic(#[from] TrafficError),
}

/// How many times `tell` is called.
pub const STEPS: u32 = 2 * (GEARS.octrees.len() + TEAPOT.octrees.len()) as u32 + 3;

impl Paper {
    /// Traces and replays; takes half a minute on two processors. `tell` gets what is begun.
    ///
    /// # Errors
    /// There is no room for temporary files; the paper's scenes, which this program makes itself, are in order.
    pub fn study(tell: impl Fn(&str)) -> Result<Self, PaperError> {
        let (side, tile) = (published::IMAGE_SIDE, published::TILE_SIDE);
        let tiling =
            Tiling::new(Sides { width: side, height: side, tile_width: tile, tile_height: tile }).expect("possible");
        let mut paper = Self::empty(tiling);
        tell("Figure 1: the teapot through octrees of fewer levels");
        paper.figure1 = figure1::figures(&TEAPOT, &paper)?;
        for scene in [&GEARS, &TEAPOT] {
            for (i, &octree) in scene.octrees.iter().enumerate() {
                paper.octree(scene, octree, i == 0, &tell)?;
            }
        }
        Ok(paper)
    }

    fn empty(tiling: Tiling) -> Self {
        Self {
            format: FORMAT,
            tiling,
            depth: ImageSettings::DEPTH_DEFAULT,
            figure1: Vec::new(),
            traffic: Vec::new(),
            table1: Vec::new(),
            replacements: Vec::new(),
            processors: Vec::new(),
            contention: Vec::new(),
            widths: Vec::new(),
        }
    }

    /// Traces a scene with one octree, and replays it through all that is tried.
    fn octree(
        &mut self,
        scene: &PaperScene,
        octree: Octree,
        first: bool,
        tell: &impl Fn(&str),
    ) -> Result<(), PaperError> {
        let name = format!("{}, {}", scene.source(), conditions::octree(octree));
        tell(&format!("{name}: tracing"));
        let prepared = self.prepare(scene, octree)?;
        let run = Run {
            scene: scene.source().to_string(),
            octree,
            tiling: self.tiling,
            seed: 0,
            processor: Processor::DEFAULT,
            bus: Bus::DEFAULT,
        };
        let traced = Traced::new(run, &prepared)?;
        tell(&format!("{name}: replaying"));
        let clusters: Vec<_> = LINES.iter().flat_map(|&line| published::NODES.map(|nodes| (line, nodes))).collect();
        let found =
            parallel::map(&clusters, |&(line, nodes)| Traffic::new(&traced, line, TileOrder::Scanline, nodes, &SIZES));
        let found = found.into_iter().collect::<Result<Vec<_>, _>>()?;
        for traffic in found.iter().filter(|traffic| traffic.nodes == published::TABLE_NODES) {
            self.table1.extend(Table1::of(traffic, scene.table));
            self.processors.extend(Processors::of(traffic));
        }
        self.traffic.extend(found);
        if first {
            tell(&format!("{name}: sharing a bus"));
            self.replacements.push(Replaced::new(&traced)?);
            let processors = [published::PROCESSORS as u16];
            for line in LINES {
                let with = |width, nodes: &[u16]| {
                    Contention::new(&traced, SMALLEST, line, width, nodes).map_err(TrafficError::from)
                };
                self.contention.push(with(Bus::DEFAULT.width, &NODES)?);
                for width in WIDTHS {
                    self.widths.push(with(width, &processors)?);
                }
            }
        }
        Ok(())
    }

    fn prepare(&self, scene: &PaperScene, octree: Octree) -> Result<Prepared, PreparationError> {
        let Sides { width, height, .. } = self.tiling.sides();
        preparation::prepare(&scene.source(), octree, &ViewChoices::default(), |_| {
            ImageSettings::new(width, height, self.depth, 0.0).map_err(|error| error.to_string())
        })
    }
}

impl PaperScene {
    pub fn source(&self) -> SceneSource {
        SceneSource::Procedural(self.scene)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::runs::fixture;

    const OCTREE: Octree = leaves(8, 6);

    /// The paper's study of a scene that is not the paper's.
    fn small() -> Paper {
        let scene = PaperScene {
            scene: Procedural { kind: Kind::Gears, size: 1, board: Board::Squares },
            figure: "Figure 0",
            octrees: &[OCTREE],
            table: published::TABLE_GEARS,
        };
        let mut paper = Paper::empty(fixture::TILING);
        paper.figure1 = figure1::figures(&scene, &paper).expect("a scene");
        paper.octree(&scene, OCTREE, true, &|_| ()).expect("a scene");
        paper
    }

    #[test]
    fn every_figure_is_in_the_csv_and_the_json() {
        let paper = small();
        let csv = csv(&paper);
        let rows: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
        assert!(rows.iter().all(|row| row.len() == 10), "{csv}");
        let count = |part: &str| rows.iter().filter(|row| row[0] == part).count();
        assert_eq!(count("table 1"), LINES.len() * 4 * 4);
        assert_eq!(count("replacement"), 5 * 4);
        assert_eq!(count("traffic"), LINES.len() * published::NODES.len() * (SIZES.len() * 8 + 1));
        assert_eq!(rows.iter().filter(|row| row[0].starts_with("contention")).count() % 13, 0);
        assert!(rows[1..].iter().all(|row| row[8].parse::<f64>().is_ok()), "{csv}");

        let json = serde_json::to_value(&paper).expect("JSON");
        assert_eq!(json["table1"][0]["published"][3], 0.027);
        assert_eq!(json["traffic"][0]["sizes"][0]["local_memory"], "1/32");
        assert_eq!(json["contention"][0]["rows"].as_array().map(Vec::len), Some(NODES.len()));
        assert_eq!(json["widths"].as_array().map(Vec::len), Some(LINES.len() * WIDTHS.len()));
    }

    #[test]
    fn figure_1_is_the_tracers_and_fewer_levels_cost_more_tests() {
        let paper = small();
        let [figure] = &paper.figure1[..] else { panic!("one octree") };
        assert_eq!(figure.levels.iter().map(|level| level.accesses).sum::<u64>(), figure.effort.octree_accesses);
        assert_eq!(figure.effort.levels, 7);
        assert_eq!((figure.without_deepest.effort.levels, figure.only_top.effort.levels), (3, 4));
        assert!(figure.without_deepest.primitive_tests > figure.only_top.primitive_tests);
        assert!(figure.only_top.primitive_tests > 1.0);
    }

    #[test]
    fn table_1_is_the_traffic_of_nine_nodes() {
        let paper = small();
        let table =
            paper.table1.iter().find(|table| table.ratio == crate::study::figures::ratio::Ratio::WordsMovedPerWordRead);
        let (table, traffic) = (table.expect("a definition"), &paper.traffic[1]);
        assert_eq!((traffic.nodes, traffic.conditions.line_bytes), (9, table.conditions.line_bytes));
        for (size, found) in published::TABLE_SIZES.into_iter().zip(table.found) {
            let size = traffic.size(size).expect("replayed");
            assert_eq!(found, traffic.bus_shares(size)[0]);
        }
        let text = text(&paper);
        for part in ["FIGURE 1", "FIGURE 6", "FIGURE 7", "TABLE 1", "OTHER", "THE BUS", "THIRTY-SEVEN", "CONTENTION"] {
            assert!(text.contains(part), "{part}");
        }
        assert!(page(&paper).to_string().ends_with("</html>\n"));
    }
}
