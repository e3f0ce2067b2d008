//! Gets the steps of a simulation as it goes: what draws time lines.

use super::Cycle;
use crate::hardware::transaction::Kind;
use ground::ids::NodeId;

/// A transaction under way. A node has one at most.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    pub node: NodeId,
    pub kind: Kind,
    pub bytes: u32,
    /// When the node began to wait for the bus.
    pub requested: Cycle,
}

/// A time for which one node has the bus: from a cycle up to, but without, another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Hold {
    pub phase: Phase,
    pub from: Cycle,
    pub until: Cycle,
}

/// What the bus is held for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Of a locked transaction.
    Whole,
    /// Of a split transaction, before the memory's latency.
    Address,
    /// Of a split transaction, after it.
    Data,
}

/// Each call is made when simulated time has come to it: times never go back from call to call. A call of the same
/// cycle may come before or after those of other nodes.
///
/// A locked transaction is requested, granted, released, completed; a split one is granted and released twice. What
/// a node does otherwise is computing, until it is `finished`.
pub trait Observer {
    /// At `request.requested`.
    fn requested(&mut self, _request: &Request) {}

    /// At `hold.from`.
    fn granted(&mut self, _request: &Request, _hold: Hold) {}

    /// At `hold.until`.
    fn released(&mut self, _request: &Request, _hold: Hold) {}

    /// The node has its answer and goes on.
    fn completed(&mut self, _request: &Request, _now: Cycle) {}

    /// The node has nothing to do any more.
    fn finished(&mut self, _node: NodeId, _now: Cycle) {}
}

/// Nobody looks.
impl Observer for () {}
