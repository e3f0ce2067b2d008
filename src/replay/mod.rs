//! Recordings of references, replayed: what other memories, node counts and buses would have made of them.
//!
//! A [`Trace`] is what was recorded, tile by tile; [`lines`] tells which lines a record lies in.

pub mod captured;
pub mod contention;
pub mod contention_table;
pub mod count;
pub mod counts;
pub mod curve;
pub mod detail;
pub mod evaluation;
pub mod exporters;
pub mod grid;
pub mod heat_map;
pub mod importers;
pub mod lines;
pub mod live;
pub mod miss_classes;
pub mod next_use;
pub mod node;
pub mod optimal;
pub mod origins;
pub mod parallel;
pub mod pixels;
pub mod reads;
pub mod schedule;
pub mod setting;
pub mod stack_distance;
pub mod subject;
pub mod timing;
pub mod verify;
pub mod work;

pub use crate::machine::trace::{Trace, TraceError, TracedTile};
pub use captured::Captured;
pub use count::Tally;
pub use lines::{Lines, RecordLines};

#[cfg(test)]
mod tests;
