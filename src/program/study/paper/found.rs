//! Table 1 under one setting, beside what is published.

use serde::Serialize;

use super::setting::{Setting, Unit};
use super::whole_objects::WholeObjects;
use crate::study::figures::traffic::TrafficError;
use crate::study::published::{self, TABLE_NODES, TABLE_SIZES};
use crate::study::runs::kept::Kept;
use crate::study::runs::traced::Traced;
use machine::hardware::local_memory::Geometry;
use machine::hardware::specification::{LocalMemory, MemorySize, Replacement};
use machine::replay::model::counts::{Counts, ratio};
use machine::replay::model::evaluation::{Evaluation, evaluate};
use machine::replay::plan::schedule::TileSchedule;
use machine::replay::plan::setting::{self, Assignment, Policy};
use machine::replay::stream::subject::Subject;
use machine::tile_order::TileOrder;

/// One scene's cells, from 1/4 to 1/32 of the database.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Cells {
    pub found: [f64; 4],
    pub published: [f64; 4],
    /// Of one node at 1/32.
    pub least_local_bytes: u64,
}

/// All eight cells under one setting, in nine nodes; fully associative LRU memories, tiles row by row.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Found {
    pub scenes: [String; 2],
    #[serde(flatten)]
    pub setting: Setting,
    pub cells: [Cells; 2],
    /// Root of the mean square of ln(found / published).
    pub rmse: f64,
    /// The largest of found / published and published / found.
    pub worst: f64,
}

impl Found {
    pub(super) fn new(setting: Setting, scenes: [String; 2], cells: [Cells; 2]) -> Self {
        let ratios = || cells.iter().flat_map(|cells| cells.found.into_iter().zip(cells.published));
        let squares: f64 = ratios().map(|(found, published)| libm::log(found / published)).map(|ln| ln * ln).sum();
        let worst = ratios().map(|(found, published)| (found / published).max(published / found)).fold(1.0, f64::max);
        Self { scenes, setting, cells, rmse: (squares / ratios().count() as f64).sqrt(), worst }
    }

    /// "Thirty-seven processors per cluster": 1/p of the gears at 1/32.
    pub fn processors(&self) -> f64 {
        1.0 / self.cells[0].found[3]
    }
}

/// A scene that was traced, and what was counted of it so far.
pub(super) struct Counted {
    traced: Traced<Kept>,
    /// By line and assignment.
    counts: Vec<((u32, Assignment), [Counts; 4])>,
}

impl Counted {
    pub(super) fn new(traced: Traced<Kept>) -> Self {
        Self { traced, counts: Vec::new() }
    }

    /// The scene's cells under a setting with whose octree and layout it was traced.
    pub(super) fn cells(&mut self, setting: &Setting, published: [f64; 4]) -> Result<Cells, TrafficError> {
        match setting.unit {
            Unit::Lines { bytes, ratio, .. } => {
                let counts = self.lines(bytes, setting.assignment)?;
                let least_local_bytes = geometry(&self.traced, bytes, published::share(32))?.local_bytes();
                Ok(Cells { found: counts.map(|counts| ratio.of(&counts)), published, least_local_bytes })
            }
            Unit::Whole { bytes, siblings } => {
                let objects = WholeObjects::new(&self.traced.layout, bytes, siblings);
                let capacity = |size| match size {
                    MemorySize::Share { numerator, denominator } => {
                        objects.bytes() * u64::from(numerator) / u64::from(denominator)
                    }
                    MemorySize::All | MemorySize::Bytes(_) => objects.bytes(),
                };
                let counted = objects.count(&self.traced, &nine(&self.traced), TABLE_SIZES.map(capacity))?;
                let found = counted.map(|accesses| ratio(accesses.misses, accesses.all));
                Ok(Cells { found, published, least_local_bytes: capacity(published::share(32)) })
            }
        }
    }

    fn lines(&mut self, bytes: u32, assignment: Assignment) -> Result<[Counts; 4], TrafficError> {
        let known = self.counts.iter().find(|(key, _)| *key == (bytes, assignment));
        if let Some((_, counts)) = known {
            return Ok(*counts);
        }
        let counts = match assignment {
            Assignment::OnDemand => on_demand(&self.traced, bytes)?,
            Assignment::Interleaved | Assignment::Recorded => interleaved(&self.traced, bytes)?,
        };
        self.counts.push(((bytes, assignment), counts));
        Ok(counts)
    }
}

fn nine(traced: &Traced<Kept>) -> TileSchedule {
    TileSchedule::interleaved(&traced.ordered(TileOrder::Scanline), u32::from(TABLE_NODES))
}

fn geometry(traced: &Traced<Kept>, line: u32, size: MemorySize) -> Result<Geometry, TrafficError> {
    let memory = LocalMemory { size, line, ways: None, replacement: Replacement::Lru };
    Ok(Geometry::new(&memory, &traced.layout)?)
}

fn interleaved(traced: &Traced<Kept>, line: u32) -> Result<[Counts; 4], TrafficError> {
    let curve = traced.curve(&nine(traced), line)?;
    let mut counts = [Counts::default(); 4];
    for (counts, size) in counts.iter_mut().zip(TABLE_SIZES) {
        let lines = u32::try_from(geometry(traced, line, size)?.lines()).unwrap_or(u32::MAX);
        *counts = Counts::new(&curve.at(lines), traced.reads.words_read(&traced.layout), line);
    }
    Ok(counts)
}

fn on_demand(traced: &Traced<Kept>, line: u32) -> Result<[Counts; 4], TrafficError> {
    let settings = TABLE_SIZES.map(|local_memory| setting::Setting {
        local_memory,
        line,
        ways: None,
        replacement: Policy::Lru,
        nodes: TABLE_NODES,
        clusters: 1,
        tile_order: TileOrder::Scanline,
        assignment: Assignment::OnDemand,
        bus: traced.run.bus,
        processor: traced.run.processor,
    });
    let rows = evaluate(traced, &settings, &Evaluation::default(), |_| {})?;
    let mut counts = [Counts::default(); 4];
    counts.iter_mut().zip(rows).for_each(|(counts, row)| *counts = row.counts);
    Ok(counts)
}

#[cfg(test)]
mod tests {
    use super::*;
    use trace::scene::procedural::Board;
    use trace::tracer::octree::Octree;

    #[test]
    fn errors_are_those_worked_by_hand() {
        let unit = Unit::Whole { bytes: 300, siblings: 8 };
        let octree = Octree { leaf_size: 1, max_depth: 6, mailbox: true };
        let setting = Setting { board: Board::None, octree, unit, assignment: Assignment::Interleaved };
        let cells = |found| Cells { found, published: [1.0, 2.0, 4.0, 8.0], least_local_bytes: 0 };
        let scenes = ["a", "b"].map(str::to_owned);
        // Twice and half in two of eight cells: ln 2 · sqrt(2 / 8).
        let found = Found::new(setting, scenes, [cells([2.0, 2.0, 4.0, 8.0]), cells([1.0, 2.0, 4.0, 4.0])]);
        assert_eq!((found.worst, found.processors()), (2.0, 0.125));
        assert!((found.rmse - std::f64::consts::LN_2 / 2.0).abs() < 1e-12, "{}", found.rmse);
    }
}
