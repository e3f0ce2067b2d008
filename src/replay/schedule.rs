//! Which simulated node traces which tiles, in which order.

use super::Trace;
use crate::ids::NodeId;

/// By node, its processes one after the other, each with an empty memory at its beginning: the tiles that it traces,
/// as indices into those of the trace.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Schedule {
    pub nodes: Vec<Vec<Vec<u32>>>,
}

impl Schedule {
    /// Who traced what in the recorded run. `nodes` of them, though not each may have traced a tile.
    pub fn recorded(trace: &(impl Trace + ?Sized), nodes: u16) -> Self {
        let mut schedule = vec![Vec::<Vec<u32>>::new(); usize::from(nodes)];
        let mut last = vec![None; usize::from(nodes)];
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ids::{Epoch, TileId};
    use crate::replay::Captured;

    #[test]
    fn a_process_is_one_though_other_nodes_trace_tiles_between() {
        let mut trace = Captured::default();
        for (tile, (node, epoch)) in (0..).zip([(0, 0), (1, 0), (0, 0), (1, 1), (0, 0), (1, 1)]) {
            trace.push(NodeId(node), TileId(tile), [vec![tile]]);
            trace.tiles[tile as usize].epoch = Epoch(epoch);
        }
        let expected = [vec![vec![0, 2, 4]], vec![vec![1], vec![3, 5]], vec![]];
        assert_eq!(Schedule::recorded(&trace, 3).nodes, expected);
    }
}
