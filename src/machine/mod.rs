//! What the paper proposes as hardware. Pure: no sockets, no clock, no entropy.

pub mod stats;
