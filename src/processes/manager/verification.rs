//! Which tiles are rendered twice, what came of it, and who is wrong where two results differ.
//!
//! The display compares; here it is decided. Two processes that disagree about a tile are both suspected until a third
//! one has rendered it: who agrees with nobody is wrong, and so is everything it did.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64;

use crate::ids::{Epoch, NodeId, TileId};
use crate::protocol::control::{Comparison, TileResult};

/// From the last result of all to a comparison that is still awaited: it was lost with a display, or its result came
/// from a process that is not believed.
const COMPARISON_DEADLINE: Duration = Duration::from_millis(500);

/// A node's process.
pub(super) type Producer = (NodeId, Epoch);

#[derive(Debug)]
pub(super) struct Verification {
    /// Of the tiles, 0 to 1.
    share: f64,
    seed: u64,
    processes: BTreeMap<Producer, Span>,
    /// Tiles whose second result has not been compared yet, or that are in dispute.
    open: BTreeMap<TileId, Case>,
    condemned: BTreeSet<Producer>,
    /// Since when nobody works on anything, while a comparison is awaited.
    quiet_since: Option<Duration>,
    verified: u64,
    disagreements: u64,
}

/// The tiles of a process that are verified in any case.
#[derive(Clone, Copy, Debug)]
struct Span {
    latest: TileId,
    latest_is_verified: bool,
}

#[derive(Clone, Debug, Default)]
struct Case {
    /// Who has rendered the tile, or is to.
    results: Vec<(Producer, [u8; 32])>,
}

/// What follows from a comparison.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) enum Verdict {
    /// Nothing.
    Agreed,
    /// Somebody else is to render the tile: none of these nodes.
    Dispute { except: Vec<NodeId> },
    /// These processes are wrong.
    Wrong(Vec<Producer>),
}

impl Verification {
    pub(super) fn new(share: f64, seed: u64) -> Self {
        Self {
            share,
            seed,
            processes: BTreeMap::new(),
            open: BTreeMap::new(),
            condemned: BTreeSet::new(),
            quiet_since: None,
            verified: 0,
            disagreements: 0,
        }
    }

    /// Tiles of which two results were compared and agreed.
    pub(super) fn verified(&self) -> u64 {
        self.verified
    }

    pub(super) fn disagreements(&self) -> u64 {
        self.disagreements
    }

    /// A tile is done. `true`: it is to be verified.
    pub(super) fn accept(&mut self, tile: TileId, by: Producer) -> bool {
        if self.share == 0.0 {
            return false;
        }
        let is_first = self.processes.insert(by, Span { latest: tile, latest_is_verified: false }).is_none();
        let chosen = is_first || self.chooses(tile);
        if chosen {
            self.open(tile, by);
        }
        chosen
    }

    /// The latest tile of each process that is not verified yet: they are to be, before the run ends.
    pub(super) fn latest(&mut self) -> Vec<(TileId, NodeId)> {
        let unverified = self.processes.iter().filter(|(_, span)| !span.latest_is_verified);
        let latest: Vec<_> = unverified.map(|(&by, span)| (span.latest, by)).collect();
        let mut asked = Vec::new();
        for (tile, by) in latest {
            if !self.open.contains_key(&tile) {
                self.open(tile, by);
                asked.push((tile, by.0));
            }
        }
        asked
    }

    /// Whether everything that was to be compared has been.
    pub(super) fn is_idle(&self) -> bool {
        self.open.is_empty()
    }

    /// Whether comparisons are awaited that nobody is about to bring; `quiet`: nobody works on anything.
    pub(super) fn is_overdue(&mut self, now: Duration, quiet: bool) -> bool {
        if !quiet || self.is_idle() {
            self.quiet_since = None;
            return false;
        }
        let since = *self.quiet_since.get_or_insert(now);
        now.saturating_sub(since) > COMPARISON_DEADLINE
    }

    /// Tiles that await a comparison, and the nodes that have rendered each.
    pub(super) fn awaited(&self) -> impl Iterator<Item = (TileId, Vec<NodeId>)> {
        self.open.iter().map(|(&tile, case)| (tile, case.nodes()))
    }

    /// Nobody is left who could render the tile again. `true`: it was in dispute, and cannot be settled.
    pub(super) fn give_up(&mut self, tile: TileId) -> bool {
        let Some(case) = self.open.remove(&tile) else { return false };
        self.close(tile);
        case.is_disputed()
    }

    /// The display has compared two results of a tile; `kept_by` did the one in the frame.
    pub(super) fn judge(&mut self, comparison: &Comparison, kept_by: Producer) -> Verdict {
        let Comparison { tile, kept, other } = comparison;
        if kept.digest != other.digest {
            if self.is_condemned(kept_by) {
                return Verdict::Wrong(vec![kept_by]);
            }
            if other.source.is_some_and(|other| self.is_condemned(other)) {
                return Verdict::Agreed;
            }
        }
        let case = self.open.entry(*tile).or_default();
        case.results.retain(|(_, digest)| *digest != UNKNOWN);
        for (by, TileResult { digest, .. }) in [(Some(kept_by), kept), (other.source, other)] {
            if let Some(by) = by {
                case.results.retain(|(known, _)| *known != by);
                case.results.push((by, *digest));
            }
        }
        if case.results.iter().all(|(_, digest)| *digest == kept.digest) {
            self.open.remove(tile);
            self.verified += 1;
            self.close(*tile);
            return Verdict::Agreed;
        }
        if !case.is_settled() {
            self.disagreements += u64::from(case.results.len() == 2);
            return Verdict::Dispute { except: case.nodes() };
        }
        let right = case.majority();
        let wrong = case.results.iter().filter(|(_, digest)| Some(*digest) != right).map(|(by, _)| *by).collect();
        self.open.remove(tile);
        self.close(*tile);
        Verdict::Wrong(wrong)
    }

