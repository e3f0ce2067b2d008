//! Which tiles are rendered twice, what came of it, and which process is wrong where two results differ.
//!
//! The display compares; here it is decided. Two processes that disagree about a tile are both suspected until a third
//! one has rendered it: the process that agrees with no other is wrong, and so is everything that it rendered.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64;

use crate::protocol::control::{Comparison, Holdings, Share, TileResult};
use crate::report::verification as report;
use ground::ids::{NodeId, Producer, RunId, TileId};

/// From the last result of all to a comparison that is still awaited: it was lost with a display, or its result came
/// from a process that is condemned.
const COMPARISON_DEADLINE: Duration = Duration::from_millis(500);

/// Results of one tile. Two nodes that agree settle it, so that honest displays have fewer.
const RESULTS_MAX: usize = 256;

#[derive(Debug)]
pub(crate) struct Verification {
    /// Of the tiles, 0 to 1.
    share: f64,
    seed: u64,
    /// Processes of this run that have done a tile.
    known: BTreeSet<Producer>,
    /// Tiles whose second result has not been compared yet, or that are in dispute.
    open: BTreeMap<TileId, Case>,
    condemned: BTreeSet<Producer>,
    /// The tiles in the frame about which other nodes agree with the process that rendered them.
    agreed: BTreeMap<TileId, Agreement>,
    /// No node was left that could render these again.
    given_up: BTreeSet<TileId>,
    /// Since when no tile is out, while a comparison is awaited.
    quiet_since: Option<Duration>,
    disagreements: u64,
}

#[derive(Clone, Debug)]
struct Agreement {
    with: Producer,
    by: BTreeSet<Producer>,
}

#[derive(Clone, Debug, Default)]
struct Case {
    /// The processes that have rendered the tile, or are to; `None`: no comparison has brought the digest yet.
    results: Vec<(Producer, Option<[u8; 32]>)>,
}

/// What follows from a comparison.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) enum Verdict {
    /// Nothing.
    Agreed,
    /// The tile is to be rendered once more, by none of these nodes: so far one node alone has rendered it.
    Again { except: Vec<NodeId> },
    /// Another node is to render the tile: none of these.
    Dispute { except: Vec<NodeId> },
    /// These processes are wrong.
    Wrong(Vec<Producer>),
}

impl Verification {
    pub(crate) fn new(share: f64, seed: u64) -> Self {
        Self {
            share,
            seed,
            known: BTreeSet::new(),
            open: BTreeMap::new(),
            condemned: BTreeSet::new(),
            agreed: BTreeMap::new(),
            given_up: BTreeSet::new(),
            quiet_since: None,
            disagreements: 0,
        }
    }

    /// Tiles of the image that two nodes or more rendered with the same bytes.
    pub(crate) fn verified(&self) -> u64 {
        self.agreed.len() as u64
    }

    pub(crate) fn disagreements(&self) -> u64 {
        self.disagreements
    }

    /// Tiles of earlier runs are in the image: those that are to be verified, and the nodes that are not to do it. Of
    /// each process that rendered some of them the latest is, and of all of them the share.
    pub(crate) fn resume(&mut self, holdings: &Holdings, tiles: u32) -> Vec<(TileId, Vec<NodeId>)> {
        if self.share == 0.0 {
            return Vec::new();
        }
        for &Share { producer, latest, .. } in &holdings.shares {
            self.open(latest, producer);
        }
        for tile in (0..tiles).map(TileId).filter(|tile| holdings.tiles.contains(*tile)) {
            if self.chooses(tile) {
                // The comparison will say which process rendered it.
                self.open.entry(tile).or_default();
            }
        }
        self.awaited().collect()
    }

    /// A tile is done. `true`: it is to be verified.
    pub(crate) fn accept(&mut self, tile: TileId, by: Producer) -> bool {
        if self.share == 0.0 {
            return false;
        }
        let is_first = self.known.insert(by);
        let chosen = is_first || self.chooses(tile);
        if chosen {
            self.open(tile, by);
        }
        chosen
    }

