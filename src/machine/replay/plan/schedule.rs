//! Which simulated node traces which tiles, in which order.

use crate::replay::Trace;
use crate::replay::plan::setting::{Assignment, Setting};
use crate::replay::stream::subject::Subject;
use ground::ids::NodeId;

/// By node, its processes one after the other, each with an empty memory at its beginning: the tiles that it traces,
/// as indices into those of the trace.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct TileSchedule {
    pub nodes: Vec<Vec<Vec<u32>>>,
}

impl TileSchedule {
    /// Who traced what in the recorded run. `nodes` of them, though not each may have traced a tile.
    pub fn recorded(trace: &(impl Trace + ?Sized), nodes: u32) -> Self {
        let mut schedule = vec![Vec::<Vec<u32>>::new(); nodes as usize];
        let mut last = vec![None; nodes as usize];
        for (i, tile) in (0..).zip(trace.tiles()) {
            let node = usize::from(tile.node.0);
            let processes = &mut schedule[node];
            // Those of several nodes may alternate.
            if last[node].replace(tile.epoch) != Some(tile.epoch) {
                processes.push(Vec::new());
            }
            if let Some(tiles) = processes.last_mut() {
                tiles.push(i);
            }
        }
        Self { nodes: schedule }
    }

    /// Tile after tile to node after node; `tiles` in the order in which they are handed out, `None` for one that
    /// the trace does not have.
    pub fn interleaved(tiles: &[Option<u32>], nodes: u32) -> Self {
        let nodes = nodes as usize;
        let share = |node| tiles.iter().skip(node).step_by(nodes).copied().flatten().collect();
        Self { nodes: (0..nodes).map(|node| vec![share(node)]).collect() }
    }

    /// The nodes and what each traces.
    pub fn nodes(&self) -> impl Iterator<Item = (NodeId, &[Vec<u32>])> {
        (0..).map(NodeId).zip(self.nodes.iter().map(Vec::as_slice))
    }
}

/// Who traces what under a setting; of on-demand assignment what interleaved ones would.
pub fn schedule<S: Subject>(subject: &S, setting: &Setting) -> TileSchedule {
    match setting.assignment {
        Assignment::Recorded => TileSchedule::recorded(subject, setting.all_nodes()),
        Assignment::Interleaved | Assignment::OnDemand => {
            TileSchedule::interleaved(&subject.ordered(setting.tile_order), setting.all_nodes())
        }
    }
}

/// The schedules of settings; those that are the same are there once.
pub struct TileSchedules {
    pub distinct: Vec<TileSchedule>,
    /// By setting.
    index: Vec<usize>,
}

impl TileSchedules {
    pub fn new<S: Subject>(subject: &S, settings: &[Setting]) -> Self {
        let (mut keys, mut distinct, mut index) = (Vec::new(), Vec::new(), Vec::new());
        for setting in settings {
            let key = (setting.assignment, setting.nodes, setting.clusters, setting.tile_order);
            let place = keys.iter().position(|known| *known == key).unwrap_or(keys.len());
            if place == keys.len() {
                keys.push(key);
                distinct.push(schedule(subject, setting));
            }
            index.push(place);
        }
        Self { distinct, index }
    }

    /// Of the i-th setting, its place among the distinct ones.
    pub fn index(&self, setting: usize) -> usize {
        self.index[setting]
    }

    /// Of the i-th setting.
    pub fn of(&self, setting: usize) -> &TileSchedule {
        &self.distinct[self.index[setting]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::replay::Captured;
    use ground::ids::{Epoch, TileId};

    #[test]
    fn a_process_is_one_though_other_nodes_trace_tiles_between() {
        let mut trace = Captured::default();
        for (tile, (node, epoch)) in (0..).zip([(0, 0), (1, 0), (0, 0), (1, 1), (0, 0), (1, 1)]) {
            trace.push(NodeId(node), TileId(tile), [vec![tile]]);
            trace.tiles[tile as usize].epoch = Epoch(epoch);
        }
        let expected = [vec![vec![0, 2, 4]], vec![vec![1], vec![3, 5]], vec![]];
        assert_eq!(TileSchedule::recorded(&trace, 3).nodes, expected);
    }
}