    /// All that a process did is done again. `true`: it was not known to be wrong.
    pub(super) fn condemn(&mut self, wrong: Producer, tiles: &[TileId]) -> bool {
        self.processes.remove(&wrong);
        tiles.iter().for_each(|tile| drop(self.open.remove(tile)));
        self.condemned.insert(wrong)
    }

    /// Whether the image is vouched for: tiles are verified, or a process is known to be wrong.
    pub(super) fn is_in_force(&self) -> bool {
        self.share > 0.0 || !self.condemned.is_empty()
    }

    /// What it still sends is wrong.
    pub(super) fn is_condemned(&self, process: Producer) -> bool {
        self.condemned.contains(&process)
    }

    pub(super) fn condemned(&self) -> impl Iterator<Item = Producer> {
        self.condemned.iter().copied()
    }

    fn chooses(&self, tile: TileId) -> bool {
        // 53 bits, as many as a number between 0 and 1 has.
        let bits = Pcg64::seed_from_u64(self.seed ^ (u64::from(tile.0) << 32)).next_u64() >> 11;
        (bits as f64) < self.share * (1u64 << 53) as f64
    }

    fn open(&mut self, tile: TileId, by: Producer) {
        self.open.entry(tile).or_default().results.push((by, UNKNOWN));
    }

    fn close(&mut self, tile: TileId) {
        let spans = self.processes.values_mut().filter(|span| span.latest == tile);
        spans.for_each(|span| span.latest_is_verified = true);
    }
}

/// Stands for a digest until the first comparison brings it.
const UNKNOWN: [u8; 32] = [0; 32];

impl Case {
    fn nodes(&self) -> Vec<NodeId> {
        self.results.iter().map(|((node, _), _)| *node).collect()
    }

    fn is_disputed(&self) -> bool {
        self.results.iter().any(|(_, digest)| *digest != self.results[0].1)
    }

    /// Whether two agree among three or more.
    fn is_settled(&self) -> bool {
        self.results.len() > 2 && self.majority().is_some()
    }

    fn majority(&self) -> Option<[u8; 32]> {
        let votes = |digest: &[u8; 32]| self.results.iter().filter(|(_, other)| other == digest).count();
        self.results.iter().map(|(_, digest)| *digest).find(|digest| votes(digest) > 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ids::Attempt;

    const TILE: TileId = TileId(7);

    fn by(node: u16) -> Producer {
        (NodeId(node), Epoch(0))
    }

    fn result(node: u16, digest: u8) -> TileResult {
        TileResult { attempt: Attempt(u32::from(node)), source: Some(by(node)), digest: [digest; 32] }
    }

    fn compare(verification: &mut Verification, kept: (u16, u8), other: (u16, u8)) -> Verdict {
        let comparison = Comparison { tile: TILE, kept: result(kept.0, kept.1), other: result(other.0, other.1) };
        verification.judge(&comparison, by(kept.0))
    }

    #[test]
    fn the_first_tile_of_every_process_and_the_share_are_verified() {
        let mut none = Verification::new(0.0, 1);
        assert!((0..100).all(|tile| !none.accept(TileId(tile), by(0))));
        assert!(none.latest().is_empty());
        let mut some = Verification::new(0.02, 1);
        assert!(some.accept(TileId(0), by(0)) && some.accept(TileId(1), by(1)));
        let chosen = (2..10_002).filter(|&tile| some.accept(TileId(tile), by(0))).count();
        assert!((150..250).contains(&chosen), "{chosen} of 10000");
        assert!((0..100).all(|tile| Verification::new(1.0, 1).accept(TileId(tile), by(0))));
    }

    #[test]
    fn the_latest_tile_is_verified_once_and_before_the_end() {
        let mut verification = Verification::new(1e-12, 1);
        assert!(verification.accept(TILE, by(0)));
        assert!(!verification.is_idle());
        assert_eq!(compare(&mut verification, (0, 5), (1, 5)), Verdict::Agreed);
        assert_eq!(verification.latest(), [], "its first is its latest");
        assert!(!verification.accept(TileId(8), by(0)));
        assert_eq!(verification.latest(), [(TileId(8), NodeId(0))]);
        assert_eq!(verification.latest(), [], "once");
        assert!(!verification.give_up(TileId(8)), "not in dispute");
        assert!(verification.is_idle() && verification.latest().is_empty());
        assert_eq!((verification.verified(), verification.disagreements()), (1, 0));
    }

    #[test]
    fn who_agrees_with_nobody_is_wrong() {
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
    fn what_a_condemned_process_still_sends_is_wrong_without_a_third() {
        let mut verification = Verification::new(1.0, 1);
        assert!(verification.condemn(by(0), &[]) && !verification.condemn(by(0), &[]));
        assert_eq!(compare(&mut verification, (0, 1), (1, 2)), Verdict::Wrong(vec![by(0)]));
        assert_eq!(compare(&mut verification, (1, 2), (0, 1)), Verdict::Agreed);
        assert!(verification.is_idle());
    }

    #[test]
    fn a_dispute_that_nobody_can_settle_is_told() {
        let mut verification = Verification::new(0.0, 1);
        assert_ne!(compare(&mut verification, (0, 1), (1, 2)), Verdict::Agreed);
        assert!(verification.give_up(TILE));
        assert!(!verification.give_up(TILE));
    }
}