    /// The latest tile of each process in the image that is not verified yet, and its node: they are to be, before the run
    /// ends. `shares` is what the frame has of each.
    pub(crate) fn latest(&mut self, shares: &[Share]) -> Vec<(TileId, NodeId)> {
        if self.share == 0.0 {
            return Vec::new();
        }
        let is_unverified = |share: &&Share| {
            let is_agreed = self.agreed.get(&share.latest).is_some_and(|agreed| agreed.with == share.producer);
            !is_agreed && !self.given_up.contains(&share.latest) && !self.open.contains_key(&share.latest)
        };
        let latest: Vec<_> = shares.iter().filter(is_unverified).map(|share| (share.latest, share.producer)).collect();
        latest.iter().for_each(|&(tile, by)| self.open(tile, by));
        latest.into_iter().map(|(tile, by)| (tile, by.node)).collect()
    }

    /// Tiles whose comparison is awaited, and most results of one of them.
    #[cfg(any(test, feature = "testing"))]
    pub(crate) fn sizes(&self) -> (usize, usize) {
        (self.open.len(), self.open.values().map(|case| case.results.len()).max().unwrap_or_default())
    }

    /// Whether everything that was to be compared has been.
    pub(crate) fn is_idle(&self) -> bool {
        self.open.is_empty()
    }

    /// Whether comparisons are awaited that no tile on its way will bring; `quiet`: no tile is out.
    pub(crate) fn is_overdue(&mut self, now: Duration, quiet: bool) -> bool {
        if !quiet || self.is_idle() {
            self.quiet_since = None;
            return false;
        }
        let since = *self.quiet_since.get_or_insert(now);
        now.saturating_sub(since) > COMPARISON_DEADLINE
    }

    /// Tiles that await a comparison, and the nodes that have rendered each.
    pub(crate) fn awaited(&self) -> impl Iterator<Item = (TileId, Vec<NodeId>)> {
        self.open.iter().map(|(&tile, case)| (tile, case.nodes()))
    }

    /// No node is left that could render the tile again. `true`: it was in dispute, and cannot be settled.
    pub(crate) fn give_up(&mut self, tile: TileId) -> bool {
        self.given_up.insert(tile);
        self.open.remove(&tile).is_some_and(|case| case.is_disputed())
    }

    /// The display has compared two results of a tile.
    pub(crate) fn judge(&mut self, comparison: &Comparison) -> Verdict {
        let Comparison { tile, kept, other } = comparison;
        if self.is_condemned(kept.producer) || self.is_condemned(other.producer) {
            // One of them counts for nothing: a comparison that is awaited is still to come.
            return Verdict::Agreed;
        }
        let is_awaited = self.open.contains_key(tile);
        let case = self.open.entry(*tile).or_default();
        case.results.retain(|(_, digest)| digest.is_some());
        for TileResult { producer, digest } in [kept, other] {
            case.results.retain(|(known, _)| known != producer);
            case.results.push((*producer, Some(*digest)));
        }
        // Only a display that makes results up comes so far.
        if case.results.len() > RESULTS_MAX {
            case.results.truncate(2);
        }
        let nodes = case.nodes();
        if case.results.iter().all(|(_, digest)| *digest == Some(kept.digest)) {
            // A node does not vouch for itself: neither for another process of it, nor for one of an earlier run.
            if nodes.len() == 1 && is_awaited {
                return Verdict::Again { except: nodes };
            }
            self.agree(*tile, kept.producer);
            return Verdict::Agreed;
        }
        let Some(right) = case.majority() else {
            self.disagreements += u64::from(case.results.len() == 2);
            return Verdict::Dispute { except: nodes };
        };
        let wrong = case.results.iter().filter(|(_, digest)| *digest != Some(right)).map(|(by, _)| *by).collect();
        case.results.retain(|(_, digest)| *digest == Some(right));
        self.agree(*tile, kept.producer);
        Verdict::Wrong(wrong)
    }

