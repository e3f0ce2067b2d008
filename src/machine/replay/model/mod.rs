//! What local memories would have counted: each simulated, all sizes at once, and the best that can be.

pub mod counts;
pub mod curve;
pub mod detail;
pub mod evaluation;
pub mod live;
pub mod miss_classes;
pub mod next_use;
pub mod node;
pub mod objects;
pub mod optimal;
pub mod recount;
pub mod replayer;
pub mod stack_distance;
pub mod writes;
