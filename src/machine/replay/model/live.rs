//! A recording through the very memories that recorded it: the live counters, once more.

use crate::hardware::local_memory::Geometry;
use crate::hardware::stats::MemoryStats;
use crate::recording::references::Recording;
use crate::replay::model::detail::{Classes, Detail};
use crate::replay::model::node::replay_node;
use crate::replay::plan::schedule::TileSchedule;
use crate::replay::{TraceError, parallel};

/// What each node counted in its accepted tiles; no time is in it.
///
/// # Errors
/// The recording cannot be read, or its local memory be made.
pub fn counts(recording: &Recording) -> Result<Vec<MemoryStats>, TraceError> {
    let memory = &recording.conditions.cluster.local_memory;
    let geometry = Geometry::new(memory, &recording.layout)?;
    let schedule = TileSchedule::recorded(recording, recording.conditions.cluster.all_nodes().into());
    let count = |processes: &Vec<Vec<u32>>| {
        let mut detail = Detail::new(recording, Classes::new(&recording.layout, &recording.octree_levels));
        replay_node(recording, processes, memory.replacement.into(), geometry, &mut detail)?;
        Ok(detail.stats)
    };
    parallel::map(&schedule.nodes, count).into_iter().collect()
}
