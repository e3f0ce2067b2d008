//! Each in turn.

use super::{Arbiter, Waiting};
use crate::hardware::transaction::Initiator;

/// Goes round the initiators in ascending order; each may hold the bus for up to `quantum` transactions
/// before its turn passes, at once when it has no more to ask.
///
/// No initiator starves: one whose request is the oldest of its own waits for at most
/// (n − 1) · `quantum` transactions of the n − 1 others.
#[derive(Debug)]
pub struct RoundRobin {
    quantum: u32,
    holder: Option<Initiator>,
    /// Transactions that the holder may still have in this turn.
    left: u32,
}

impl RoundRobin {
    /// `quantum` is 1 to 1024; 0 counts as 1.
    pub fn new(quantum: u32) -> Self {
        Self { quantum: quantum.max(1), holder: None, left: 0 }
    }
}

impl Arbiter for RoundRobin {
    fn grant(&mut self, waiting: &[Waiting]) -> Option<Initiator> {
        let mut ascending = waiting.iter().map(|w| w.initiator);
        let held = self.holder.filter(|&holder| self.left > 0 && ascending.clone().any(|i| i == holder));
        if held.is_none() {
            let next = ascending.clone().find(|&i| Some(i) > self.holder).or_else(|| ascending.next())?;
            self.holder = Some(next);
            self.left = self.quantum;
        }
        self.left -= 1;
        self.holder
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{LOADER, MASTER, N0, N1, N2, order};
    use super::*;

    #[test]
    fn with_quantum_1_all_take_turns() {
        let arrivals = [N2, N2, N2, N0, N0, MASTER, N1, LOADER];
        assert_eq!(order(&mut RoundRobin::new(1), &arrivals), [LOADER, MASTER, N0, N1, N2, N0, N2, N2]);
    }

    #[test]
    fn with_quantum_2_each_has_two_in_a_row() {
        let arrivals = [N2, N2, N2, N0, N0, N0, N1];
        assert_eq!(order(&mut RoundRobin::new(2), &arrivals), [N0, N0, N1, N2, N2, N0, N2]);
    }

    #[test]
    fn a_turn_passes_when_the_holder_does_not_ask() {
        let mut arbiter = RoundRobin::new(3);
        let waiting = |initiators: &[Initiator]| {
            initiators.iter().map(|&initiator| Waiting { initiator, arrival: 0 }).collect::<Vec<_>>()
        };
        assert_eq!(arbiter.grant(&waiting(&[N0, N1])), Some(N0));
        assert_eq!(arbiter.grant(&waiting(&[N1])), Some(N1));
        // Node 0 comes back too late for the rest of its turn.
        assert_eq!(arbiter.grant(&waiting(&[N0, N1])), Some(N1));
        assert_eq!(arbiter.grant(&waiting(&[N0, N1])), Some(N1));
        assert_eq!(arbiter.grant(&waiting(&[N0, N1])), Some(N0));
        assert_eq!(arbiter.grant(&[]), None);
    }

    #[test]
    fn nobody_waits_longer_than_the_others_quanta() {
        let mut arbiter = RoundRobin::new(4);
        let all = [N0, N1, N2].map(|initiator| Waiting { initiator, arrival: 0 });
        let grants: Vec<_> = (0..60).filter_map(|_| arbiter.grant(&all)).collect();
        assert!(grants.windows(9).all(|w| w.contains(&N2)), "{grants:?}");
    }
}
