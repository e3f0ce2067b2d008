//! Lists of values → every combination of them, as settings that can be.

use crate::hardware::specification::{Arbiter, MemorySize, Transactions};
use crate::replay::plan::setting::{Assignment, Policy, Setting};
use crate::tile_order::TileOrder;

/// More combinations than this are a slip of the keyboard.
pub const SETTINGS_MAX: usize = 100_000;

/// Nodes of all combinations together: each has a list of its tiles.
const NODES_MAX: u64 = 2_000_000;

/// What is varied; an empty list stands for the recorded value.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Grid {
    pub local_memory: Vec<MemorySize>,
    pub line: Vec<u32>,
    /// `None`: fully associative.
    pub ways: Vec<Option<u32>>,
    pub replacement: Vec<Policy>,
    pub nodes: Vec<u16>,
    pub clusters: Vec<u16>,
    pub tile_order: Vec<TileOrder>,
    /// Empty: recorded where that can be, else interleaved.
    pub assignment: Vec<Assignment>,
    pub bus_width: Vec<u32>,
    pub arbiter: Vec<Arbiter>,
    pub transactions: Vec<Transactions>,
    pub latency: Vec<u32>,
    pub cycles_per_word: Vec<u32>,
    pub octree_node: Vec<u32>,
    pub primitive_test: Vec<u32>,
    pub shading: Vec<u32>,
    pub local_access: Vec<u32>,
}

impl Grid {
    /// Every combination, the last list varying fastest.
    ///
    /// # Errors
    /// There are too many, or one cannot be: the recorded assignment with another number of nodes.
    pub fn settings(&self, recorded: Setting) -> Result<Vec<Setting>, String> {
        let axes = [
            axis(&self.local_memory, |setting, value| setting.local_memory = value),
            axis(&self.line, |setting, value| setting.line = value),
            axis(&self.ways, |setting, value| setting.ways = value),
            axis(&self.replacement, |setting, value| setting.replacement = value),
            axis(&self.nodes, |setting, value| setting.nodes = value),
            axis(&self.clusters, |setting, value| setting.clusters = value),
            axis(&self.tile_order, |setting, value| setting.tile_order = value),
            axis(&self.assignment, |setting, value| setting.assignment = value),
            axis(&self.bus_width, |setting, value| setting.bus.width = value),
            axis(&self.arbiter, |setting, value| setting.bus.arbiter = value),
            axis(&self.transactions, |setting, value| setting.bus.transactions = value),
            axis(&self.latency, |setting, value| setting.bus.latency = value),
            axis(&self.cycles_per_word, |setting, value| setting.bus.cycles_per_word = value),
            axis(&self.octree_node, |setting, value| setting.processor.octree_node = value),
            axis(&self.primitive_test, |setting, value| setting.processor.primitive_test = value),
            axis(&self.shading, |setting, value| setting.processor.shading = value),
            axis(&self.local_access, |setting, value| setting.processor.local_access = value),
        ];
        let count = axes.iter().fold(1usize, |product, axis| product.saturating_mul(axis.values.max(1)));
        if count > SETTINGS_MAX {
            return Err(format!("{count} combinations, expected at most {SETTINGS_MAX}"));
        }
        let mut settings = vec![recorded];
        for axis in axes.iter().filter(|axis| axis.values > 0) {
            let with = |setting| (0..axis.values).map(move |i| (axis.with)(setting, i));
            settings = settings.into_iter().flat_map(with).collect();
        }
        let nodes = settings.iter().map(|setting| u64::from(setting.all_nodes())).sum::<u64>();
        if nodes > NODES_MAX {
            return Err(format!("{nodes} nodes in {count} combinations, expected at most {NODES_MAX} nodes"));
        }
        for setting in &mut settings {
            let as_recorded = (setting.nodes, setting.clusters, setting.tile_order)
                == (recorded.nodes, recorded.clusters, recorded.tile_order);
            if setting.assignment == Assignment::Recorded && !as_recorded {
                if !self.assignment.is_empty() {
                    return Err(format!(
                        "the recorded assignment is that of {} clusters of {} nodes and tiles in {} order: expected \
                         interleaved or on-demand for {} clusters of {} nodes and {} order",
                        recorded.clusters,
                        recorded.nodes,
                        recorded.tile_order,
                        setting.clusters,
                        setting.nodes,
                        setting.tile_order
                    ));
                }
                setting.assignment = Assignment::Interleaved;
            }
        }
        Ok(settings)
    }
}

/// A list that is varied.
struct Axis<'a> {
    values: usize,
    /// The setting with the list's value of this number.
    with: Box<dyn Fn(Setting, usize) -> Setting + 'a>,
}

fn axis<'a, T: Copy>(values: &'a [T], set: impl Fn(&mut Setting, T) + 'a) -> Axis<'a> {
    let with = move |mut setting: Setting, i: usize| {
        set(&mut setting, values[i]);
        setting
    };
    Axis { values: values.len(), with: Box::new(with) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hardware::specification::{Bus, Processor};

    fn recorded() -> Setting {
        Setting {
            local_memory: MemorySize::Share { numerator: 1, denominator: 8 },
            line: 64,
            ways: None,
            replacement: Policy::Lru,
            nodes: 4,
            clusters: 1,
            tile_order: TileOrder::Scanline,
            assignment: Assignment::Recorded,
            bus: Bus::DEFAULT,
            processor: Processor::DEFAULT,
        }
    }

    #[test]
    fn nothing_varied_is_the_recorded_setting() {
        assert_eq!(Grid::default().settings(recorded()), Ok(vec![recorded()]));
    }

    #[test]
    fn every_combination_is_there_once() {
        let grid = Grid { line: vec![16, 32], nodes: vec![4, 9], ways: vec![None, Some(4)], ..Grid::default() };
        let settings = grid.settings(recorded()).expect("eight");
        assert_eq!(settings.len(), 8);
        for (i, one) in settings.iter().enumerate() {
            assert!(settings[..i].iter().all(|other| other != one));
            let expected = if one.nodes == 4 { Assignment::Recorded } else { Assignment::Interleaved };
            assert_eq!(one.assignment, expected);
        }
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let grid = Grid { assignment: vec![Assignment::Recorded], nodes: vec![9], ..Grid::default() };
        assert!(grid.settings(recorded()).expect_err("nine nodes").contains("recorded assignment is that of"));
        let grid = Grid { nodes: (1..=256).collect(), bus_width: vec![4; 500], ..Grid::default() };
        assert_eq!(grid.settings(recorded()), Err("128000 combinations, expected at most 100000".to_owned()));
        let grid = Grid { nodes: (1..=256).collect(), clusters: (1..=256).collect(), ..Grid::default() };
        let expected = "1082146816 nodes in 65536 combinations, expected at most 2000000 nodes";
        assert_eq!(grid.settings(recorded()), Err(expected.to_owned()));
    }
}
