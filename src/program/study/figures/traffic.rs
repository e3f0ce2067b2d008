//! What crosses the bus of a cluster, by the size of its local memories: Figures 6 and 7, and Table 1.

use serde::{Serialize, Serializer};

use crate::study::figures::conditions::Conditions;
use crate::study::figures::ratio::Ratio;
use crate::study::runs::traced::Traced;
use machine::hardware::local_memory::{Geometry, GeometryError, LINES_MIN};
use machine::hardware::specification::{LocalMemory, MemorySize, Replacement};
use machine::hardware::transaction::{END_OF_JOB_BYTES, JOB_BYTES, PIXEL_BYTES};
use machine::replay::model::counts::{Counts, ratio};
use machine::replay::model::curve::LruCurve;
use machine::replay::model::replayer::Counters;
use machine::replay::plan::schedule::TileSchedule;
use machine::replay::stream::subject::Subject;
use machine::replay::{Trace, TraceError};
use machine::tile_order::TileOrder;
use trace::picture::Tiling;

/// One cluster, with local memories of several sizes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Traffic {
    #[serde(flatten)]
    pub conditions: Conditions,
    pub nodes: u16,
    pub messages: Messages,
    /// What a processor without a local memory reads from the memory for the same tiles.
    pub unique_processor_bytes: u64,
    pub sizes: Vec<Size>,
    /// Of all sizes.
    pub curve: Vec<CurvePoint>,
}

/// A point of the curve of all sizes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CurvePoint {
    /// Of one node.
    pub local_bytes: u64,
    pub misses: u64,
    pub bus_bytes: u64,
}

/// What crosses the bus besides data of the scene. It does not depend on the local memories.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Messages {
    pub job_bytes: u64,
    pub end_of_job_bytes: u64,
    pub pixel_bytes: u64,
}

/// Local memories of one size.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Size {
    #[serde(serialize_with = "as_text")]
    pub local_memory: MemorySize,
    /// Of one node, resolved.
    pub local_bytes: u64,
    #[serde(flatten)]
    pub counts: Counts,
    /// Data of the scene.
    pub bus_bytes: u64,
}

