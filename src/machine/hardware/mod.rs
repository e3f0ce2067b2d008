//! What the paper proposes as hardware. Pure: no sockets, no clock, no entropy.
//!
//! A node reads through its [`local_memory`], whose victims a [`replacement`] policy chooses. What is
//! missing there crosses the [`bus`], granted by an [`arbiter`], out of the [`cluster_memory`].

pub mod arbiter;
pub mod bus;
pub mod cluster_memory;
pub mod local_memory;
pub mod references;
pub mod replacement;
pub mod specification;
pub mod stats;
pub mod totals;
pub mod trace;
pub mod transaction;
