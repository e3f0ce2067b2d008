//! The lowest number first.

use super::{Arbiter, Waiting};
use crate::hardware::transaction::Initiator;

/// Grants the first in the order of [`Initiator`]: the loader, the master, then the lowest node id.
///
/// Starvation is possible: a node waits as long as those before it keep the bus busy. In marti a node has
/// one fetch under way at most, so this happens only when the nodes before it ask faster than the bus serves.
#[derive(Debug)]
pub struct FixedPriority;

impl Arbiter for FixedPriority {
    fn grant(&mut self, waiting: &[Waiting]) -> Option<Initiator> {
        waiting.iter().map(|w| w.initiator).min()
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{LOADER, MASTER, N0, N1, N2, order};
    use super::*;

    #[test]
    fn the_lowest_node_goes_first_after_loader_and_master() {
        let arrivals = [N2, N0, N0, MASTER, N2, LOADER, N1];
        assert_eq!(order(&mut FixedPriority, &arrivals), [LOADER, MASTER, N0, N0, N1, N2, N2]);
    }

    #[test]
    fn a_busy_node_0_starves_node_1() {
        let waiting = |arrival| [Waiting { initiator: N0, arrival }, Waiting { initiator: N1, arrival: 0 }];
        assert!((1..1000).all(|arrival| FixedPriority.grant(&waiting(arrival)) == Some(N0)));
    }
}