/// Why a memory's traffic is not known.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum TrafficError {
    #[error(transparent)]
    Trace(#[from] TraceError),
    #[error(transparent)]
    Geometry(#[from] GeometryError),
}

/// As it is typed.
pub(super) fn as_text<S: Serializer>(size: &MemorySize, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(size)
}

impl Messages {
    /// Every tile handed out and reported once, every pixel written once.
    pub fn new(tiling: Tiling) -> Self {
        let tiles = u64::from(tiling.tile_count());
        let pixels = u64::from(tiling.sides().width) * u64::from(tiling.sides().height);
        Self {
            job_bytes: tiles * u64::from(JOB_BYTES),
            end_of_job_bytes: tiles * u64::from(END_OF_JOB_BYTES),
            pixel_bytes: pixels * u64::from(PIXEL_BYTES),
        }
    }

    pub fn bytes(&self) -> u64 {
        self.job_bytes + self.end_of_job_bytes + self.pixel_bytes
    }
}

impl Traffic {
    /// Fully associative LRU memories; the i-th tile in order goes to node i mod `nodes`. A memory that is all of the
    /// database is filled once, whether or not all is read; nothing misses then.
    ///
    /// # Errors
    /// The trace cannot be read, or a memory is too small.
    pub fn new<T: Trace>(
        traced: &Traced<T>,
        line_bytes: u32,
        order: TileOrder,
        nodes: u16,
        sizes: &[MemorySize],
    ) -> Result<Self, TrafficError> {
        let schedule = TileSchedule::interleaved(&traced.ordered(order), u32::from(nodes));
        let curve = traced.curve(&schedule, line_bytes)?;
        let size = |&size: &MemorySize| {
            let memory = LocalMemory { size, line: line_bytes, ways: None, replacement: Replacement::Lru };
            let geometry = Geometry::new(&memory, &traced.layout)?;
            Ok::<_, TrafficError>(Size::new(
                traced,
                nodes,
                size,
                geometry,
                &curve.at(u32::try_from(geometry.lines()).unwrap_or(u32::MAX)),
            ))
        };
        Ok(Self {
            conditions: Conditions::new(traced, line_bytes, order),
            nodes,
            messages: Messages::new(traced.run.tiling),
            unique_processor_bytes: 4 * traced.reads.words_read(&traced.layout),
            sizes: sizes.iter().map(size).collect::<Result<_, _>>()?,
            curve: thinned(&curve, line_bytes, traced.layout.database_bytes()),
        })
    }

    pub fn size(&self, size: MemorySize) -> Option<&Size> {
        self.sizes.iter().find(|row| row.local_memory == size)
    }

    /// Of what a unique processor would communicate with the memory, without messages and with them.
    pub fn bus_shares(&self, size: &Size) -> [f64; 2] {
        [0, self.messages.bytes()].map(|messages| ratio(size.bus_bytes + messages, self.unique_processor_bytes))
    }
}

/// Four points an octave, from the smallest memory to one of `database_bytes`; the shares by powers of two are among them.
fn thinned(curve: &LruCurve, line_bytes: u32, database_bytes: u64) -> Vec<CurvePoint> {
    let all = database_bytes / u64::from(line_bytes);
    let lines = (0..).map(|quarter| (all as f64 * libm::exp2(-f64::from(quarter) / 4.0)) as u32);
    let lines: Vec<u32> = lines.take_while(|&lines| u64::from(lines) >= LINES_MIN).collect();
    let point = |&lines: &u32| {
        let totals = curve.at(lines);
        CurvePoint {
            local_bytes: u64::from(lines) * u64::from(line_bytes),
            misses: totals.record_misses,
            bus_bytes: totals.line_misses * u64::from(line_bytes),
        }
    };
    lines.iter().rev().map(point).collect()
}

impl Size {
    fn new<T>(traced: &Traced<T>, nodes: u16, size: MemorySize, geometry: Geometry, totals: &Counters) -> Self {
        let mut counts = Counts::new(totals, traced.reads.words_read(&traced.layout), geometry.line_bytes);
        let mut bus_bytes = counts.bus_bytes();
        if size == MemorySize::All {
            counts = Counts { misses: 0, line_misses: 0, words_moved: 0, ..counts };
            bus_bytes = u64::from(nodes) * traced.layout.database_bytes();
        }
        Self { local_memory: size, local_bytes: geometry.local_bytes(), counts, bus_bytes }
    }

    pub fn ratio(&self, ratio: Ratio) -> f64 {
        ratio.of(&self.counts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::published;
    use crate::study::runs::fixture;
    use trace::picture::Sides;

    #[test]
    fn messages_are_those_of_the_protocol() {
        let side =
            |side| Tiling::new(Sides { width: side, height: side, tile_width: 5, tile_height: 5 }).expect("possible");
        let messages = Messages::new(side(published::IMAGE_SIDE));
        assert_eq!(messages, Messages { job_bytes: 10_000, end_of_job_bytes: 10_000, pixel_bytes: 187_500 });
        assert_eq!(messages.bytes(), 207_500);
    }

    #[test]
    fn a_larger_memory_moves_less_and_all_moves_all() {
        let (_, traced) = fixture::gears();
        let sizes = [published::share(8), published::share(2), MemorySize::All];
        let traffic = Traffic::new(&traced, 32, TileOrder::Scanline, 3, &sizes).expect("in memory");
        let [eighth, half, all] = [0, 1, 2].map(|i| &traffic.sizes[i]);
        assert!(eighth.bus_bytes > half.bus_bytes);
        assert_eq!(eighth.counts.record_accesses, half.counts.record_accesses);
        assert_eq!(eighth.bus_bytes, 32 * eighth.counts.line_misses);
        for size in [eighth, half] {
            let point = traffic.curve.iter().find(|point| point.local_bytes == size.local_bytes);
            assert_eq!(point.map(|point| (point.misses, point.bus_bytes)), Some((size.counts.misses, size.bus_bytes)));
        }
        assert_eq!(all.bus_bytes, 3 * traced.layout.database_bytes());
        assert_eq!(all.ratio(Ratio::MissesPerRecordAccess), 0.0);
        let [data, with_messages] = traffic.bus_shares(eighth);
        assert_eq!(data, eighth.ratio(Ratio::WordsMovedPerWordRead));
        assert!(with_messages > data);
    }
}
