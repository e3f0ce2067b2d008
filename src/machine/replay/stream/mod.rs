//! What is replayed: traces, of a recording or of here and now, and the lines that their records lie in.

pub mod captured;
pub mod lines;
pub mod placement;
pub mod reads;
pub mod subject;
