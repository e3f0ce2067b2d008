//! What is found: one figure or table a file, and the conditions beside each.

pub mod conditions;
pub mod contention;
pub mod levels;
pub mod ratio;
pub mod traffic;
