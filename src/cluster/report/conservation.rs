//! What must balance at the end of every run, whatever happened on the way.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use ground::ids::NodeId;
use machine::hardware::stats::{Counters, MemoryStats};
use machine::hardware::totals::{BusTotals, MasterTotals};
use trace::database::Section;
use trace::tracer::TraceStats;

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Conservation {
    /// Whether every check holds.
    pub holds: bool,
    pub checks: Vec<Check>,
    /// Whose part in it cannot be checked, and why.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub unverifiable: Vec<String>,
}

/// An equation between counts that different processes made.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
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
    /// Every visit of an octree node and every test of a primitive reads one record, and every triangle of a polygon.
    fn check(&self) -> Check {
        let read = |section: Section| {
            let total = self.memory.section(section);
            total.record_hits() + total.record_misses
        };
        let objects = [Section::Triangles, Section::Spheres, Section::Cones, Section::Polygons];
        let tests = self.trace.primitive_tests + self.trace.polygon_triangles;
        Check::new(
            format!("{}: octree nodes visited + primitives tested = record hits + misses there", self.node),
            self.trace.octree_accesses.iter().sum::<u64>() + tests,
            read(Section::OctreeNodes) + objects.into_iter().map(read).sum::<u64>(),
        )
    }
}

/// What went on in a cluster between the start of its servers and their end.
#[derive(Clone, Debug, Default)]
pub struct ClusterBook {
    /// As errors and checks name it; empty where there is only one.
    pub name: String,
    /// Attempts that were reported done to the manager, needed or not, and what they missed.
    pub told_done: u64,
    pub missed: Counters,
    /// Attempts that were reported lost to the manager.
    pub told_lost: u64,
    /// `None`: it did not live to close its books.
    pub bus: Option<BusTotals>,
    pub master: Option<MasterTotals>,
}

/// Whose books are compared.
#[derive(Clone, Copy, Debug)]
pub struct Books<'a> {
    /// What each node counted in its accepted tiles; empty where all of the database is in local memory.
    pub nodes: &'a [NodeBook],
    pub clusters: &'a [ClusterBook],
    pub line_bytes: u32,
    /// The manager's own.
    pub tiles_total: u64,
    /// By nodes of this run.
    pub tiles_done: u64,
    /// By an earlier run.
    pub tiles_resumed: u64,
    pub tiles_missing: u64,
}

impl ClusterBook {
    fn check(&self, line_bytes: u32, checks: &mut Vec<Check>) {
        let mut check = |name: &str, left, right| checks.push(Check::new(format!("{}{name}", self.name), left, right));
        if let Some(bus) = self.bus {
            check(
                "logged fetches = misses of attempts told done + fetches of lost attempts",
                bus.fetches,
                self.missed.record_misses + bus.fetches_of_lost_attempts,
            );
            check(
                "fetched bytes = line misses of attempts told done x line + fetched bytes of lost attempts",
                bus.fetched_bytes,
                self.missed.line_misses * u64::from(line_bytes) + bus.fetched_bytes_of_lost_attempts,
            );
            check("log rows = transactions", bus.log_rows, bus.transactions);
        }
        if let Some(master) = self.master {
            check(
                "attempts issued = accepted + stale + lost",
                master.attempts_issued,
                master.attempts_accepted + master.attempts_stale + master.attempts_lost,
            );
            check(
                "attempts told lost = lost + stale",
                self.told_lost,
                // An attempt is stale when its completion arrives after it was reported lost.
                master.attempts_lost + master.attempts_stale,
            );
            check("attempts told done = accepted by the master", self.told_done, master.attempts_accepted);
        }
    }

    /// Whose books are missing.
    fn unverifiable(&self) -> Option<String> {
        let name = if self.name.is_empty() { "the cluster: " } else { &self.name };
        let who = match (self.bus, self.master) {
            (Some(_), Some(_)) => return None,
            (None, Some(_)) => "its bus",
            (Some(_), None) => "its master",
            (None, None) => "its bus or its master",
        };
        Some(format!("{name}{who} died with its books open"))
    }
}

impl Conservation {
    pub fn new(checks: Vec<Check>) -> Self {
        Self { holds: checks.iter().all(|check| check.holds), checks, unverifiable: Vec::new() }
    }

    /// The first check that does not hold; `None`: all do.
    pub fn imbalance(&self) -> Option<String> {
        let failed = self.checks.iter().find(|check| !check.holds)?;
        Some(format!("{}: {} against {}", failed.name, failed.left, failed.right))
    }

    /// With checks of others.
    #[must_use]
    pub fn and(mut self, checks: Vec<Check>) -> Self {
        self.checks.extend(checks);
        Self { unverifiable: self.unverifiable, ..Self::new(self.checks) }
    }

