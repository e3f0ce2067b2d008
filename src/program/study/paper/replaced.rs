//! Table 1's sizes under every replacement policy.

use serde::Serialize;

use crate::study::figures::traffic::TrafficError;
use crate::study::published;
use crate::study::runs::traced::Traced;
use machine::replay::Trace;
use machine::replay::model::evaluation::{Evaluation, Row, evaluate};
use machine::replay::plan::setting::{Assignment, Policy, Setting};
use machine::tile_order::TileOrder;
use trace::tracer::octree::Octree;

/// One scene: a row a policy and size.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Replaced {
    pub scene: String,
    #[serde(flatten)]
    pub octree: Octree,
    pub rows: Vec<Row>,
}

/// Those that are tried.
const POLICIES: [Policy; 5] = [Policy::Lru, Policy::Fifo, Policy::Clock, Policy::Random, Policy::Optimal];

impl Replaced {
    pub(super) fn new<T: Trace>(traced: &Traced<T>, line: u32) -> Result<Self, TrafficError> {
        let setting = |replacement, local_memory| Setting {
            local_memory,
            line,
            ways: None,
            replacement,
            nodes: published::TABLE_NODES,
            clusters: 1,
            tile_order: TileOrder::Scanline,
            assignment: Assignment::Interleaved,
            bus: traced.run.bus,
            processor: traced.run.processor,
        };
        let settings: Vec<_> =
            POLICIES.iter().flat_map(|&policy| published::TABLE_SIZES.map(|size| setting(policy, size))).collect();
        let rows = evaluate(traced, &settings, &Evaluation::default(), |_| {})?;
        Ok(Self { scene: traced.run.scene.clone(), octree: traced.run.octree, rows })
    }

    /// Misses a record access at [`published::TABLE_SIZES`], by policy.
    pub(super) fn by_policy(&self) -> impl Iterator<Item = (Policy, Vec<f64>)> {
        let rows = self.rows.chunks(published::TABLE_SIZES.len());
        POLICIES.into_iter().zip(rows.map(|rows| rows.iter().map(|row| row.misses_per_record_access).collect()))
    }
}
