//! The manager's job queue: which tile waits, which is out, which is done, and which are to be done twice.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::Duration;

use crate::protocol::control::TileGrant;
use crate::topology::Run;
use ground::ids::{Attempt, ClusterId, NodeId, Producer, TileId};
use machine::hardware::specification::{Cluster, MemorySize};
use machine::hardware::totals::LostAttempt;
use machine::tile_order;
use machine::tile_order::Assignment;
use trace::picture::Tiling;

/// A tile is a straggler when it has been out for longer than this, and for longer than [`STRAGGLE_FACTOR`] times
/// what tiles take on average.
const STRAGGLE_MIN: Duration = Duration::from_millis(500);
/// The same where accesses are counted: what a second attempt fetches is in the bus' log, so that one that a busy
/// machine alone has held up is not worth it.
const COUNTED_STRAGGLE_MIN: Duration = Duration::from_secs(10);
const STRAGGLE_FACTOR: u32 = 3;

/// Tiles in order, in one lane from which all nodes are served, or in one lane a node.
#[derive(Debug)]
pub(crate) struct JobQueue {
    clusters: Cluster,
    lanes: Vec<Lane>,
    tiles: Vec<Tile>,
    out: BTreeMap<(TileId, Attempt), Out>,
    /// How many of these each cluster has, by cluster id.
    out_of_clusters: Vec<u32>,
    /// Waiting to be done once more, by other nodes than these.
    checks: VecDeque<(TileId, Vec<NodeId>)>,
    missing: u32,
    reissued: u64,
    /// Whether stragglers are handed out a second time.
    duplicates: bool,
    straggle_min: Duration,
    /// From issue to completion, of all accepted tiles.
    taken: Duration,
    accepted: u32,
}

#[derive(Debug)]
struct Lane {
    /// The only node that may trace these tiles; `None`: any.
    node: Option<NodeId>,
    waiting: VecDeque<TileId>,
    /// Tiles that masters have and that are not done.
    out: u32,
}

#[derive(Clone, Copy, Debug)]
struct Tile {
    lane: u16,
    progress: Progress,
    /// Attempts so far: the number of the next one.
    attempts: u32,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Progress {
    Waiting,
    /// With a master or more.
    Out,
    Done {
        attempt: Attempt,
        /// `None`: before this run, as the journal says.
        by: Option<Producer>,
    },
}

#[derive(Clone, Debug)]
struct Out {
    cluster: ClusterId,
    since: Duration,
    kind: Kind,
}

#[derive(Clone, PartialEq, Eq, Debug)]
enum Kind {
    Render,
    /// The tile is a straggler; this is its second attempt at a time.
    Duplicate,
    /// The tile is done: this one is compared with it. Not for these nodes.
    Check(Vec<NodeId>),
}

/// What a completion means.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Completion {
    /// The tile is done by it.
    Accepted,
    /// It was to be compared with what is there, or the tile was done already.
    Extra,
    /// It was not out.
    Unknown,
}

impl JobQueue {
    pub(crate) fn new(run: &Run, tiling: Tiling, clusters: Cluster) -> Self {
        let order = tile_order::tiles(run.order, tiling, run.seed);
        let nodes_of_lanes: Vec<_> = match run.assignment {
            Assignment::OnDemand => vec![None],
            Assignment::Interleaved => (0..clusters.all_nodes()).map(|node| Some(NodeId(node))).collect(),
        };
        let lanes = nodes_of_lanes.into_iter().map(|node| Lane { node, waiting: VecDeque::new(), out: 0 });
        let waiting = Tile { lane: 0, progress: Progress::Waiting, attempts: 0 };
        let mut queue = Self {
            clusters,
            lanes: lanes.collect(),
            tiles: vec![waiting; order.len()],
            out: BTreeMap::new(),
            out_of_clusters: vec![0; usize::from(clusters.count)],
            checks: VecDeque::new(),
            missing: order.len() as u32,
            reissued: 0,
            // Counts that are to be reproduced must not depend on who was slow.
            duplicates: run.assignment == Assignment::OnDemand,
            straggle_min: match clusters.local_memory.size {
                MemorySize::All => STRAGGLE_MIN,
                _ => COUNTED_STRAGGLE_MIN,
            },
            taken: Duration::ZERO,
            accepted: 0,
        };
        let lane_count = queue.lanes.len();
        for (i, tile) in order.into_iter().enumerate() {
            let lane = i % lane_count;
            queue.lanes[lane].waiting.push_back(tile);
            queue.tiles[tile.0 as usize].lane = lane as u16;
        }
        queue
    }

