//! Recordings of references, replayed: what other memories, node counts and buses would have made of them.
//!
//! A [`Trace`] is what was recorded, tile by tile; [`stream`] is what is read, [`plan`] the machines that it is put
//! through; [`model`] counts, [`contention`] has the times, [`origin`] where misses come from.

pub mod contention;
pub mod exporters;
pub mod importers;
pub mod model;
pub mod origin;
pub mod parallel;
pub mod plan;
pub mod stream;

pub use crate::hardware::trace::{Trace, TraceError, TracedTile};
pub use model::replayer::Tally;
pub use model::{evaluation, replayer};
pub use plan::setting;
pub use stream::captured::Captured;
pub use stream::lines::{Lines, RecordLines};

#[cfg(test)]
mod tests;
