//! Recordings of references, replayed: what other memories, node counts and buses would have made of them.
//!
//! A [`Trace`] is what was recorded, tile by tile; [`lines`] tells which lines a record lies in.

pub mod captured;
pub mod count;
pub mod curve;
pub mod detail;
pub mod lines;
pub mod live;
pub mod parallel;
pub mod reads;
pub mod schedule;
pub mod stack_distance;

pub use crate::machine::trace::{Trace, TraceError, TracedTile};
pub use captured::Captured;
pub use lines::{Lines, RecordLines};
