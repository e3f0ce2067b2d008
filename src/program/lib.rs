//! What a person starts: the commands, and the studies.

pub mod cli;
pub mod study;