    pub(crate) fn total(&self) -> u32 {
        self.tiles.len() as u32
    }

    /// Tiles not done yet.
    pub(crate) fn missing(&self) -> u32 {
        self.missing
    }

    /// Attempts that masters have.
    #[cfg(any(test, feature = "testing"))]
    pub(crate) fn out(&self) -> usize {
        self.out.len()
    }

    /// Attempts that the master of a cluster has.
    pub(crate) fn out_of_cluster(&self, cluster: ClusterId) -> u32 {
        self.out_of_clusters[usize::from(cluster.0)]
    }

    /// Whether the master of this cluster has the attempt.
    pub(crate) fn is_out(&self, cluster: ClusterId, tile: TileId, attempt: Attempt) -> bool {
        self.out.get(&(tile, attempt)).is_some_and(|out| out.cluster == cluster)
    }

    /// The attempt is not out any more.
    fn take(&mut self, tile: TileId, attempt: Attempt) -> Option<Out> {
        let out = self.out.remove(&(tile, attempt))?;
        self.out_of_clusters[usize::from(out.cluster.0)] -= 1;
        Some(out)
    }

    /// Whether all is done, and no attempt is out.
    pub(crate) fn is_quiet(&self) -> bool {
        self.missing == 0 && self.out.is_empty() && self.checks.is_empty()
    }

    /// The state of a tile, for the search for a fault here.
    #[cfg(any(test, feature = "testing"))]
    pub(crate) fn describe(&self, tile: TileId) -> String {
        let out: Vec<_> = self.out_of(tile).map(|((_, attempt), out)| (attempt.0, out)).collect();
        format!("{tile}: {:?}, out {out:?}", self.tiles.get(tile.0 as usize))
    }

    /// Checks that no master has yet.
    #[cfg(any(test, feature = "testing"))]
    pub(crate) fn waiting_checks(&self) -> usize {
        self.checks.len()
    }

    /// The attempt at a tile that is part of the image.
    pub(crate) fn accepted(&self, tile: TileId) -> Option<Attempt> {
        match self.tiles.get(tile.0 as usize)?.progress {
            Progress::Done { attempt, .. } => Some(attempt),
            _ => None,
        }
    }

    /// Attempts at all tiles.
    #[cfg(any(test, feature = "testing"))]
    pub(crate) fn issued(&self) -> u64 {
        self.tiles.iter().map(|tile| u64::from(tile.attempts)).sum()
    }

    /// Attempts after a tile's first.
    pub(crate) fn reissued(&self) -> u64 {
        self.reissued
    }

    /// What the master of a cluster is to get now, so many tiles at most; `available` are its nodes that are not set
    /// aside. Lanes with the fewest tiles out come first, so that no node's share of the master's queue grows at the
    /// cost of another's.
    pub(crate) fn grants(
        &mut self,
        cluster: ClusterId,
        wanted: u32,
        available: &[NodeId],
        now: Duration,
    ) -> Vec<TileGrant> {
        let mut grants = Vec::new();
        while grants.len() < wanted as usize {
            let grant = self
                .next_check(available)
                .or_else(|| self.next_waiting(cluster))
                .or_else(|| self.next_straggler(cluster, available, now));
            let Some((tile, node, kind)) = grant else { break };
            grants.push(self.issue(tile, node, Out { cluster, since: now, kind }));
        }
        grants
    }

    fn next_check(&mut self, available: &[NodeId]) -> Option<(TileId, Option<NodeId>, Kind)> {
        let suits = |except: &[NodeId]| available.iter().any(|node| !except.contains(node));
        let place = self.checks.iter().position(|(_, except)| suits(except))?;
        let (tile, except) = self.checks.remove(place)?;
        Some((tile, None, Kind::Check(except)))
    }

    fn next_waiting(&mut self, cluster: ClusterId) -> Option<(TileId, Option<NodeId>, Kind)> {
        let clusters = self.clusters;
        let may_take = |lane: &Lane| lane.node.is_none_or(|node| clusters.of(node) == cluster);
        let lanes = self.lanes.iter_mut().filter(|lane| !lane.waiting.is_empty() && may_take(lane));
        let lane = lanes.min_by_key(|lane| lane.out)?;
        let tile = lane.waiting.pop_front()?;
        lane.out += 1;
        self.tiles[tile.0 as usize].progress = Progress::Out;
        Some((tile, lane.node, Kind::Render))
    }

