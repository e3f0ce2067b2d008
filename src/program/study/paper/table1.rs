//! Table 1, under one definition of its ratio.

use serde::Serialize;

use crate::study::figures::conditions::Conditions;
use crate::study::figures::ratio::Ratio;
use crate::study::figures::traffic::Traffic;
use crate::study::published;

/// One definition in one setting, by size of the local memory: [`published::TABLE_SIZES`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Table1 {
    #[serde(flatten)]
    pub conditions: Conditions,
    pub nodes: u16,
    pub ratio: Ratio,
    pub found: [f64; 4],
    pub published: [f64; 4],
    /// The largest of found / published and published / found.
    pub off_by: f64,
}

impl Table1 {
    /// By definition; empty where the sizes were not replayed.
    pub(super) fn of(traffic: &Traffic, published: [f64; 4]) -> Vec<Self> {
        let sizes = published::TABLE_SIZES.map(|size| traffic.size(size));
        let [Some(a), Some(b), Some(c), Some(d)] = sizes else { return Vec::new() };
        let row = |ratio: Ratio| {
            let found = [a, b, c, d].map(|size| size.ratio(ratio));
            let (conditions, nodes) = (traffic.conditions.clone(), traffic.nodes);
            Self { conditions, nodes, ratio, found, published, off_by: off_by(found, published) }
        };
        Ratio::ALL.map(row).to_vec()
    }
}

fn off_by(found: [f64; 4], published: [f64; 4]) -> f64 {
    found
        .iter()
        .zip(published)
        .map(|(&found, published)| (found / published).max(published / found))
        .fold(1.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cell_that_is_farthest_off_decides() {
        assert_eq!(off_by([1.0, 2.0, 3.0, 4.0], [1.0, 2.0, 3.0, 4.0]), 1.0);
        assert_eq!(off_by([1.5, 2.0, 3.0, 4.0], [1.0, 2.0, 3.0, 16.0]), 4.0);
        assert_eq!(off_by([1.0, 5.0, 1.0, 1.0], [1.0, 2.0, 1.0, 1.0]), 2.5);
    }
}
