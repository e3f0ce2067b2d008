//! The paper's own figures: both scenes traced as the paper traced them, under several settings where it leaves them
//! open, beside what it publishes.

mod charts;
mod claims;
mod figure1;
mod found;
mod replaced;
mod rows;
pub mod search;
mod setting;
mod text;
mod verdicts;
mod whole_objects;

use serde::Serialize;

pub use charts::page;
pub use claims::{Balance, Claims};
pub use figure1::{Factor, Figure1};
pub use found::{Cells, Found};
pub use replaced::Replaced;
pub use rows::csv;
pub use search::Search;
pub use setting::{Setting, Unit};
pub use text::{search as search_text, text};

use crate::study::figures::contention::{Contention, SMALLEST};
use crate::study::figures::ratio::Ratio;
use crate::study::figures::traffic::{Traffic, TrafficError};
use crate::study::published;
use crate::study::runs::kept::Kept;
use crate::study::runs::traced::{Run, Traced, TracedError};
use machine::hardware::specification::{Bus, MemorySize, Processor};
use machine::replay::parallel;
use machine::replay::plan::setting::Assignment;
use machine::tile_order::TileOrder;
use trace::database::{Objects, RecordLayout};
use trace::picture::{ImageSettings, Sides, Tiling};
use trace::preparation::{self, BuildChoices, PreparationError, Prepared, ViewChoices};
use trace::scene::SceneSource;
use trace::scene::procedural::{Board, Kind, Procedural};
use trace::tracer::octree::Octree;

/// How it is printed: raised with every change of meaning.
pub const FORMAT: &str = "marti study paper 2";

/// Bytes of a line in Figures 6 and 7 and where a bus is shared.
pub const LINE: u32 = 16;
/// Numbers of nodes that share a bus.
pub const NODES: [u16; 12] = [1, 2, 4, 6, 9, 12, 16, 24, 32, 37, 48, 64];
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

/// One of the paper's scenes.
#[derive(Clone, Copy, Debug)]
pub struct PaperScene {
    pub scene: Procedural,
    /// The figure that shows its traffic.
    pub figure: &'static str,
    pub table: [f64; 4],
}

const fn leaves(leaf_size: u32, max_depth: u32) -> Octree {
    Octree { leaf_size, max_depth, mailbox: true }
}

pub const GEARS: PaperScene = PaperScene {
    scene: Procedural { kind: Kind::Gears, size: 2, board: Board::Squares },
    figure: "Figure 6",
    table: published::TABLE_GEARS,
};

/// The paper counts 9120 triangles: those without the board.
pub const TEAPOT: PaperScene = PaperScene {
    scene: Procedural { kind: Kind::Teapot, size: 12, board: Board::None },
    figure: "Figure 7",
    table: published::TABLE_TEAPOT,
};

/// One octree for both scenes, wherever none is named: the one of the best setting in lines ([`search`]).
pub const OCTREE: Octree = leaves(12, 12);

/// The settings of Table 1 that are shown: the best of their kind, and those beside which they are to be seen.
pub const SETTINGS: [Setting; 8] = {
    const fn lines(board: Board, octree: Octree, objects: Objects, ratio: Ratio, assignment: Assignment) -> Setting {
        Setting { board, octree, unit: Unit::Lines { objects, bytes: LINE, ratio }, assignment }
    }
    const fn whole(board: Board, octree: Octree, bytes: u32) -> Setting {
        let unit = Unit::Whole { bytes, siblings: 8 };
        Setting { board, octree, unit, assignment: Assignment::Interleaved }
    }
    use Assignment::{Interleaved, OnDemand};
    use Board::{None, Squares};
    use Objects::{Polygons, Triangles};
    [
        lines(None, OCTREE, Triangles, Ratio::LineMissesPerLineAccess, OnDemand),
        lines(None, OCTREE, Triangles, Ratio::LineMissesPerLineAccess, Interleaved),
        lines(None, OCTREE, Triangles, Ratio::MissesPerRecordAccess, Interleaved),
        lines(None, OCTREE, Triangles, Ratio::WordsMovedPerWordRead, Interleaved),
        lines(Squares, leaves(2, 6), Triangles, Ratio::LineMissesPerLineAccess, Interleaved),
        lines(Squares, OCTREE, Triangles, Ratio::LineMissesPerLineAccess, OnDemand),
        lines(None, leaves(1, 6), Polygons, Ratio::LineMissesPerLineAccess, Interleaved),
        whole(None, leaves(1, 6), 300),
    ]
};

