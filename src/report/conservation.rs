//! What must balance at the end of every run, whatever happened on the way.

use serde::{Deserialize, Serialize};

use crate::database::Section;
use crate::ids::NodeId;
use crate::machine::stats::MemoryStats;
use crate::protocol::control::{BusTotals, MasterTotals};
use crate::tracer::TraceStats;

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Conservation {
    /// Whether every check holds.
    pub holds: bool,
    pub checks: Vec<Check>,
}

/// An equation between counts that different processes made.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Check {
    /// `left = right`, in words.
    pub name: String,
    pub left: u64,
    pub right: u64,
    pub holds: bool,
}

impl Check {
    pub fn new(name: impl Into<String>, left: u64, right: u64) -> Self {
        Self { name: name.into(), left, right, holds: left == right }
    }
}

/// What a node's tracer and its local memory counted, each for itself, in the node's accepted tiles.
#[derive(Clone, Debug)]
pub struct NodeBook {
    pub node: NodeId,
    pub trace: TraceStats,
    pub memory: MemoryStats,
}

impl NodeBook {
    /// Every visit of an octree node and every test of a primitive reads one record.
    fn check(&self) -> Check {
        let read = |section: Section| {
            let total = self.memory.section(section);
            total.record_hits() + total.record_misses
        };
        let sections = [Section::OctreeNodes, Section::Triangles, Section::Spheres, Section::Cones];
        Check::new(
            format!("{}: octree nodes visited + primitives tested = record hits + misses there", self.node),
            self.trace.octree_accesses.iter().sum::<u64>() + self.trace.primitive_tests,
            sections.into_iter().map(read).sum(),
        )
    }
}

/// Whose books are compared.
#[derive(Clone, Copy, Debug)]
pub struct Books<'a> {
    /// What each node counted in its accepted tiles; empty where all of the database is in local memory.
    pub nodes: &'a [NodeBook],
    pub line_bytes: u32,
    pub bus: BusTotals,
    pub master: MasterTotals,
    /// The manager's own.
    pub tiles_total: u64,
    pub tiles_done: u64,
    pub tiles_missing: u64,
    /// Attempts that the manager was told are lost.
    pub attempts_lost: u64,
}

impl Conservation {
    pub fn new(checks: Vec<Check>) -> Self {
        Self { holds: checks.iter().all(|check| check.holds), checks }
    }

    /// With checks of others.
    #[must_use]
    pub fn and(mut self, checks: Vec<Check>) -> Self {
        self.checks.extend(checks);
        Self::new(self.checks)
    }

    /// Compares the books of manager, master, nodes and bus.
    pub fn of(books: &Books) -> Self {
        let Books { nodes, bus, master, .. } = books;
        let mut all = MemoryStats::default();
        let mut checks = Vec::new();
        for book in *nodes {
            checks.push(book.check());
            all.add(&book.memory);
        }
        let total = all.total();
        checks.push(Check::new(
            "logged fetches = misses of accepted attempts + fetches of lost attempts",
            bus.fetches,
            total.record_misses + bus.fetches_of_lost_attempts,
        ));
        checks.push(Check::new(
            "fetched bytes = line misses of accepted attempts x line + fetched bytes of lost attempts",
            bus.fetched_bytes,
            total.line_misses * u64::from(books.line_bytes) + bus.fetched_bytes_of_lost_attempts,
        ));
        checks.push(Check::new(
            "attempts issued = accepted + stale + lost",
            master.attempts_issued,
            master.attempts_accepted + master.attempts_stale + master.attempts_lost,
        ));
        checks.push(Check::new(
            "attempts told lost = lost + stale",
            books.attempts_lost,
            // An attempt is stale when its completion arrives after it was told lost.
            master.attempts_lost + master.attempts_stale,
        ));
        checks.push(Check::new(
            "tiles done by the manager = attempts accepted by the master",
            books.tiles_done,
            master.attempts_accepted,
        ));
        checks.push(Check::new("log rows = transactions", bus.log_rows, bus.transactions));
        checks.push(Check::new("tiles = done + missing", books.tiles_total, books.tiles_done + books.tiles_missing));
        Self::new(checks)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::sample;

    /// Two nodes of the sample (50 record misses and 55 line misses of 32 bytes each), 3 fetches of 4 lines
    /// lost with a node, 5 tiles of which 4 are done after one was issued again.
    fn balanced(nodes: &[NodeBook]) -> Books<'_> {
        Books {
            nodes,
            line_bytes: 32,
            bus: BusTotals {
                transactions: 120,
                log_rows: 120,
                fetches: 103,
                fetched_bytes: 110 * 32 + 4 * 32,
                fetches_of_lost_attempts: 3,
                fetched_bytes_of_lost_attempts: 4 * 32,
                ..BusTotals::default()
            },
            master: MasterTotals { attempts_issued: 6, attempts_accepted: 4, attempts_stale: 0, attempts_lost: 2 },
            tiles_total: 5,
            tiles_done: 4,
            tiles_missing: 1,
            attempts_lost: 2,
        }
    }

    /// The sample has 450 accesses to octree nodes and 40 to triangles.
    fn nodes() -> Vec<NodeBook> {
        let mut trace = TraceStats { primitive_tests: 40, ..TraceStats::default() };
        (trace.octree_accesses[0], trace.octree_accesses[2]) = (100, 350);
        let book = |node| NodeBook { node: NodeId(node), trace: trace.clone(), memory: sample::memory_stats() };
        vec![book(0), book(1)]
    }

    #[test]
    fn balanced_books_hold() {
        let nodes = nodes();
        let conservation = Conservation::of(&balanced(&nodes));
        assert!(conservation.holds, "{conservation:#?}");
        assert_eq!(conservation.checks.len(), 2 + 7);
    }

    #[test]
    fn a_read_that_the_memory_did_not_count_is_named() {
        let mut nodes = nodes();
        nodes[1].trace.primitive_tests += 1;
        let conservation = Conservation::of(&balanced(&nodes));
        let failed: Vec<_> = conservation.checks.iter().filter(|check| !check.holds).collect();
        assert!(failed.len() == 1 && failed[0].name.starts_with("node 1: octree"), "{failed:#?}");
    }

    #[test]
    fn each_imbalance_is_named() {
        let nodes = nodes();
        type Change = fn(&mut Books);
        let wrong: [(&str, Change); 7] = [
            ("logged fetches", |b| b.bus.fetches += 1),
            ("fetched bytes", |b| b.bus.fetched_bytes -= 32),
            ("attempts issued", |b| b.master.attempts_issued -= 1),
            ("attempts told", |b| b.attempts_lost -= 1),
            ("tiles done", |b| (b.tiles_done, b.tiles_missing) = (5, 0)),
            ("log rows", |b| b.bus.log_rows -= 1),
            ("tiles =", |b| b.tiles_missing = 0),
        ];
        for (name, break_books) in wrong {
            let mut books = balanced(&nodes);
            break_books(&mut books);
            let conservation = Conservation::of(&books);
            let failed: Vec<_> = conservation.checks.iter().filter(|check| !check.holds).collect();
            assert!(
                !conservation.holds && failed.len() == 1 && failed[0].name.starts_with(name),
                "{name}: {failed:#?}"
            );
        }
    }
}
