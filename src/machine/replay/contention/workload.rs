//! What nodes do between and on the bus.

use super::Cycle;
use crate::hardware::transaction::Kind;
use ground::ids::NodeId;

/// A node computes, then uses the bus or does not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Burst {
    /// Before the transaction; may be 0.
    pub compute_cycles: Cycle,
    /// What the node waits for then. `None`: it goes on with its next burst at once.
    pub transaction: Option<Transaction>,
}

/// What a node asks of the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Transaction {
    /// [`Kind::Fetch`] for lines of the database; [`Kind::Job`] and [`Kind::Pixels`] are messages.
    pub kind: Kind,
    /// That cross the bus as data.
    pub bytes: u32,
}

/// What all nodes do, given on demand and in the order of simulated time.
///
/// One workload serves all nodes, so that what they share (a queue of tiles, say) is a field of it:
///
/// - Node by node from 0, each is asked at cycle 0 what it does first. It is asked again when it has computed and, if
///   there was a transaction, has its answer. Nodes that are asked in the same cycle are asked in an order that depends
///   on nothing but what went before, so that the same workload gives the same outcome.
/// - `now` never goes back from call to call, of whichever node.
/// - After `None`, a node is not asked again: it stays idle until the last one ends. A node that has to wait for
///   others computes instead; there is no other way to let time pass.
/// - A burst of no cycles and no transaction is allowed, but there must be an end to them.
/// - A miss is known only when the local memory was asked, and the local memory is the workload's own: replay reads
///   until the first miss, return the cycles of all of them ([`ReadCycles`](super::ReadCycles), the missed record's
///   included) with its fetch. What was counted between two calls was computed between their two `now`s.
///
/// A closure `FnMut(NodeId, Cycle) -> Result<Option<Burst>, E>` is a workload.
pub trait Workload {
    type Error;

    /// What `node` does next; `now` is when it is done with what it did before. `None`: it is done with everything.
    ///
    /// # Errors
    /// The workload's own. The simulation ends with it.
    fn next(&mut self, node: NodeId, now: Cycle) -> Result<Option<Burst>, Self::Error>;
}

impl<F: FnMut(NodeId, Cycle) -> Result<Option<Burst>, E>, E> Workload for F {
    type Error = E;

    fn next(&mut self, node: NodeId, now: Cycle) -> Result<Option<Burst>, E> {
        self(node, now)
    }
}
