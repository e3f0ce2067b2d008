//! A recording through the very memories that recorded it: the live counters, once more.

use super::count::Replayer;
use super::detail::{Classes, Detail};
use super::schedule::Schedule;
use super::{RecordLines, TraceError, parallel};
use crate::machine::local_memory::Geometry;
use crate::machine::replacement::{Clock, Fifo, Lru, Random, Replacement};
use crate::machine::stats::MemoryStats;
use crate::recording::references::Recording;
use crate::topology;

/// What each node counted in its accepted tiles; no time is in it.
///
/// # Errors
/// The recording cannot be read, or its local memory be made.
pub fn counts(recording: &Recording) -> Result<Vec<MemoryStats>, TraceError> {
    let memory = &recording.topology.cluster.local_memory;
    let geometry = Geometry::new(memory, &recording.layout).map_err(|error| TraceError(error.to_string()))?;
    let schedule = Schedule::recorded(recording, recording.topology.cluster.nodes);
    let count = |processes: &Vec<Vec<u32>>| match memory.replacement {
        topology::Replacement::Lru => node::<Lru>(recording, processes, geometry),
        topology::Replacement::Fifo => node::<Fifo>(recording, processes, geometry),
        topology::Replacement::Clock => node::<Clock>(recording, processes, geometry),
        topology::Replacement::Random => node::<Random>(recording, processes, geometry),
    };
    parallel::map(&schedule.nodes, count).into_iter().collect()
}

fn node<R: Replacement>(
    recording: &Recording,
    processes: &[Vec<u32>],
    geometry: Geometry,
) -> Result<MemoryStats, TraceError> {
    let lines = RecordLines::new(&recording.layout, geometry.line_bytes);
    let mut detail = Detail::new(recording, Classes::new(&recording.layout, &recording.octree_levels));
    let mut replayer = Replayer::<R, _>::new(&lines, geometry, recording.topology.run.seed);
    for (epoch, tiles) in processes.iter().enumerate() {
        if epoch > 0 {
            replayer.clear();
        }
        for &tile in tiles {
            replayer.tile(recording, tile, &mut detail)?;
        }
    }
    Ok(detail.stats)
}