/// Octrees of Figure 1, beside [`OCTREE`].
const FIGURE1: [Octree; 3] = [OCTREE, leaves(12, 10), leaves(1, 6)];

/// All that is found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Paper {
    pub format: &'static str,
    pub tiling: Tiling,
    /// Reflections and refractions in a row.
    pub depth: u32,
    /// Table 1.
    pub settings: Vec<Found>,
    /// How many settings the search tried that found the best of these.
    pub settings_searched: usize,
    pub figure1: Vec<Figure1>,
    /// Figures 6 and 7, by nodes; LRU.
    pub traffic: Vec<Traffic>,
    /// The sizes of Table 1 under other replacement policies.
    pub replacements: Vec<Replaced>,
    pub claims: Vec<Claims>,
    /// At 1/32.
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

/// How many times `tell` is called, at most.
pub const STEPS: u32 = 20;

/// 2500 tiles.
fn tiling() -> Tiling {
    let (side, tile) = (published::IMAGE_SIDE, published::TILE_SIDE);
    Tiling::new(Sides { width: side, height: side, tile_width: tile, tile_height: tile }).expect("possible")
}

impl Paper {
    /// Traces and replays; takes a minute on two processors. `tell` gets what is begun.
    ///
    /// # Errors
    /// There is no room for temporary files; the paper's scenes, which this program makes itself, are in order.
    pub fn study(tell: impl Fn(&str)) -> Result<Self, PaperError> {
        let mut paper = Self::empty(tiling());
        paper.settings = paper.measure(&SETTINGS, &tell)?;
        tell("Figure 1: octrees of fewer levels");
        let figures = [Board::None, Board::Squares].map(|board| FIGURE1.map(|octree| (TEAPOT.on(board), octree)));
        paper.figure1 = figure1::figures(figures.as_flattened(), &paper)?;
        for scene in [GEARS, TEAPOT] {
            paper.figures(&scene, OCTREE, &tell)?;
        }
        Ok(paper)
    }

    fn empty(tiling: Tiling) -> Self {
        Self {
            format: FORMAT,
            tiling,
            depth: ImageSettings::DEPTH_DEFAULT,
            settings: Vec::new(),
            settings_searched: search::count(),
            figure1: Vec::new(),
            traffic: Vec::new(),
            replacements: Vec::new(),
            claims: Vec::new(),
            contention: Vec::new(),
            widths: Vec::new(),
        }
    }

    /// Traces a scene, and replays it through all else that is tried.
    fn figures(&mut self, scene: &PaperScene, octree: Octree, tell: &impl Fn(&str)) -> Result<(), PaperError> {
        let source = scene.source();
        tell(&format!("{}: {source}", scene.figure));
        let (prepared, traced) = self.trace(&source, octree, RecordLayout::DEFAULT)?;
        let found =
            parallel::map(&published::NODES, |&nodes| Traffic::new(&traced, LINE, TileOrder::Scanline, nodes, &SIZES));
        self.traffic.extend(found.into_iter().collect::<Result<Vec<_>, _>>()?);
        tell(&format!("{source}: other replacement"));
        self.replacements.push(Replaced::new(&traced, LINE)?);
        tell(&format!("{source}: sharing a bus"));
        self.claims.push(Claims::new(&traced, &prepared.database)?);
        let with =
            |width, nodes: &[u16]| Contention::new(&traced, SMALLEST, LINE, width, nodes).map_err(TrafficError::from);
        self.contention.push(with(Bus::DEFAULT.width, &NODES)?);
        for width in WIDTHS {
            self.widths.push(with(width, &[published::PROCESSORS as u16])?);
        }
        Ok(())
    }

    fn trace(
        &self,
        source: &SceneSource,
        octree: Octree,
        records: RecordLayout,
    ) -> Result<(Prepared, Traced<Kept>), PaperError> {
        let prepared = self.prepare(source, BuildChoices { octree, records })?;
        let run = Run {
            scene: source.to_string(),
            octree,
            tiling: self.tiling,
            seed: 0,
            processor: Processor::DEFAULT,
            bus: Bus::DEFAULT,
        };
        let traced = Traced::new(run, &prepared)?;
        Ok((prepared, traced))
    }

