//! First come, first served.

use super::{Arbiter, Waiting};
use crate::hardware::transaction::Initiator;

/// Grants the request that arrived first.
///
/// No initiator starves: with queues of at most q requests and n initiators, a request waits for at most
/// n · q transactions. An initiator that asks more often gets more of the bus.
#[derive(Debug)]
pub struct Fifo;

impl Arbiter for Fifo {
    fn grant(&mut self, waiting: &[Waiting]) -> Option<Initiator> {
        waiting.iter().min_by_key(|w| w.arrival).map(|w| w.initiator)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{LOADER, MASTER, N0, N1, N2, order};
    use super::*;

    #[test]
    fn the_longest_waiting_goes_first_whoever_it_is() {
        let arrivals = [N2, N0, N0, MASTER, N2, LOADER, N1];
        assert_eq!(order(&mut Fifo, &arrivals), arrivals);
    }
}
