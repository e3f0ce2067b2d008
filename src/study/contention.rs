//! What nodes that share a bus cost one another, simulated beside what queueing theory expects.

use serde::Serialize;

use super::conditions::Conditions;
use super::counts::ratio;
use super::published;
use super::traced::Traced;
use super::traffic::TrafficError;
use crate::machine::local_memory::Geometry;
use crate::replay::contention::{ClosedNetwork, Cycle, Load, Outcome, largest_nodes};
use crate::replay::count::Totals;
use crate::replay::setting::{Assignment, Policy, Setting};
use crate::replay::subject::Subject;
use crate::replay::timing::simulate_cluster;
use crate::replay::{Trace, parallel};
use crate::topology::{Bus, MemorySize, Processor, TileOrder};

/// The share of its time that a node should compute.
pub const EFFICIENCY: f64 = 0.9;

/// One cluster with more and more nodes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Contention {
    #[serde(flatten)]
    pub conditions: Conditions,
    #[serde(serialize_with = "super::traffic::as_text")]
    pub local_memory: MemorySize,
    /// Tiles go to the node that asks for one.
    pub assignment: Assignment,
    pub processor: Processor,
    pub bus: Bus,
    /// The cluster whose means the formulae take.
    pub formula_nodes: u16,
    pub formula: ClosedNetwork,
    /// N*.
    pub knee: f64,
    pub nodes: Vec<Nodes>,
    /// The largest number of nodes, of those simulated, up to which all compute [`EFFICIENCY`] of their time.
    pub efficient_simulated: Option<u16>,
    /// Of all numbers.
    pub efficient_exponential: Option<u16>,
    pub efficient_fixed: Option<u16>,
}

/// One number of nodes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Nodes {
    pub nodes: u16,
    pub cycles: Cycle,
    /// Over one node.
    pub speed_up: f64,
    /// Share of compute in compute and stall.
    pub efficiency: f64,
    pub utilisation: f64,
    pub wait_mean_cycles: f64,
    pub wait_percentile_99_cycles: Cycle,
    pub misses_per_access: f64,
    /// Exponential service times.
    pub exponential: Load,
    /// Service times that are all the same.
    pub fixed: Load,
}

/// A cluster on buses of another width.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Width {
    #[serde(flatten)]
    pub conditions: Conditions,
    /// Bytes a word.
    pub bus_width: u32,
    pub nodes: u16,
    pub efficiency: f64,
    pub utilisation: f64,
    pub knee: f64,
    pub efficient_fixed: Option<u16>,
}

/// What is simulated: lines, nodes, bytes of a bus word.
#[derive(Clone, Copy)]
struct Cluster {
    line: u32,
    nodes: u16,
    width: u32,
}

/// Simulates a memory of `size` with each line and number of nodes, of which `formula_nodes` is one.
///
/// # Errors
/// The trace cannot be read, or the memory is too small.
pub fn contentions<T: Trace>(
    traced: &Traced<T>,
    size: MemorySize,
    lines: &[u32],
    nodes: &[u16],
    formula_nodes: u16,
) -> Result<Vec<Contention>, TrafficError> {
    let width = traced.bus.width;
    let clusters: Vec<Cluster> =
        lines.iter().flat_map(|&line| nodes.iter().map(move |&nodes| Cluster { line, nodes, width })).collect();
    let simulated = parallel::map(&clusters, |&cluster| simulate(traced, size, cluster));
    let simulated = simulated.into_iter().collect::<Result<Vec<_>, _>>()?;
    let of_line = |(i, &line): (usize, &u32)| {
        let outcomes: Vec<_> = nodes.iter().copied().zip(&simulated[i * nodes.len()..]).collect();
        Contention::new(traced, size, line, &outcomes, formula_nodes)
    };
    Ok(lines.iter().enumerate().filter_map(of_line).collect())
}

/// The same cluster on buses of several widths.
///
/// # Errors
/// As for [`contentions`].
pub fn widths<T: Trace>(
    traced: &Traced<T>,
    size: MemorySize,
    lines: &[u32],
    nodes: u16,
    widths: &[u32],
) -> Result<Vec<Width>, TrafficError> {
    let clusters: Vec<Cluster> =
        lines.iter().flat_map(|&line| widths.iter().map(move |&width| Cluster { line, nodes, width })).collect();
    let found = parallel::map(&clusters, |&cluster| {
        let (outcome, _) = simulate(traced, size, cluster)?;
        Ok(ClosedNetwork::of(&outcome).map(|formula| Width {
            conditions: Conditions::new(traced, cluster.line, TileOrder::Scanline),
            bus_width: cluster.width,
            nodes,
            efficiency: outcome.efficiency,
            utilisation: outcome.utilisation,
            knee: formula.knee(),
            efficient_fixed: efficient(&formula.fixed_service(NODES_MAX)),
        }))
    });
    found.into_iter().filter_map(Result::transpose).collect()
}

