//! What the manager was told: counts of accepted tiles, lost attempts, totals, incidents.

use std::time::Duration;

use crate::ids::NodeId;
use crate::machine::stats::MemoryStats;
use crate::protocol::control::{BusTotals, DisplayTotals, LostAttempt, MasterTotals, Packets};
use crate::protocol::work::TileDone;
use crate::report::Incident;
use crate::tracer::TraceStats;

/// More incidents are counted, not kept: a peer that knocks all the time must not fill the memory.
const INCIDENTS_MAX: usize = 1000;

#[derive(Debug, Default)]
pub(super) struct Ledger {
    /// By node id.
    pub(super) nodes: Vec<Account>,
    pub(super) trace: TraceStats,
    pub(super) render_cpu_nanoseconds: u64,
    pub(super) lost: Vec<LostAttempt>,
    /// What nodes trace with that hold the whole database, each the same.
    pub(super) packets: Option<Packets>,
    pub(super) bus: Option<BusTotals>,
    pub(super) master: Option<MasterTotals>,
    pub(super) display: Option<DisplayTotals>,
    /// When the first tile was handed out, and when the last one was done.
    pub(super) first_tile: Option<Duration>,
    pub(super) last_tile: Option<Duration>,
    incidents: Vec<Incident>,
    incidents_dropped: u64,
}

/// What one node counted in its accepted tiles, whichever process held its place.
#[derive(Clone, Debug, Default)]
pub(super) struct Account {
    pub(super) tiles: u64,
    pub(super) trace: TraceStats,
    /// `None` until a tile brings counts: a node that holds all of the database has none.
    pub(super) memory: Option<MemoryStats>,
}

impl Ledger {
    pub(super) fn new(nodes: u16) -> Self {
        Self { nodes: vec![Account::default(); usize::from(nodes)], ..Self::default() }
    }

    /// Books an accepted tile.
    pub(super) fn accept(&mut self, now: Duration, node: NodeId, done: &TileDone) {
        self.last_tile = Some(now);
        self.trace.add(&done.trace);
        self.render_cpu_nanoseconds += done.render_cpu_nanoseconds;
        let Some(account) = self.nodes.get_mut(usize::from(node.0)) else { return };
        account.tiles += 1;
        account.trace.add(&done.trace);
        if let Some(memory) = &done.memory {
            account.memory.get_or_insert_default().add(memory);
        }
    }

    pub(super) fn incident(&mut self, now: Duration, text: String) {
        tracing::warn!("{text}");
        if self.incidents.len() < INCIDENTS_MAX {
            self.incidents.push(Incident { seconds: now.as_secs_f64(), text });
        } else {
            self.incidents_dropped += 1;
        }
    }

    /// All of them, the last one saying how many more there were.
    pub(super) fn incidents(&self) -> Vec<Incident> {
        let mut incidents = self.incidents.clone();
        if let (Some(last), 1..) = (incidents.last(), self.incidents_dropped) {
            let text = format!("{} more incidents, see the logs", self.incidents_dropped);
            incidents.push(Incident { seconds: last.seconds, text });
        }
        incidents
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn incidents_are_bounded() {
        let mut ledger = Ledger::new(1);
        (0..1500).for_each(|i| ledger.incident(Duration::from_secs(i), format!("{i}")));
        let incidents = ledger.incidents();
        assert_eq!(incidents.len(), INCIDENTS_MAX + 1);
        assert_eq!(incidents[INCIDENTS_MAX].text, "500 more incidents, see the logs");
    }
}