    /// The process is wrong, and vouches for nothing. Tiles of others that only it agreed about, and their nodes; `None`: it
    /// is known to be wrong.
    pub(crate) fn condemn(&mut self, wrong: Producer) -> Option<Vec<(TileId, NodeId)>> {
        if !self.condemned.insert(wrong) {
            return None;
        }
        for agreement in self.agreed.values_mut() {
            agreement.by.remove(&wrong);
        }
        let is_alone = |(_, agreement): &(&TileId, &Agreement)| agreement.by.is_empty();
        let alone: Vec<_> = self.agreed.iter().filter(is_alone).map(|(&tile, agreed)| (tile, agreed.with)).collect();
        for &(tile, with) in &alone {
            self.agreed.remove(&tile);
            if self.share > 0.0 && with != wrong {
                self.open(tile, with);
            }
        }
        let of_others = alone.into_iter().filter(|(_, with)| self.share > 0.0 && *with != wrong);
        Some(of_others.map(|(tile, with)| (tile, with.node)).collect())
    }

    /// The tile is to be done again: what was compared does not count.
    pub(crate) fn forget(&mut self, tile: TileId) {
        self.open.remove(&tile);
        self.agreed.remove(&tile);
        self.given_up.remove(&tile);
    }

    /// Which tiles in the frame are vouched for, by process; `shares` is what the frame has of each.
    pub(crate) fn report(&self, shares: &[Share], this: RunId) -> report::Verification {
        let process = |share: &Share| (share.producer, report::Process::new(share.producer, this, share.tiles));
        let mut processes: BTreeMap<_, _> = shares.iter().map(process).collect();
        let mut by = BTreeMap::<Producer, BTreeSet<NodeId>>::new();
        for agreement in self.agreed.values() {
            if let Some(process) = processes.get_mut(&agreement.with) {
                process.verified += 1;
                by.entry(agreement.with).or_default().extend(agreement.by.iter().map(|by| by.node));
            }
        }
        for Share { producer, latest, .. } in shares {
            if let Some(process) = processes.get_mut(producer) {
                process.latest_verified = self.agreed.get(latest).is_some_and(|agreed| agreed.with == *producer);
                process.by = by.get(producer).into_iter().flatten().map(|node| node.0).collect();
            }
        }
        let all: u64 = shares.iter().map(|share| u64::from(share.tiles)).sum();
        let tiles: u64 = processes.values().map(|process| u64::from(process.verified)).sum();
        report::Verification {
            tiles,
            unverified_tiles: all.saturating_sub(tiles),
            processes: processes.into_values().collect(),
        }
    }

    /// What it still sends is wrong.
    pub(crate) fn is_condemned(&self, process: Producer) -> bool {
        self.condemned.contains(&process)
    }

    pub(crate) fn condemned(&self) -> impl ExactSizeIterator<Item = Producer> {
        self.condemned.iter().copied()
    }

    fn chooses(&self, tile: TileId) -> bool {
        // 53 bits, as many as a number between 0 and 1 has.
        let bits = Pcg64::seed_from_u64(self.seed ^ (u64::from(tile.0) << 32)).next_u64() >> 11;
        (bits as f64) < self.share * (1u64 << 53) as f64
    }

    fn open(&mut self, tile: TileId, by: Producer) {
        self.open.entry(tile).or_default().results.push((by, None));
    }

    /// A case is settled. What agrees with a process that is wrong vouches for nothing, and neither does its own node.
    fn agree(&mut self, tile: TileId, kept: Producer) {
        let results = self.open.remove(&tile).unwrap_or_default().results;
        let others = results.iter().map(|(by, _)| *by).filter(|by| by.node != kept.node);
        let others: BTreeSet<_> = others.collect();
        if results.iter().any(|(by, _)| *by == kept) && !others.is_empty() {
            let agreement = self.agreed.entry(tile).or_insert_with(|| Agreement { with: kept, by: BTreeSet::new() });
            agreement.by.extend(others);
        }
    }
}

