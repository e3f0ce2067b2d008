//! What nodes that share a bus cost one another, in cycles. Pure and synchronous: time is what the simulation says.
//!
//! A [`Workload`] says what each node does: it computes for so many cycles ([`ReadCycles`]), then asks for the bus and
//! waits for its answer ([`Service`]), and so on. [`simulate`] plays all nodes against one bus, reports each step to an
//! [`Observer`] and ends with an [`Outcome`]; [`ClosedNetwork`] says what queueing theory expects of the same figures.

mod closed_network;
mod cost;
mod observer;
mod outcome;
mod service;
mod settings;
mod simulation;
pub mod table;
#[cfg(test)]
mod tests;
pub mod timing;
mod waits;
pub mod work;
mod workload;

pub use closed_network::{ClosedNetwork, Load, largest_nodes, saturation_nodes};
pub use cost::ReadCycles;
pub use observer::{Hold, Observer, Phase, Request};
pub use outcome::{NodeOutcome, Outcome};
pub use service::Service;
pub use settings::ContentionSettings;
pub use simulation::simulate;
pub use workload::{Burst, Transaction, Workload};

/// A time since the beginning, or a span of it, in cycles of the processors and of the bus, which share a clock.
pub type Cycle = u64;
