//! The tiles: where each is, whether its pixels are to be relied on, and what was counted for it.

mod job_queue;
mod ledger;
mod verification;

use std::time::Duration;

pub(super) use self::job_queue::{Completion, JobQueue};
use self::ledger::Ledger;
pub(super) use self::verification::Verdict;
use self::verification::Verification;
use super::super::plan::Plan;
use crate::protocol::control::{Holdings, Share};
use crate::protocol::work::TileDone;
use ground::ids::{ClusterId, Epoch, Producer, TileId};
use machine::hardware::totals::LostAttempt;

#[derive(Debug)]
pub(crate) struct Tiles {
    pub(crate) queue: JobQueue,
    pub(crate) verification: Verification,
    pub(crate) ledger: Ledger,
}

impl Tiles {
    pub(super) fn new(plan: &Plan) -> Self {
        Self {
            queue: JobQueue::new(&plan.run, plan.tiling, plan.cluster),
            verification: Verification::new(plan.run.verify, plan.run.seed),
            ledger: Ledger::default(),
        }
    }

    /// Takes over what the display has of an earlier run.
    pub(super) fn resume(&mut self, holdings: &Holdings) {
        self.ledger.resumed = self.queue.resume(|tile| holdings.tiles.contains(tile));
        for (tile, except) in self.verification.resume(holdings, self.queue.total()) {
            self.queue.check(tile, except);
        }
    }

    /// The display has a tile's pixels, as the master of a cluster says. `None`: they are of a condemned process.
    pub(super) fn done(
        &mut self,
        cluster: (ClusterId, Epoch),
        by: Producer,
        done: &TileDone,
        now: Duration,
    ) -> Option<Completion> {
        if !self.queue.is_out(cluster.0, done.tile, done.attempt) {
            // An honest master may report what was reported lost to its predecessor's cluster, and no more.
            self.ledger.told_done(cluster, done);
            return Some(Completion::Unknown);
        }
        if self.verification.is_condemned(by) {
            self.ledger.disown(cluster, done);
            self.queue.lose(done.tile, done.attempt);
            return None;
        }
        self.ledger.told_done(cluster, done);
        let completion = self.queue.complete(done.tile, done.attempt, by, now);
        if completion == Completion::Accepted {
            self.ledger.accept(now, by, done);
            if self.verification.accept(done.tile, by) {
                self.queue.check(done.tile, vec![by.node]);
            }
        }
        Some(completion)
    }

    /// Attempts came to nothing, as the master of a cluster says. Those that it does not have are not counted.
    pub(super) fn lose(&mut self, cluster: (ClusterId, Epoch), mut lost: Vec<LostAttempt>) {
        lost.retain(|attempt| self.queue.is_out(cluster.0, attempt.tile, attempt.attempt));
        lost.iter().for_each(|attempt| {
            self.queue.lose(attempt.tile, attempt.attempt);
        });
        self.ledger.book(cluster).lost.extend(lost);
    }

    /// Tiles that are done, and that `is_gone` chooses, are to be done again. How many there are.
    pub(super) fn redo(&mut self, is_gone: impl Fn(TileId, Option<Producer>) -> bool) -> usize {
        let redone = self.queue.redo(is_gone);
        for &(tile, by) in &redone {
            self.verification.forget(tile);
            self.ledger.take_back(by);
        }
        redone.len()
    }

    /// A process is wrong: all that it did is done again. How many tiles; `None`: it is known to be wrong.
    pub(super) fn condemn(&mut self, process: Producer) -> Option<usize> {
        let unvouched = self.verification.condemn(process)?;
        self.queue.check_all(unvouched.into_iter().map(|(tile, node)| (tile, vec![node])));
        self.ledger.forget(process);
        Some(self.redo(|_, by| by == Some(process)))
    }

    /// Tiles that are to be compared and that no node renders are rendered once more.
    pub(super) fn ask_for_comparisons(&mut self) {
        for (tile, nodes) in self.verification.awaited() {
            if !self.queue.checks(tile) {
                self.queue.check(tile, nodes);
            }
        }
    }

    /// All tiles are there: the latest one of each process is verified too. `false`: each is.
    pub(super) fn verify_latest(&mut self, shares: &[Share]) -> bool {
        let latest = self.verification.latest(shares);
        self.queue.check_all(latest.iter().map(|&(tile, node)| (tile, vec![node])));
        !latest.is_empty()
    }

    /// The attempts of a cluster that came to nothing as far as its bus' log is concerned.
    pub(super) fn lost(&mut self, (cluster, epoch): (ClusterId, Epoch)) -> Vec<LostAttempt> {
        let book = self.ledger.book((cluster, epoch));
        let mut lost = [&book.lost[..], &book.disowned].concat();
        // Where the master died before it reported this.
        lost.extend(self.queue.open(cluster));
        lost
    }
}
