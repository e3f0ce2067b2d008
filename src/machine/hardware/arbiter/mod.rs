//! Who is granted the bus when several wait.

mod fifo;
mod fixed_priority;
mod round_robin;

pub use fifo::Fifo;
pub use fixed_priority::FixedPriority;
pub use round_robin::RoundRobin;

use super::transaction::Initiator;
use crate::hardware::specification;

/// The oldest request of an initiator that waits for the bus.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Waiting {
    pub initiator: Initiator,
    /// The number of the request, in the order in which the bus received all of them.
    pub arrival: u64,
}

/// A rule of arbitration, asked once a transaction.
pub trait Arbiter: Send {
    /// The initiator that is granted the bus next. `waiting` has at most one entry an initiator, in
    /// ascending order of initiators; `None` if it is empty.
    fn grant(&mut self, waiting: &[Waiting]) -> Option<Initiator>;
}

/// The arbiter that a topology names.
pub fn new(arbiter: specification::Arbiter) -> Box<dyn Arbiter> {
    match arbiter {
        specification::Arbiter::Fifo => Box::new(Fifo),
        specification::Arbiter::RoundRobin { quantum } => Box::new(RoundRobin::new(quantum)),
        specification::Arbiter::FixedPriority => Box::new(FixedPriority),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ground::ids::NodeId;

    pub(super) const LOADER: Initiator = Initiator::Loader;
    pub(super) const MASTER: Initiator = Initiator::Master;
    pub(super) const N0: Initiator = Initiator::Node(NodeId(0));
    pub(super) const N1: Initiator = Initiator::Node(NodeId(1));
    pub(super) const N2: Initiator = Initiator::Node(NodeId(2));

    /// Grants requests that all wait from the beginning, until none is left.
    pub(super) fn order(arbiter: &mut dyn Arbiter, arrivals: &[Initiator]) -> Vec<Initiator> {
        let mut pending: Vec<Waiting> =
            (0..).zip(arrivals).map(|(arrival, &initiator)| Waiting { initiator, arrival }).collect();
        pending.sort_by_key(|w| (w.initiator, w.arrival));
        let mut granted = Vec::new();
        loop {
            let mut heads = pending.clone();
            heads.dedup_by_key(|w| w.initiator);
            let Some(initiator) = arbiter.grant(&heads) else { return granted };
            let first = pending.iter().position(|w| w.initiator == initiator).expect("granted, so it waits");
            pending.remove(first);
            granted.push(initiator);
        }
    }

    #[test]
    fn a_topology_names_each() {
        let waiting = [Waiting { initiator: N0, arrival: 1 }, Waiting { initiator: N1, arrival: 0 }];
        for (named, first_two) in [
            (specification::Arbiter::Fifo, [N1, N1]),
            (specification::Arbiter::RoundRobin { quantum: 1 }, [N0, N1]),
            (specification::Arbiter::FixedPriority, [N0, N0]),
        ] {
            let mut arbiter = new(named);
            assert_eq!([arbiter.grant(&waiting), arbiter.grant(&waiting)], first_two.map(Some), "{named:?}");
        }
    }
}