impl Case {
    /// Each once.
    fn nodes(&self) -> Vec<NodeId> {
        let mut nodes = Vec::new();
        for (by, _) in &self.results {
            if !nodes.contains(&by.node) {
                nodes.push(by.node);
            }
        }
        nodes
    }

    fn is_disputed(&self) -> bool {
        self.results.iter().any(|(_, digest)| *digest != self.results[0].1)
    }

    /// The result about which two nodes agree.
    fn majority(&self) -> Option<[u8; 32]> {
        let nodes = |digest| {
            let agree = self.results.iter().filter(|(_, other)| *other == Some(digest));
            agree.map(|(by, _)| by.node).collect::<BTreeSet<_>>().len()
        };
        self.results.iter().filter_map(|(_, digest)| *digest).find(|&digest| nodes(digest) > 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::control::TileSet;
    use ground::ids::Epoch;

    const TILE: TileId = TileId(7);
    const RUN: RunId = RunId(1);

    fn by(node: u16) -> Producer {
        Producer { run: RUN, node: NodeId(node), epoch: Epoch(0) }
    }

    fn compare(verification: &mut Verification, kept: (u16, u8), other: (u16, u8)) -> Verdict {
        compare_of(verification, TILE, (by(kept.0), kept.1), (by(other.0), other.1))
    }

    fn compare_of(
        verification: &mut Verification,
        tile: TileId,
        kept: (Producer, u8),
        other: (Producer, u8),
    ) -> Verdict {
        let result = |(producer, digest)| TileResult { producer, digest: [digest; 32] };
        verification.judge(&Comparison { tile, kept: result(kept), other: result(other) })
    }

    #[test]
    fn the_first_tile_of_every_process_and_the_share_are_verified() {
        let mut none = Verification::new(0.0, 1);
        assert!((0..100).all(|tile| !none.accept(TileId(tile), by(0))));
        assert!(none.latest(&[Share { producer: by(0), tiles: 1, latest: TILE }]).is_empty());
        let mut some = Verification::new(0.02, 1);
        assert!(some.accept(TileId(0), by(0)) && some.accept(TileId(1), by(1)));
        let chosen = (2..10_002).filter(|&tile| some.accept(TileId(tile), by(0))).count();
        assert!((150..250).contains(&chosen), "{chosen} of 10000");
        assert!((0..100).all(|tile| Verification::new(1.0, 1).accept(TileId(tile), by(0))));
    }

    #[test]
    fn of_an_earlier_run_the_share_and_the_latest_tile_of_every_process_are_verified() {
        let earlier = |node| Producer { run: RunId(9), ..by(node) };
        let share = |node, latest| Share { producer: earlier(node), tiles: 50, latest: TileId(latest) };
        let tiles: TileSet = (0..10_000).map(|tile| tile % 2 == 0).collect();
        let holdings = Holdings { tiles, shares: vec![share(0, 4), share(1, 8)] };
        assert!(Verification::new(0.0, 1).resume(&holdings, 10_000).is_empty());
        let mut latest = Verification::new(1e-12, 1);
        let expected = [(TileId(4), vec![NodeId(0)]), (TileId(8), vec![NodeId(1)])];
        assert_eq!(latest.resume(&holdings, 10_000), expected);
        assert!(latest.latest(&holdings.shares).is_empty(), "they are awaited");
        let again = Verdict::Again { except: vec![NodeId(0)] };
        assert_eq!(compare_of(&mut latest, TileId(4), (earlier(0), 5), (by(0), 5)), again, "its own node");
        assert_eq!(compare_of(&mut latest, TileId(4), (earlier(0), 5), (by(1), 5)), Verdict::Agreed);
        assert!(!latest.is_idle() && latest.latest(&holdings.shares).is_empty());
        let dispute = Verdict::Dispute { except: vec![NodeId(1), NodeId(0)] };
        assert_eq!(compare_of(&mut latest, TileId(8), (earlier(1), 5), (by(0), 6)), dispute);
        let verdict = compare_of(&mut latest, TileId(8), (earlier(1), 5), (by(2), 6));
        assert_eq!(verdict, Verdict::Wrong(vec![earlier(1)]));
        let chosen = Verification::new(0.1, 1).resume(&holdings, 10_000);
        assert!((400..600).contains(&chosen.len()), "{} of 5000", chosen.len());
        assert!(chosen.iter().all(|(tile, _)| tile.0 % 2 == 0), "no other is there");
    }

    #[test]
    fn the_latest_tile_is_verified_once_and_before_the_end() {
        let mut verification = Verification::new(1e-12, 1);
        assert!(verification.accept(TILE, by(0)));
        assert!(!verification.is_idle());
        assert_eq!(compare(&mut verification, (0, 5), (1, 5)), Verdict::Agreed);
        let shares = |latest| [Share { producer: by(0), tiles: 2, latest }];
        assert_eq!(verification.latest(&shares(TILE)), [], "its first is its latest");
        assert!(!verification.accept(TileId(8), by(0)));
        assert_eq!(verification.latest(&shares(TileId(8))), [(TileId(8), NodeId(0))]);
        assert_eq!(verification.latest(&shares(TileId(8))), [], "once");
        assert!(!verification.give_up(TileId(8)), "not in dispute");
        assert!(verification.is_idle() && verification.latest(&shares(TileId(8))).is_empty());
        assert_eq!((verification.verified(), verification.disagreements()), (1, 0));
    }

    #[test]
    fn a_process_that_agrees_with_no_other_is_wrong() {
        // Node 0 kept, node 1 other, node 2 settles it; then two settlers.
        for (digests, wrong) in [([5, 6, 5], 1), ([6, 5, 5], 0)] {
            let mut verification = Verification::new(1.0, 1);
            verification.accept(TILE, by(0));
            let dispute = compare(&mut verification, (0, digests[0]), (1, digests[1]));
            assert_eq!(dispute, Verdict::Dispute { except: vec![NodeId(0), NodeId(1)] });
            assert!(!verification.is_idle());
            let verdict = compare(&mut verification, (0, digests[0]), (2, digests[2]));
            assert_eq!(verdict, Verdict::Wrong(vec![by(wrong)]));
            assert_eq!((verification.is_idle(), verification.disagreements()), (true, 1));
        }
        let mut verification = Verification::new(1.0, 1);
        compare(&mut verification, (0, 1), (1, 2));
        let except = vec![NodeId(1), NodeId(0), NodeId(2)];
        assert_eq!(compare(&mut verification, (0, 1), (2, 3)), Verdict::Dispute { except });
        assert_eq!(compare(&mut verification, (0, 1), (3, 3)), Verdict::Wrong(vec![by(1), by(0)]));
    }

    #[test]
    fn a_condemned_process_vouches_for_nothing_and_accuses_nobody() {
        let mut verification = Verification::new(1.0, 1);
        assert_eq!((verification.condemn(by(0)), verification.condemn(by(0))), (Some(Vec::new()), None));
        for (kept, other) in [((0, 1), (1, 2)), ((1, 2), (0, 1)), ((1, 2), (0, 2))] {
            assert_eq!(compare(&mut verification, kept, other), Verdict::Agreed);
        }
        assert_eq!((verification.verified(), verification.disagreements()), (0, 0));
        // A comparison that is awaited is still to come.
        verification.accept(TILE, by(1));
        compare(&mut verification, (1, 2), (0, 2));
        assert!(!verification.is_idle());
    }

    #[test]
    fn tiles_that_only_a_condemned_process_vouched_for_are_verified_again() {
        let mut verification = Verification::new(1.0, 1);
        compare_of(&mut verification, TileId(0), (by(1), 1), (by(0), 1));
        compare_of(&mut verification, TileId(1), (by(1), 1), (by(0), 1));
        compare_of(&mut verification, TileId(1), (by(1), 1), (by(2), 1));
        compare_of(&mut verification, TileId(2), (by(0), 1), (by(2), 1));
        assert_eq!(verification.verified(), 3);
        assert_eq!(verification.condemn(by(0)), Some(vec![(TileId(0), NodeId(1))]));
        // Its own tile is done again; that is for the queue to say.
        verification.forget(TileId(2));
        assert_eq!((verification.verified(), verification.is_idle()), (1, false));
        assert_eq!(compare_of(&mut verification, TileId(0), (by(1), 1), (by(2), 1)), Verdict::Agreed);
        assert!(verification.is_idle());
    }

    #[test]
    fn processes_of_one_node_are_one_voice() {
        let successor = |node| Producer { epoch: Epoch(1), ..by(node) };
        let mut verification = Verification::new(1.0, 1);
        // Not awaited: it proves nothing, and asks for nothing.
        assert_eq!(compare_of(&mut verification, TILE, (by(0), 1), (successor(0), 1)), Verdict::Agreed);
        assert_eq!((verification.verified(), verification.is_idle()), (0, true));
        // Two processes of node 0 do not outvote node 1.
        compare_of(&mut verification, TILE, (by(0), 1), (successor(0), 1));
        let dispute = Verdict::Dispute { except: vec![NodeId(0), NodeId(1)] };
        assert_eq!(compare_of(&mut verification, TILE, (by(0), 1), (by(1), 2)), dispute);
        assert_eq!(compare_of(&mut verification, TILE, (by(0), 1), (successor(0), 1)), dispute_of(&[1, 0]));
        let wrong = Verdict::Wrong(vec![by(0), successor(0)]);
        let verdict = compare_of(&mut verification, TILE, (by(0), 1), (by(2), 2));
        assert!(verdict == wrong || verdict == Verdict::Wrong(vec![successor(0), by(0)]), "{verdict:?}");
    }

    fn dispute_of(nodes: &[u16]) -> Verdict {
        Verdict::Dispute { except: nodes.iter().map(|node| NodeId(*node)).collect() }
    }

    #[test]
    fn a_dispute_that_nothing_can_settle_is_reported() {
        let mut verification = Verification::new(0.0, 1);
        assert_ne!(compare(&mut verification, (0, 1), (1, 2)), Verdict::Agreed);
        assert!(verification.give_up(TILE));
        assert!(!verification.give_up(TILE));
    }

    #[test]
    fn the_report_says_which_tiles_are_vouched_for_by_which_nodes() {
        let mut verification = Verification::new(1.0, 1);
        let earlier = Producer { run: RunId(0xabc), ..by(3) };
        compare_of(&mut verification, TileId(0), (by(0), 1), (by(1), 1));
        compare_of(&mut verification, TileId(1), (by(0), 1), (by(2), 1));
        compare_of(&mut verification, TileId(1), (by(0), 1), (by(1), 1));
        compare_of(&mut verification, TileId(5), (earlier, 1), (by(2), 1));
        compare_of(&mut verification, TileId(6), (earlier, 1), (by(2), 1));
        verification.forget(TileId(6));
        // Node 1 is wrong about a tile of node 0's.
        compare_of(&mut verification, TileId(2), (by(0), 1), (by(1), 2));
        compare_of(&mut verification, TileId(2), (by(0), 1), (by(2), 1));
        let share = |producer, tiles, latest| Share { producer, tiles, latest: TileId(latest) };
        let report = verification.report(&[share(by(0), 4, 1), share(by(1), 2, 4), share(earlier, 9, 6)], RUN);
        assert_eq!((report.tiles, report.unverified_tiles), (4, 11));
        let told = |process: &report::Process| (process.verified, process.latest_verified, process.by.clone());
        let told: Vec<_> = report.processes.iter().map(told).collect();
        assert_eq!(told, [(3, true, vec![1, 2]), (0, false, vec![]), (1, false, vec![2])]);
        assert_eq!(report.processes[2].earlier_run.as_deref(), Some("0000000000000abc"));
        assert_eq!(report.processes[0].earlier_run, None);
    }
}
