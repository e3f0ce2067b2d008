//! How long the bus and the memory behind it take.

use super::Cycle;
use crate::hardware::specification::{Bus, Transactions};

/// The times of a transaction of B bytes: a word for the address, the latency of the memory, then ⌈B / width⌉ words of
/// data. Fetches and messages cost the same: a message is modelled as if it was answered.
///
/// A locked transaction holds the bus for all of that. A split one holds it for the address and, granted anew, for the
/// data; in between, the memory works for any number of nodes at a time (it is pipelined, and its accesses overlap).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Service {
    width: u64,
    cycles_per_word: Cycle,
    latency: Cycle,
    transactions: Transactions,
}

impl Service {
    pub fn new(bus: &Bus) -> Self {
        Self {
            width: bus.width.into(),
            cycles_per_word: bus.cycles_per_word.into(),
            latency: bus.latency.into(),
            transactions: bus.transactions,
        }
    }

    pub fn is_split(&self) -> bool {
        self.transactions == Transactions::Split
    }

    pub fn address_cycles(&self) -> Cycle {
        self.cycles_per_word
    }

    pub fn latency_cycles(&self) -> Cycle {
        self.latency
    }

    pub fn data_cycles(&self, bytes: u32) -> Cycle {
        u64::from(bytes).div_ceil(self.width) * self.cycles_per_word
    }

    /// From the grant to the last word, when no other request uses the bus.
    pub fn unloaded_cycles(&self, bytes: u32) -> Cycle {
        self.address_cycles() + self.latency + self.data_cycles(bytes)
    }
}
