//! Studies: scenes traced once, then replayed through many clusters. [`paper`] is what the paper publishes beside what
//! this program finds; [`sweep`] the same for a scene of one's own.

pub mod charts;
pub mod conditions;
pub mod contention;
pub mod counts;
pub mod kept;
pub mod levels;
pub mod page;
pub mod paper;
pub mod plot;
pub mod published;
pub mod sweep;
pub mod table;
pub mod traced;
pub mod traffic;

#[cfg(test)]
mod sample;
