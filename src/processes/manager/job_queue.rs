//! The manager's job queue: which tile waits, which is out, which is done.

use std::collections::VecDeque;

use crate::ids::{Attempt, NodeId, TileId};
use crate::protocol::control::{LostAttempt, TileGrant};
use crate::tile_order;
use crate::topology::{Assignment, Run};
use crate::tracer::Tiling;

/// Tiles in order, in one lane from which all nodes are served, or in one lane a node.
#[derive(Debug)]
pub(super) struct JobQueue {
    lanes: Vec<Lane>,
    tiles: Vec<Tile>,
    /// How many more tiles the master can take.
    wanted: u32,
    missing: u32,
    reissued: u64,
}

#[derive(Debug)]
struct Lane {
    /// The only node that may trace these tiles; `None`: any.
    node: Option<NodeId>,
    waiting: VecDeque<TileId>,
    /// Tiles that the master has and that are not done.
    out: u32,
}

#[derive(Clone, Copy, Debug)]
struct Tile {
    lane: u16,
    place: Place,
    /// The attempt that is out, or the next one.
    attempt: Attempt,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Place {
    Waiting,
    Out,
    Done,
}

impl JobQueue {
    /// `nodes` is at least 1.
    pub(super) fn new(run: &Run, tiling: Tiling, nodes: u16) -> Self {
        let order = tile_order::tiles(run.order, tiling, run.seed);
        let nodes_of_lanes: Vec<_> = match run.assignment {
            Assignment::OnDemand => vec![None],
            Assignment::Interleaved => (0..nodes).map(|node| Some(NodeId(node))).collect(),
        };
        let lanes = nodes_of_lanes.into_iter().map(|node| Lane { node, waiting: VecDeque::new(), out: 0 });
        let waiting = Tile { lane: 0, place: Place::Waiting, attempt: Attempt(0) };
        let mut queue = Self {
            lanes: lanes.collect(),
            tiles: vec![waiting; order.len()],
            wanted: 0,
            missing: order.len() as u32,
            reissued: 0,
        };
        let lane_count = queue.lanes.len();
        for (i, tile) in order.into_iter().enumerate() {
            let lane = i % lane_count;
            queue.lanes[lane].waiting.push_back(tile);
            queue.tiles[tile.0 as usize].lane = lane as u16;
        }
        queue
    }

    pub(super) fn total(&self) -> u32 {
        self.tiles.len() as u32
    }

    /// Tiles not done yet.
    pub(super) fn missing(&self) -> u32 {
        self.missing
    }

    /// The attempt at a tile that is part of the image.
    pub(super) fn accepted(&self, tile: TileId) -> Option<Attempt> {
        let tile = self.tiles.get(tile.0 as usize)?;
        (tile.place == Place::Done).then_some(tile.attempt)
    }

    /// Attempts after a tile's first.
    pub(super) fn reissued(&self) -> u64 {
        self.reissued
    }

    /// The master can take so many more tiles, though there may not be as many: a tile that is lost is one more.
    pub(super) fn want(&mut self, tiles: u32) {
        self.wanted = self.wanted.saturating_add(tiles);
    }

    /// What the master is to get now. Lanes with the fewest tiles out come first, so that no node's share of
    /// the master's queue grows at the cost of another's.
    pub(super) fn grants(&mut self) -> Vec<TileGrant> {
        let mut grants = Vec::new();
        while self.wanted > 0 {
            let with_tiles = self.lanes.iter_mut().filter(|lane| !lane.waiting.is_empty());
            let Some(lane) = with_tiles.min_by_key(|lane| lane.out) else { break };
            let Some(id) = lane.waiting.pop_front() else { break };
            lane.out += 1;
            let tile = &mut self.tiles[id.0 as usize];
            tile.place = Place::Out;
            self.wanted -= 1;
            self.reissued += u64::from(tile.attempt > Attempt(0));
            grants.push(TileGrant { tile: id, attempt: tile.attempt, node: lane.node, except: Vec::new() });
        }
        grants
    }

    /// Whether that attempt was out; the tile is done then.
    pub(super) fn finish(&mut self, tile: TileId, attempt: Attempt) -> bool {
        let Some(lane) = self.take_back(tile, attempt, Place::Done) else { return false };
        self.lanes[usize::from(lane)].out -= 1;
        self.missing -= 1;
        true
    }