    /// Compares the books of manager, masters, nodes and buses.
    pub fn of(books: &Books) -> Self {
        let mut checks: Vec<_> = books.nodes.iter().map(NodeBook::check).collect();
        books.clusters.iter().for_each(|cluster| cluster.check(books.line_bytes, &mut checks));
        checks.push(Check::new(
            "tiles = done + resumed + missing",
            books.tiles_total,
            books.tiles_done + books.tiles_resumed + books.tiles_missing,
        ));
        let unverifiable = books.clusters.iter().filter_map(ClusterBook::unverifiable).collect();
        Self { unverifiable, ..Self::new(checks) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::fixture;
    use machine::hardware::stats::section_class;
    use trace::tracer::RayKind;

    /// Two nodes of the fixture (50 record misses and 55 line misses of 32 bytes each), 3 fetches of 4 lines
    /// lost with a node, 5 tiles of which 4 are done after one was issued again.
    fn balanced<'a>(nodes: &'a [NodeBook], clusters: &'a [ClusterBook]) -> Books<'a> {
        Books { nodes, clusters, line_bytes: 32, tiles_total: 5, tiles_done: 4, tiles_resumed: 0, tiles_missing: 1 }
    }

    fn cluster() -> ClusterBook {
        let mut missed = Counters::default();
        (0..2).for_each(|_| missed.add(&fixture::memory_stats().total()));
        ClusterBook {
            name: String::new(),
            told_done: 4,
            missed,
            told_lost: 2,
            bus: Some(BusTotals {
                transactions: 120,
                log_rows: 120,
                fetches: 103,
                fetched_bytes: 110 * 32 + 4 * 32,
                fetches_of_lost_attempts: 3,
                fetched_bytes_of_lost_attempts: 4 * 32,
                ..BusTotals::default()
            }),
            master: Some(MasterTotals {
                attempts_issued: 6,
                attempts_accepted: 4,
                attempts_stale: 0,
                attempts_lost: 2,
            }),
        }
    }

    /// The fixture has 450 accesses to octree nodes and 40 to triangles.
    fn nodes() -> Vec<NodeBook> {
        let mut trace = TraceStats { primitive_tests: 40, ..TraceStats::default() };
        (trace.octree_accesses[0], trace.octree_accesses[2]) = (100, 350);
        let book = |node| NodeBook { node: NodeId(node), trace: trace.clone(), memory: fixture::memory_stats() };
        vec![book(0), book(1)]
    }

    #[test]
    fn balanced_books_hold() {
        let nodes = nodes();
        let conservation = Conservation::of(&balanced(&nodes, &[cluster()]));
        assert!(conservation.holds && conservation.unverifiable.is_empty(), "{conservation:#?}");
        assert_eq!(conservation.checks.len(), 2 + 6 + 1);
    }

    #[test]
    fn what_a_dead_cluster_did_is_named_and_not_checked() {
        let nodes = nodes();
        let dead = ClusterBook { name: "cluster 1 (epoch 0): ".to_owned(), bus: None, told_done: 9, ..cluster() };
        let dead = ClusterBook { master: None, ..dead };
        let conservation = Conservation::of(&balanced(&nodes, &[cluster(), dead]));
        assert!(conservation.holds);
        assert_eq!(conservation.checks.len(), 2 + 6 + 1);
        assert_eq!(conservation.unverifiable, ["cluster 1 (epoch 0): its bus or its master died with its books open"]);
    }

    /// Polygons that are objects: 40 tests read a polygon each, and 100 triangles.
    #[test]
    fn triangles_of_polygons_are_reads_and_no_tests() {
        let mut nodes = nodes();
        for book in &mut nodes {
            book.trace.polygon_triangles = 100;
            let counters = &mut book.memory.counters[RayKind::Shadow as usize];
            counters[section_class(Section::Triangles)].record_accesses = 100;
            let polygons = &mut counters[section_class(Section::Polygons)];
            (polygons.record_accesses, polygons.line_accesses) = (40, 40);
        }
        assert!(Conservation::of(&balanced(&nodes, &[cluster()])).holds);
        nodes[0].trace.polygon_triangles += 1;
        assert!(!Conservation::of(&balanced(&nodes, &[cluster()])).holds);
    }

    #[test]
    fn a_read_that_the_memory_did_not_count_is_named() {
        let mut nodes = nodes();
        nodes[1].trace.primitive_tests += 1;
        let conservation = Conservation::of(&balanced(&nodes, &[cluster()]));
        let failed: Vec<_> = conservation.checks.iter().filter(|check| !check.holds).collect();
        assert!(failed.len() == 1 && failed[0].name.starts_with("node 1: octree"), "{failed:#?}");
    }

    #[test]
    fn each_imbalance_is_named() {
        let nodes = nodes();
        type Change = fn(&mut Books, &mut ClusterBook);
        fn bus(book: &mut ClusterBook) -> &mut BusTotals {
            book.bus.as_mut().expect("closed")
        }
        let wrong: [(&str, Change); 7] = [
            ("logged fetches", |_, c| bus(c).fetches += 1),
            ("fetched bytes", |_, c| bus(c).fetched_bytes -= 32),
            ("attempts issued", |_, c| c.master.as_mut().expect("closed").attempts_issued -= 1),
            ("attempts told lost", |_, c| c.told_lost -= 1),
            ("attempts told done", |_, c| c.told_done += 1),
            ("log rows", |_, c| bus(c).log_rows -= 1),
            ("tiles =", |b, _| b.tiles_missing = 0),
        ];
        for (name, break_books) in wrong {
            let mut cluster = cluster();
            let mut books = balanced(&nodes, &[]);
            break_books(&mut books, &mut cluster);
            let clusters = [cluster];
            let conservation = Conservation::of(&Books { clusters: &clusters, ..books });
            let failed: Vec<_> = conservation.checks.iter().filter(|check| !check.holds).collect();
            assert!(
                !conservation.holds && failed.len() == 1 && failed[0].name.starts_with(name),
                "{name}: {failed:#?}"
            );
        }
    }
}
