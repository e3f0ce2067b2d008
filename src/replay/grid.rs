//! Lists of values → every combination of them, as settings that can be.

use super::setting::{Assignment, Policy, Setting};
use crate::machine::specification::{Arbiter, MemorySize};
use crate::tile_order::TileOrder;

/// More combinations than this are a slip of the keyboard.
pub const SETTINGS_MAX: usize = 100_000;

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
}

impl Grid {
    /// Every combination, the last list varying fastest.
    ///
    /// # Errors
    /// There are too many, or one cannot be: the recorded assignment with another number of nodes.
    pub fn settings(&self, recorded: Setting) -> Result<Vec<Setting>, String> {
        let Self { local_memory, line, ways, replacement, nodes, clusters, tile_order, bus_width, arbiter, .. } = self;
        let lengths = [
            local_memory.len(),
            line.len(),
            ways.len(),
            replacement.len(),
            nodes.len(),
            clusters.len(),
            tile_order.len(),
            self.assignment.len(),
            bus_width.len(),
            arbiter.len(),
        ];
        let count = lengths.iter().fold(1usize, |product, &length| product.saturating_mul(length.max(1)));
        if count > SETTINGS_MAX {
            return Err(format!("{count} combinations, expected at most {SETTINGS_MAX}"));
        }
        let mut settings = vec![recorded];
        vary(&mut settings, local_memory, |setting, value| setting.local_memory = value);
        vary(&mut settings, line, |setting, value| setting.line = value);
        vary(&mut settings, ways, |setting, value| setting.ways = value);
        vary(&mut settings, replacement, |setting, value| setting.replacement = value);
        vary(&mut settings, nodes, |setting, value| setting.nodes = value);
        vary(&mut settings, clusters, |setting, value| setting.clusters = value);
        vary(&mut settings, tile_order, |setting, value| setting.tile_order = value);
        vary(&mut settings, &self.assignment, |setting, value| setting.assignment = value);
        vary(&mut settings, bus_width, |setting, value| setting.bus_width = value);
        vary(&mut settings, arbiter, |setting, value| setting.arbiter = value);
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

fn vary<T: Copy>(settings: &mut Vec<Setting>, values: &[T], set: impl Fn(&mut Setting, T)) {
    if values.is_empty() {
        return;
    }
    let each = |setting: &Setting| -> Vec<Setting> {
        let with = |&value| {
            let mut setting = *setting;
            set(&mut setting, value);
            setting
        };
        values.iter().map(with).collect()
    };
    *settings = settings.iter().flat_map(each).collect();
}

#[cfg(test)]
mod tests {
    use super::*;

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
            bus_width: 4,
            arbiter: Arbiter::Fifo,
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
    }
}