    /// Whether that attempt was out; the tile waits again then, ahead of the others.
    pub(super) fn lose(&mut self, lost: LostAttempt) -> bool {
        let Some(lane) = self.take_back(lost.tile, lost.attempt, Place::Waiting) else { return false };
        self.tiles[lost.tile.0 as usize].attempt.0 += 1;
        let lane = &mut self.lanes[usize::from(lane)];
        lane.out -= 1;
        lane.waiting.push_front(lost.tile);
        true
    }

    /// The node will not come back: its tiles are anybody's.
    pub(super) fn set_aside(&mut self, node: NodeId) {
        self.lanes.iter_mut().filter(|lane| lane.node == Some(node)).for_each(|lane| lane.node = None);
    }

    fn take_back(&mut self, tile: TileId, attempt: Attempt, place: Place) -> Option<u16> {
        let tile = self.tiles.get_mut(tile.0 as usize)?;
        if tile.place != Place::Out || tile.attempt != attempt {
            return None;
        }
        tile.place = place;
        Some(tile.lane)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::processes::manager::sample;

    fn queue(assignment: Assignment, nodes: u16) -> JobQueue {
        let tiling = Tiling { width: 10, height: 1, tile_width: 1, tile_height: 1 };
        JobQueue::new(&Run { assignment, ..sample::run() }, tiling, nodes)
    }

    fn tiles(grants: &[TileGrant]) -> Vec<(u32, u32, Option<u16>)> {
        grants.iter().map(|g| (g.tile.0, g.attempt.0, g.node.map(|node| node.0))).collect()
    }

    fn lost(tile: u32, attempt: u32) -> LostAttempt {
        LostAttempt { node: NodeId(0), tile: TileId(tile), attempt: Attempt(attempt) }
    }

    #[test]
    fn lost_tiles_come_first_with_the_next_attempt() {
        let mut queue = queue(Assignment::OnDemand, 3);
        assert!(queue.grants().is_empty());
        queue.want(3);
        assert_eq!(tiles(&queue.grants()), [(0, 0, None), (1, 0, None), (2, 0, None)]);
        assert!(queue.lose(lost(1, 0)) && !queue.lose(lost(1, 0)) && !queue.lose(lost(7, 0)));
        assert!(!queue.finish(TileId(1), Attempt(0)), "it was lost");
        queue.want(2);
        assert_eq!(tiles(&queue.grants()), [(1, 1, None), (3, 0, None)]);
        assert!(queue.finish(TileId(1), Attempt(1)) && !queue.finish(TileId(1), Attempt(1)));
        assert_eq!((queue.missing(), queue.total(), queue.reissued()), (9, 10, 1));
    }

    #[test]
    fn a_wish_that_cannot_be_met_yet_is_kept() {
        let mut queue = queue(Assignment::OnDemand, 1);
        // The master does not ask again for what it was not given.
        queue.want(11);
        assert_eq!(queue.grants().len(), 10);
        assert!(queue.lose(lost(9, 0)) && queue.lose(lost(3, 0)));
        assert_eq!(tiles(&queue.grants()), [(3, 1, None)]);
        queue.want(u32::MAX);
        queue.want(u32::MAX);
        assert_eq!(tiles(&queue.grants()), [(9, 1, None)]);
    }

    #[test]
    fn interleaved_tiles_have_a_node_each() {
        let mut queue = queue(Assignment::Interleaved, 3);
        queue.want(10);
        let grants = queue.grants();
        assert_eq!(grants.len(), 10);
        assert!(grants.iter().all(|grant| grant.node == Some(NodeId((grant.tile.0 % 3) as u16))));
    }

    #[test]
    fn a_slow_node_does_not_starve_the_others() {
        let mut queue = queue(Assignment::Interleaved, 2);
        queue.want(4);
        assert_eq!(tiles(&queue.grants()), [(0, 0, Some(0)), (1, 0, Some(1)), (2, 0, Some(0)), (3, 0, Some(1))]);
        // Node 1 finishes nothing; what the master can take goes to node 0.
        for tile in [0, 2] {
            assert!(queue.finish(TileId(tile), Attempt(0)));
        }
        queue.want(2);
        assert_eq!(tiles(&queue.grants()), [(4, 0, Some(0)), (6, 0, Some(0))]);
    }

    #[test]
    fn tiles_of_a_node_that_is_set_aside_are_anybodys() {
        let mut queue = queue(Assignment::Interleaved, 2);
        queue.want(2);
        queue.grants();
        queue.set_aside(NodeId(1));
        assert!(queue.lose(lost(1, 0)));
        queue.want(2);
        assert_eq!(tiles(&queue.grants()), [(1, 1, None), (2, 0, Some(0))]);
    }
}
