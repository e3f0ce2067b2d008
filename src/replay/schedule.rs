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
        let mut last = None;
        for (i, tile) in (0..).zip(trace.tiles()) {
            let process = (tile.node, tile.epoch);
            let processes = &mut schedule[usize::from(tile.node.0)];
            if last != Some(process) {
                processes.push(Vec::new());
                last = Some(process);
            }
            if let Some(tiles) = processes.last_mut() {
                tiles.push(i);
            }
        }
        Self { nodes: schedule }
    }

    /// Tile after tile to node after node; `tiles` in the order in which they are handed out.
    pub fn interleaved(tiles: &[u32], nodes: u16) -> Self {
        let share = |node: usize| tiles.iter().skip(node).step_by(usize::from(nodes)).copied().collect();
        Self { nodes: (0..usize::from(nodes)).map(|node| vec![share(node)]).collect() }
    }

    /// The nodes and what each traces.
    pub fn nodes(&self) -> impl Iterator<Item = (NodeId, &[Vec<u32>])> {
        (0..).map(NodeId).zip(self.nodes.iter().map(Vec::as_slice))
    }
}