    /// The tile that has been out for longest, if that is long and no other node has it.
    fn next_straggler(
        &self,
        cluster: ClusterId,
        available: &[NodeId],
        now: Duration,
    ) -> Option<(TileId, Option<NodeId>, Kind)> {
        if !self.duplicates || self.accepted == 0 || self.lanes.iter().any(|lane| !lane.waiting.is_empty()) {
            return None;
        }
        let patience = self.straggle_min.max(STRAGGLE_FACTOR * (self.taken / self.accepted));
        // A done tile's other attempt may still be out; so may one from before it had to be done again.
        let is_alone =
            |tile: TileId| self.tiles[tile.0 as usize].progress == Progress::Out && self.out_of(tile).count() == 1;
        let late = self.out.iter().filter(|((tile, _), out)| {
            // A cluster of one node cannot help itself.
            let others = out.cluster != cluster || available.len() > 1;
            out.kind == Kind::Render && others && now.saturating_sub(out.since) > patience && is_alone(*tile)
        });
        let (&(tile, _), _) = late.min_by_key(|(_, out)| out.since)?;
        Some((tile, None, Kind::Duplicate))
    }

    fn out_of(&self, tile: TileId) -> impl Iterator<Item = (&(TileId, Attempt), &Out)> {
        self.out.range((tile, Attempt(0))..=(tile, Attempt(u32::MAX)))
    }

    fn issue(&mut self, tile: TileId, node: Option<NodeId>, out: Out) -> TileGrant {
        let attempts = &mut self.tiles[tile.0 as usize].attempts;
        let attempt = Attempt(*attempts);
        *attempts += 1;
        let except = match &out.kind {
            Kind::Check(except) => except.clone(),
            kind => {
                self.reissued += u64::from(attempt > Attempt(0) && *kind != Kind::Duplicate);
                Vec::new()
            }
        };
        self.out_of_clusters[usize::from(out.cluster.0)] += 1;
        self.out.insert((tile, attempt), out);
        TileGrant { tile, attempt, node, except }
    }

    /// An attempt is complete, and the display has its pixels.
    pub(crate) fn complete(&mut self, tile: TileId, attempt: Attempt, by: Producer, now: Duration) -> Completion {
        let Some(out) = self.take(tile, attempt) else { return Completion::Unknown };
        let entry = &mut self.tiles[tile.0 as usize];
        let is_awaited = matches!(entry.progress, Progress::Out | Progress::Waiting);
        if !is_awaited || matches!(out.kind, Kind::Check(_)) {
            return Completion::Extra;
        }
        let lane = &mut self.lanes[usize::from(entry.lane)];
        match entry.progress {
            Progress::Out => lane.out -= 1,
            // Its other attempt was lost, this one was not.
            _ => lane.waiting.retain(|&waiting| waiting != tile),
        }
        entry.progress = Progress::Done { attempt, by: Some(by) };
        self.missing -= 1;
        self.taken += now.saturating_sub(out.since);
        self.accepted += 1;
        Completion::Accepted
    }

    /// An attempt came to nothing: the tile waits again, ahead of the others, unless somebody else has it.
    pub(crate) fn lose(&mut self, tile: TileId, attempt: Attempt) -> bool {
        let Some(out) = self.take(tile, attempt) else { return false };
        let is_out = self.out_of(tile).any(|(_, other)| !matches!(other.kind, Kind::Check(_)));
        let entry = &mut self.tiles[tile.0 as usize];
        match out.kind {
            // The tile is to be done again itself, or another check of it waits.
            Kind::Check(_) if !matches!(entry.progress, Progress::Done { .. }) => {}
            Kind::Check(_) if self.checks.iter().any(|(waiting, _)| *waiting == tile) => {}
            Kind::Check(except) => self.checks.push_front((tile, except)),
            _ if entry.progress == Progress::Out && !is_out => {
                entry.progress = Progress::Waiting;
                let lane = &mut self.lanes[usize::from(entry.lane)];
                lane.out -= 1;
                lane.waiting.push_front(tile);
            }
            _ => {}
        }
        true
    }

    /// The attempt that a cluster has had for longest, and since when.
    pub(crate) fn oldest(&self, cluster: ClusterId) -> Option<(TileId, Duration)> {
        let of_cluster = self.out.iter().filter(|(_, out)| out.cluster == cluster);
        of_cluster.map(|(&(tile, _), out)| (tile, out.since)).min_by_key(|&(tile, since)| (since, tile.0))
    }

    /// The attempts of which a cluster has not reported the end.
    pub(crate) fn open(&self, cluster: ClusterId) -> impl Iterator<Item = LostAttempt> {
        let of_cluster = self.out.iter().filter(move |(_, out)| out.cluster == cluster);
        of_cluster.map(|(&(tile, attempt), _)| LostAttempt { tile, attempt })
    }

