//! What a trace is put through: settings of a machine, and which node traces what.

pub mod grid;
pub mod schedule;
pub mod setting;
