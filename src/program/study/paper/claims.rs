//! What the paper claims besides its figures: that the load is balanced and no process a bottleneck (section 7), what the octree's
//! build takes (2.2), and what HERO saves (2.1).

use serde::Serialize;

use crate::study::figures::traffic::TrafficError;
use crate::study::published;
use crate::study::runs::kept::Kept;
use crate::study::runs::traced::Traced;
use machine::hardware::local_memory::Geometry;
use machine::hardware::references::{Event, ReferenceWord};
use machine::hardware::transaction::Kind;
use machine::replay::contention::timing::simulate_cluster;
use machine::replay::contention::{Cycle, Hold, Observer, Request};
use machine::replay::model::counts::ratio;
use machine::replay::model::detail::Classes;
use machine::replay::plan::setting::{Assignment, Policy, Setting};
use machine::replay::{Trace, TraceError, parallel};
use machine::tile_order::TileOrder;
use trace::database::Section;
use trace::database::records::{LeafEntry, OctreeNode, OctreeWord};
use trace::database::verify::Verified;

/// Nodes of a cluster.
const NODES: [u16; 3] = [4, 9, published::PROCESSORS as u16];

/// One scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Claims {
    pub scene: String,
    pub by_nodes: Vec<Balance>,
    /// Nodes of the octree that HERO reads per ray, and steps to a parent that the common-ancestor technique takes besides: HERO pops
    /// the parent from a stack.
    pub nodes_read_per_ray: f64,
    pub ascents_per_ray: f64,
}

/// One number of nodes, tiles on demand, at 1/32, lines of 16.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Balance {
    pub nodes: u16,
    /// Share of all cycles in which a node computes: the mean.
    pub busy: f64,
    /// Of the busiest node over that.
    pub busiest_over_mean: f64,
    /// Share of all cycles in which the bus is held for the master's jobs, for pixels on their way to the display, and for fetches.
    pub jobs: f64,
    pub pixels: f64,
    pub fetches: f64,
    /// What one processor's build of the octree is of the time until the image is done, if the nodes wait for it.
    pub build: f64,
}

impl Claims {
    pub(super) fn new(traced: &Traced<Kept>, database: &Verified) -> Result<Self, TrafficError> {
        let build = build_tests(database) * u64::from(traced.run.processor.primitive_test);
        let balances = parallel::map(&NODES, |&nodes| Balance::new(traced, nodes, build));
        let (reads, ascents) = steps(traced, database)?;
        let rays: u64 = traced.rays.iter().sum();
        Ok(Self {
            scene: traced.run.scene.clone(),
            by_nodes: balances.into_iter().collect::<Result<_, _>>()?,
            nodes_read_per_ray: ratio(reads, rays),
            ascents_per_ray: ratio(ascents, rays),
        })
    }
}

impl Balance {
    fn new(traced: &Traced<Kept>, nodes: u16, build: Cycle) -> Result<Self, TrafficError> {
        let setting = Setting {
            local_memory: published::share(32),
            line: 16,
            ways: None,
            replacement: Policy::Lru,
            nodes,
            clusters: 1,
            tile_order: TileOrder::Scanline,
            assignment: Assignment::OnDemand,
            bus: traced.run.bus,
            processor: traced.run.processor,
        };
        let geometry = Geometry::new(&setting.memory(), &traced.layout)?;
        let mut holds = Holds::default();
        let (outcome, _) = simulate_cluster(traced, &setting, geometry, 0, &mut holds, |_| {})?;
        let share = |cycles: Cycle| ratio(cycles, outcome.cycles);
        let busiest = outcome.nodes.iter().map(|node| node.compute_cycles).max().unwrap_or(0);
        let mean = outcome.compute_cycles as f64 / f64::from(nodes);
        Ok(Self {
            nodes,
            busy: mean / outcome.cycles.max(1) as f64,
            busiest_over_mean: busiest as f64 / mean.max(1.0),
            jobs: share(holds.jobs),
            pixels: share(holds.pixels),
            fetches: share(holds.fetches),
            build: ratio(build, build + outcome.cycles),
        })
    }
}

/// For what the bus was held.
#[derive(Default)]
struct Holds {
    jobs: Cycle,
    pixels: Cycle,
    fetches: Cycle,
}

impl Observer for Holds {
    fn released(&mut self, request: &Request, hold: Hold) {
        let cycles = match request.kind {
            Kind::Job => &mut self.jobs,
            Kind::Pixels => &mut self.pixels,
            _ => &mut self.fetches,
        };
        *cycles += hold.until - hold.from;
    }
}

/// Tests of a primitive against a cell's eight octants: one for each primitive of each cell that is divided. These are those that
/// the leaves below it list.
fn build_tests(database: &Verified) -> u64 {
    let words: &[OctreeWord] = database.unpadded().records(Section::OctreeNodes);
    let entries: &[LeafEntry] = database.unpadded().records(Section::LeafLists);
    tests_below(words, entries, words[0], &mut Vec::new())
}

/// Puts the cell's primitives into `primitives`, each once.
fn tests_below(words: &[OctreeWord], entries: &[LeafEntry], word: OctreeWord, primitives: &mut Vec<u32>) -> u64 {
    match word.decode() {
        Some(OctreeNode::Leaf(first)) => {
            let list = entries[first as usize..].iter();
            let end = list.clone().position(|entry| entry.is_last()).map_or(0, |last| last + 1);
            primitives.extend(list.take(end).map(|entry| entry.primitive().0));
            0
        }
        Some(OctreeNode::Branch(block)) => {
            let (mut tests, mut of_cell) = (0, Vec::new());
            for &child in &words[block as usize * 8..][..8] {
                tests += tests_below(words, entries, child, &mut of_cell);
            }
            of_cell.sort_unstable();
            of_cell.dedup();
            tests += of_cell.len() as u64;
            primitives.append(&mut of_cell);
            tests
        }
        Some(OctreeNode::EmptyLeaf) | None => 0,
    }
}

/// Octree nodes that were read, and how often a ray went on from a node to one that is not its child: as many ascents as there are
/// levels up to their common parent.
fn steps(traced: &Traced<Kept>, database: &Verified) -> Result<(u64, u64), TraceError> {
    let levels = machine::recording::references::octree_levels(database);
    let classes = Classes::new(&traced.layout, &levels);
    let chunks: Vec<_> = traced.tiles().chunks(64).collect();
    let counted = parallel::map(&chunks, |tiles| {
        let (mut reads, mut ascents, mut words) = (0, 0, Vec::new());
        for part in tiles.iter().flat_map(|tile| tile.parts.clone()) {
            traced.read(part, &mut words)?;
            let mut before = None;
            for event in words.iter().filter_map(|&word| ReferenceWord(word).decode()) {
                match event {
                    Event::Ray(_) => before = None,
                    Event::Write(_)
                    | Event::CopyBack(_)
                    | Event::Invalidate(_)
                    | Event::CopyBackAll
                    | Event::InvalidateAll => {}
                    Event::Read(record) => {
                        let (section, index) = classes.place(record);
                        if section == Section::OctreeNodes {
                            let level = classes.level(index);
                            reads += 1;
                            ascents += u64::from(before.map_or(0, |before: u32| (before + 1).saturating_sub(level)));
                            before = Some(level);
                        }
                    }
                }
            }
        }
        Ok::<_, TraceError>((reads, ascents))
    });
    counted
        .into_iter()
        .try_fold((0, 0), |sum, counted| counted.map(|(reads, ascents)| (sum.0 + reads, sum.1 + ascents)))
}