    /// A cluster is dead with all that it had.
    pub(crate) fn lose_cluster(&mut self, cluster: ClusterId) -> usize {
        let lost: Vec<_> = self.out.iter().filter(|(_, out)| out.cluster == cluster).map(|(&id, _)| id).collect();
        // From behind, so that the first tile is the first in its lane again.
        for &(tile, attempt) in lost.iter().rev() {
            self.lose(tile, attempt);
        }
        lost.len()
    }

    /// The node will not come back: its tiles are anybody's.
    pub(crate) fn set_aside(&mut self, node: NodeId) {
        self.lanes.iter_mut().filter(|lane| lane.node == Some(node)).for_each(|lane| lane.node = None);
    }

    /// A done tile is to be rendered once more, by none of these nodes, and compared.
    pub(crate) fn check(&mut self, tile: TileId, except: Vec<NodeId>) {
        self.checks.push_back((tile, except));
    }

    /// The same of many, but for those of which a check waits: however often they are asked for, one does.
    pub(crate) fn check_all(&mut self, tiles: impl IntoIterator<Item = (TileId, Vec<NodeId>)>) {
        let waiting: BTreeSet<_> = self.checks.iter().map(|(tile, _)| *tile).collect();
        self.checks.extend(tiles.into_iter().filter(|(tile, _)| !waiting.contains(tile)));
    }

    /// A tile is in dispute: a check that is for none of these nodes takes the place of one that waits. However often a
    /// node disputes a tile, one check waits.
    pub(crate) fn settle(&mut self, tile: TileId, except: Vec<NodeId>) {
        self.checks.retain(|(waiting, _)| *waiting != tile);
        self.checks.push_front((tile, except));
    }

    /// Checks that wait, and that are for none of these nodes, are given up.
    pub(crate) fn give_up_checks(&mut self, available: &[NodeId]) -> Vec<TileId> {
        let (kept, given_up) = std::mem::take(&mut self.checks)
            .into_iter()
            .partition(|(_, except): &(TileId, Vec<NodeId>)| available.iter().any(|node| !except.contains(node)));
        self.checks = kept;
        given_up.into_iter().map(|(tile, _)| tile).collect()
    }

    /// Whether a check of this tile waits or is out.
    pub(crate) fn checks(&self, tile: TileId) -> bool {
        self.checks.iter().any(|(waiting, _)| *waiting == tile)
            || self.out_of(tile).any(|(_, out)| matches!(out.kind, Kind::Check(_)))
    }

    /// Takes over what the display has of an earlier run; `has` says which tiles. To be called before any is issued.
    pub(crate) fn resume(&mut self, has: impl Fn(TileId) -> bool) -> u32 {
        let mut resumed = 0;
        for (i, entry) in self.tiles.iter_mut().enumerate() {
            if entry.progress == Progress::Waiting && has(TileId(i as u32)) {
                // The journal's attempt; ours are later ones.
                entry.progress = Progress::Done { attempt: Attempt(0), by: None };
                resumed += 1;
            }
        }
        let tiles = &self.tiles;
        let waits = |tile: &TileId| tiles[tile.0 as usize].progress == Progress::Waiting;
        self.lanes.iter_mut().for_each(|lane| lane.waiting.retain(waits));
        self.missing -= resumed;
        resumed
    }

    /// Done tiles that `is_gone` chooses, by tile and its producer, are to be done again: the display does not have them,
    /// or is about to take them out. The producers, a tile each; `None`: of an earlier run.
    pub(crate) fn redo(
        &mut self,
        is_gone: impl Fn(TileId, Option<Producer>) -> bool,
    ) -> Vec<(TileId, Option<Producer>)> {
        let mut redone = Vec::new();
        for (i, entry) in self.tiles.iter_mut().enumerate().rev() {
            let tile = TileId(i as u32);
            if let Progress::Done { by, .. } = entry.progress
                && is_gone(tile, by)
            {
                entry.progress = Progress::Waiting;
                self.lanes[usize::from(entry.lane)].waiting.push_front(tile);
                redone.push((tile, by));
            }
        }
        self.missing += redone.len() as u32;
        if !redone.is_empty() {
            let tiles = &self.tiles;
            self.checks.retain(|(tile, _)| matches!(tiles[tile.0 as usize].progress, Progress::Done { .. }));
        }
        redone
    }
}

#[cfg(test)]
#[path = "job_queue_tests.rs"]
mod tests;
