//! What was reported to the manager: counts of tiles, lost attempts, totals.

use std::collections::BTreeMap;
use std::time::Duration;

use crate::protocol::control::{DisplayTotals, Packets};
use crate::protocol::work::TileDone;
use ground::ids::{ClusterId, Epoch, Producer};
use machine::hardware::stats::{Counters, MemoryStats};
use machine::hardware::totals::{BusTotals, LostAttempt, MasterTotals};
use trace::tracer::TraceStats;

#[derive(Debug, Default)]
pub(crate) struct Ledger {
    /// What each process of a node counted in its accepted tiles; those that were wrong are taken out.
    accounts: BTreeMap<Producer, Account>,
    /// Of each cluster, from its start to its death or the end of the run.
    pub(crate) books: BTreeMap<(ClusterId, Epoch), Book>,
    /// What nodes trace with that hold the whole database, each the same.
    pub(crate) packets: Option<Packets>,
    pub(crate) display: Option<DisplayTotals>,
    /// Tiles of an earlier run.
    pub(crate) resumed: u32,
    /// When the first tile was handed out, and when the last one was done.
    pub(crate) first_tile: Option<Duration>,
    pub(crate) last_tile: Option<Duration>,
    /// Of all accounts.
    rays: u64,
}

/// What a node counted in its accepted tiles.
#[derive(Clone, Debug, Default)]
pub(crate) struct Account {
    pub(crate) tiles: u64,
    pub(crate) trace: TraceStats,
    /// `None` until a tile brings counts: a node that holds all of the database has none.
    pub(crate) memory: Option<MemoryStats>,
    pub(crate) render_cpu_nanoseconds: u64,
}

/// What went on in a cluster, as far as its master reported, and the totals of the processes that reported totals.
#[derive(Clone, Debug, Default)]
pub(crate) struct Book {
    /// Attempts reported done, whether the image needed them or not.
    pub(crate) told_done: u64,
    /// What they missed.
    pub(crate) missed: Counters,
    pub(crate) lost: Vec<LostAttempt>,
    /// Attempts that a condemned process reported done: its counts are not used.
    pub(crate) disowned: Vec<LostAttempt>,
    pub(crate) bus: Option<BusTotals>,
    pub(crate) master: Option<MasterTotals>,
}

impl Account {
    fn add(&mut self, other: &Self) {
        self.tiles += other.tiles;
        self.trace.add(&other.trace);
        self.render_cpu_nanoseconds = self.render_cpu_nanoseconds.saturating_add(other.render_cpu_nanoseconds);
        if let Some(memory) = &other.memory {
            self.memory.get_or_insert_default().add(memory);
        }
    }

    fn of(done: &TileDone) -> Self {
        Self {
            tiles: 1,
            trace: done.trace.clone(),
            memory: done.memory.clone(),
            render_cpu_nanoseconds: done.render_cpu_nanoseconds,
        }
    }
}

impl Ledger {
    /// Books a tile that became part of the image.
    pub(crate) fn accept(&mut self, now: Duration, by: Producer, done: &TileDone) {
        self.last_tile = Some(now);
        self.rays = self.rays.saturating_add(done.trace.all_rays());
        self.accounts.entry(by).or_default().add(&Account::of(done));
    }

    pub(crate) fn book(&mut self, cluster: (ClusterId, Epoch)) -> &mut Book {
        self.books.entry(cluster).or_default()
    }

    /// Counts what a master reported done, whether it became part of the image or not.
    pub(crate) fn told_done(&mut self, cluster: (ClusterId, Epoch), done: &TileDone) {
        let book = self.book(cluster);
        book.told_done += 1;
        if let Some(memory) = &done.memory {
            book.missed.add(&memory.total());
        }
    }

    /// Books a tile that a condemned process reported done: its fetches count as those of a lost attempt.
    pub(crate) fn disown(&mut self, cluster: (ClusterId, Epoch), done: &TileDone) {
        let book = self.book(cluster);
        book.told_done += 1;
        book.disowned.push(LostAttempt { tile: done.tile, attempt: done.attempt });
    }

    /// Takes out of the books what a process counted: all of it is done again.
    pub(crate) fn forget(&mut self, process: Producer) {
        let forgotten = self.accounts.remove(&process);
        self.rays = self.rays.saturating_sub(forgotten.map_or(0, |account| account.trace.all_rays()));
    }

    /// Rays of all kinds in accepted tiles.
    pub(crate) fn rays(&self) -> u64 {
        self.rays
    }

    /// A tile is done again that is counted there, or as an earlier run's; what it took stays counted.
    pub(crate) fn take_back(&mut self, tile_of: Option<Producer>) {
        match tile_of {
            None => self.resumed = self.resumed.saturating_sub(1),
            Some(process) => {
                if let Some(account) = self.accounts.get_mut(&process) {
                    account.tiles = account.tiles.saturating_sub(1);
                }
            }
        }
    }

    /// What each of so many nodes counted, by its processes together.
    pub(crate) fn nodes(&self, nodes: u16) -> Vec<Account> {
        let mut all = vec![Account::default(); usize::from(nodes)];
        for (by, account) in &self.accounts {
            if let Some(all) = all.get_mut(usize::from(by.node.0)) {
                all.add(account);
            }
        }
        all
    }

    /// What all nodes counted.
    pub(crate) fn total(&self) -> Account {
        let mut total = Account::default();
        self.accounts.values().for_each(|account| total.add(account));
        total
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ground::ids::{Attempt, NodeId, TileId};

    #[test]
    fn a_tile_that_is_done_again_is_counted_once() {
        let by = |node| Producer { node: NodeId(node), ..Producer::default() };
        let (one, other) = (by(0), by(1));
        let done = TileDone {
            tile: TileId(0),
            attempt: Attempt(0),
            trace: TraceStats::default(),
            memory: None,
            render_cpu_nanoseconds: 5,
        };
        let mut ledger = Ledger { resumed: 1, ..Ledger::default() };
        ledger.accept(Duration::ZERO, one, &done);
        ledger.take_back(Some(one));
        ledger.accept(Duration::ZERO, other, &done);
        ledger.take_back(None);
        ledger.take_back(Some(by(2)));
        let total = ledger.total();
        assert_eq!((total.tiles, total.render_cpu_nanoseconds, ledger.resumed), (1, 10, 0));
    }
}