/// As many nodes as a topology may have.
const NODES_MAX: u16 = 256;

fn simulate<T: Trace>(
    traced: &Traced<T>,
    size: MemorySize,
    cluster: Cluster,
) -> Result<(Outcome, Totals), TrafficError> {
    let setting = Setting {
        local_memory: size,
        line: cluster.line,
        ways: None,
        replacement: Policy::Lru,
        nodes: cluster.nodes,
        clusters: 1,
        tile_order: TileOrder::Scanline,
        assignment: Assignment::OnDemand,
        bus_width: cluster.width,
        arbiter: traced.bus.arbiter,
    };
    let geometry = Geometry::of_image(&setting.memory(), traced.image_bytes())?;
    Ok(simulate_cluster(traced, &setting, geometry, 0, &mut (), |_| {})?)
}

impl Contention {
    /// `None` where nothing crossed the bus.
    fn new<T>(
        traced: &Traced<T>,
        size: MemorySize,
        line: u32,
        outcomes: &[(u16, &(Outcome, Totals))],
        formula_nodes: u16,
    ) -> Option<Self> {
        let of = |wanted: u16| outcomes.iter().find(|(nodes, _)| *nodes == wanted).map(|(_, (outcome, _))| outcome);
        let formula = ClosedNetwork::of(of(formula_nodes)?)?;
        let (exponential, fixed) = (formula.exponential_service(NODES_MAX), formula.fixed_service(NODES_MAX));
        let alone = of(1)?.cycles as f64;
        let row = |&(nodes, (outcome, totals)): &(u16, &(Outcome, Totals))| Nodes {
            nodes,
            cycles: outcome.cycles,
            speed_up: alone / (outcome.cycles as f64).max(1.0),
            efficiency: outcome.efficiency,
            utilisation: outcome.utilisation,
            wait_mean_cycles: outcome.wait_mean_cycles,
            wait_percentile_99_cycles: outcome.wait_percentile_99_cycles,
            misses_per_access: ratio(totals.record_misses, totals.record_accesses),
            exponential: exponential[usize::from(nodes) - 1],
            fixed: fixed[usize::from(nodes) - 1],
        };
        let nodes: Vec<Nodes> = outcomes.iter().map(row).collect();
        Some(Self {
            conditions: Conditions::new(traced, line, TileOrder::Scanline),
            local_memory: size,
            assignment: Assignment::OnDemand,
            processor: traced.processor,
            bus: traced.bus,
            formula_nodes,
            formula,
            knee: formula.knee(),
            efficient_simulated: largest_nodes(nodes.iter().map(|row| (row.nodes, row.efficiency)), EFFICIENCY),
            efficient_exponential: efficient(&exponential),
            efficient_fixed: efficient(&fixed),
            nodes,
        })
    }

    /// The saturation bound for the formula's cluster: 1 / p.
    pub fn saturation(&self) -> Option<f64> {
        let row = self.nodes.iter().find(|row| row.nodes == self.formula_nodes)?;
        Some(crate::replay::contention::saturation_nodes(row.misses_per_access))
    }
}

fn efficient(loads: &[Load]) -> Option<u16> {
    largest_nodes(loads.iter().map(|load| (load.nodes, load.efficiency)), EFFICIENCY)
}

/// The smallest memory of Table 1.
pub const SMALLEST: MemorySize = published::share(32);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::sample;

    #[test]
    fn more_nodes_are_faster_and_less_efficient_and_the_formula_knows() {
        let (_, traced) = sample::gears();
        let found = contentions(&traced, published::share(8), &[16, 64], &[1, 2, 4], 2).expect("in memory");
        assert_eq!(found.len(), 2);
        for contention in &found {
            let [one, two, four] = &contention.nodes[..] else { panic!("three rows") };
            assert_eq!((one.speed_up, one.wait_mean_cycles), (1.0, 0.0));
            assert!(one.speed_up < two.speed_up && two.speed_up < four.speed_up && four.speed_up <= 4.0);
            assert!(one.utilisation < two.utilisation && two.utilisation < four.utilisation);
            assert!(four.efficiency < one.efficiency);
            // Of the cluster that the formula's means are those of.
            assert!((two.fixed.utilisation / two.utilisation - 1.0).abs() < 0.1, "{contention:?}");
            assert!(contention.knee > 1.0);
        }
    }

    #[test]
    fn a_wider_bus_has_its_knee_farther_out() {
        let (_, traced) = sample::gears();
        let found = widths(&traced, published::share(8), &[64], 4, &[4, 32]).expect("in memory");
        assert!(found[0].knee < found[1].knee && found[0].efficiency < found[1].efficiency);
    }
}
