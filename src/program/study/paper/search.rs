//! How the settings of the study were found: all of a grid, each for both scenes.

use serde::Serialize;

use super::found::{Counted, Found};
use super::setting::{Setting, Unit};
use super::{GEARS, Paper, PaperError, TEAPOT, leaves, tiling};
use crate::study::figures::ratio::Ratio;
use machine::replay::plan::setting::Assignment;
use trace::database::Objects;
use trace::scene::procedural::Board;
use trace::tracer::octree::Octree;

const LEAVES: [u32; 8] = [1, 2, 3, 4, 6, 8, 12, 16];
const DEPTHS: [u32; 4] = [6, 8, 10, 12];
const LINES: [u32; 4] = [16, 32, 64, 128];
/// Lines for which tiles are also handed out on demand, which takes a simulation per size.
const LINES_ON_DEMAND: [u32; 1] = [16];
const OBJECT_BYTES: [u32; 3] = [200, 300, 400];
const SIBLINGS: [u32; 2] = [1, 8];
const BOARDS: [Board; 2] = [Board::Squares, Board::None];

/// All settings of one octree and one board.
fn settings(octree: Octree, board: Board) -> Vec<Setting> {
    let mut all = Vec::new();
    for objects in [Objects::Triangles, Objects::Polygons] {
        for ratio in Ratio::ALL {
            let lines =
                |bytes, assignment| Setting { board, octree, unit: Unit::Lines { objects, bytes, ratio }, assignment };
            all.extend(LINES.map(|bytes| lines(bytes, Assignment::Interleaved)));
            all.extend(LINES_ON_DEMAND.map(|bytes| lines(bytes, Assignment::OnDemand)));
        }
    }
    for bytes in OBJECT_BYTES {
        let unit = |siblings| Unit::Whole { bytes, siblings };
        let setting = |siblings| Setting { board, octree, unit: unit(siblings), assignment: Assignment::Interleaved };
        all.extend(SIBLINGS.map(setting));
    }
    all
}

/// How many settings the search tries.
pub fn count() -> usize {
    LEAVES.len() * DEPTHS.len() * BOARDS.len() * settings(leaves(1, 6), Board::None).len()
}

/// How many times `tell` is called.
pub const STEPS: u32 = (LEAVES.len() * DEPTHS.len()) as u32;

/// How many of the best are kept, of each board and each kind of unit.
const BEST: usize = 5;

/// What a search found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Search {
    pub format: &'static str,
    /// Settings that were tried.
    pub tried: usize,
    /// The best by board and kind of record, by their root mean square error.
    pub settings: Vec<Found>,
}

impl Search {
    /// Takes some half an hour on two processors.
    ///
    /// # Errors
    /// As those of [`Paper::study`].
    pub fn new(tell: impl Fn(&str)) -> Result<Self, PaperError> {
        let paper = Paper::empty(tiling());
        let mut all: Vec<Found> = Vec::new();
        for octree in LEAVES.iter().flat_map(|&size| DEPTHS.map(|depth| leaves(size, depth))) {
            tell(&crate::study::figures::conditions::octree(octree));
            let boards = BOARDS.map(|board| settings(octree, board));
            all.extend(paper.measure(&boards.concat(), &|_| ())?);
        }
        let tried = all.len();
        all.sort_by(|a, b| a.rmse.total_cmp(&b.rmse));
        let kind = |found: &Found| (found.setting.board, std::mem::discriminant(&found.setting.unit));
        let mut settings: Vec<Found> = Vec::new();
        for found in all {
            if settings.iter().filter(|other| kind(other) == kind(&found)).count() < BEST {
                settings.push(found);
            }
        }
        Ok(Self { format: "marti study paper search 1", tried, settings })
    }
}

impl Paper {
    /// Both scenes' cells under each of these settings; each scene is traced once per octree and layout.
    pub(super) fn measure(&self, settings: &[Setting], tell: &impl Fn(&str)) -> Result<Vec<Found>, PaperError> {
        let mut of_scenes = Vec::new();
        for scene in [GEARS, TEAPOT] {
            let mut found = vec![None; settings.len()];
            for (i, setting) in settings.iter().enumerate() {
                if found[i].is_some() {
                    continue;
                }
                let source = scene.on(setting.board);
                let key = |setting: &Setting| (scene.on(setting.board), setting.octree, setting.layout());
                tell(&format!("Table 1: {}, {}", source, crate::study::figures::conditions::octree(setting.octree)));
                let mut counted = Counted::new(self.trace(&source, setting.octree, setting.layout())?.1);
                for (other, found) in settings.iter().zip(&mut found) {
                    if key(other) == key(setting) {
                        *found = Some((source.to_string(), counted.cells(other, scene.table)?));
                    }
                }
            }
            of_scenes.push(found);
        }
        let [gears, teapot] = &of_scenes[..] else { return Ok(Vec::new()) };
        let both = settings.iter().zip(gears.iter().zip(teapot));
        let found = both.filter_map(|(setting, (gears, teapot))| {
            let ((a, gears), (b, teapot)) = (gears.clone()?, teapot.clone()?);
            Some(Found::new(*setting, [a, b], [gears, teapot]))
        });
        Ok(found.collect())
    }
}