    fn prepare(&self, source: &SceneSource, database: impl Into<BuildChoices>) -> Result<Prepared, PreparationError> {
        let Sides { width, height, .. } = self.tiling.sides();
        preparation::prepare(source, database, &ViewChoices::default(), |_| {
            ImageSettings::new(width, height, self.depth, 0.0).map_err(|error| error.to_string())
        })
    }
}

impl PaperScene {
    pub fn source(&self) -> SceneSource {
        SceneSource::Procedural(self.scene)
    }

    /// The same on this board, if it has any.
    pub fn on(&self, board: Board) -> SceneSource {
        SceneSource::Procedural(self.scene.on(board).unwrap_or(self.scene))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::page::Provenance;
    use crate::study::runs::fixture;

    const OCTREE: Octree = leaves(8, 6);

    /// The paper's study of a scene that is not the paper's.
    fn small() -> Paper {
        let scene = PaperScene {
            scene: Procedural { kind: Kind::Gears, size: 1, board: Board::Squares },
            figure: "Figure 0",
            table: published::TABLE_GEARS,
        };
        let mut paper = Paper::empty(fixture::TILING);
        paper.figure1 = figure1::figures(&[(scene.source(), OCTREE)], &paper).expect("a scene");
        paper.figures(&scene, OCTREE, &|_| ()).expect("a scene");
        paper
    }

    #[test]
    fn every_figure_is_in_the_csv_and_the_json() {
        let mut paper = small();
        let cells = Cells { found: [0.004; 4], published: published::TABLE_GEARS, least_local_bytes: 1 };
        paper.settings.push(Found::new(SETTINGS[0], ["a", "b"].map(str::to_owned), [cells; 2]));
        let csv = csv(&paper);
        let rows: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
        assert!(rows.iter().all(|row| row.len() == 10), "{csv}");
        let count = |part: &str| rows.iter().filter(|row| row[0].starts_with(part)).count();
        assert_eq!(count("table 1"), 8 + 2);
        assert_eq!(count("replacement") % 4, 0);
        assert_eq!(count("traffic"), published::NODES.len() * (SIZES.len() * 8 + 1));
        assert_eq!(count("contention") % 13, 0);
        assert_eq!(count("claims"), 3 * 6 + 2);
        assert!(rows[1..].iter().all(|row| row[8].parse::<f64>().is_ok()), "{csv}");

        let json = serde_json::to_value(&paper).expect("JSON");
        assert_eq!(json["settings"][0]["cells"][0]["published"][3], 0.027);
        assert_eq!(json["settings"][0]["definition"], "line misses / line accesses");
        assert_eq!(json["traffic"][0]["sizes"][0]["local_memory"], "1/32");
        assert_eq!(json["contention"][0]["rows"].as_array().map(Vec::len), Some(NODES.len()));
        assert_eq!(json["widths"].as_array().map(Vec::len), Some(WIDTHS.len()));
        let text = text(&paper);
        for part in ["AGREES", "TABLE 1", "FIGURE 1", "OTHER", "CLAIMS", "CONTENTION"] {
            assert!(text.contains(part), "{part}");
        }
        assert!(page(&paper).html(&Provenance::default()).ends_with("</html>\n"));
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
    fn claims_agree_with_what_else_is_found() {
        let paper = small();
        let [claims] = &paper.claims[..] else { panic!("one scene") };
        let nine = claims.by_nodes.iter().find(|balance| balance.nodes == 9).expect("nine nodes");
        let row = paper.contention[0].table.rows.iter().find(|row| row.setting.nodes == 9).expect("nine nodes");
        assert!((nine.jobs + nine.pixels + nine.fetches - row.bus_utilisation).abs() < 1e-12, "{nine:?}");
        assert!(nine.busy < row.efficiency && nine.busiest_over_mean >= 1.0, "{nine:?}");
        let builds: Vec<f64> = claims.by_nodes.iter().map(|balance| balance.build).collect();
        assert!(builds.is_sorted() && builds[0] > 0.0, "more nodes make the build a larger share: {builds:?}");
        // Every descent is a read; what goes up came down.
        assert!(claims.ascents_per_ray < claims.nodes_read_per_ray && claims.ascents_per_ray > 0.0, "{claims:?}");
    }
}
