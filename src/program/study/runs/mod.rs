//! Scenes that are traced once: the references that a figure is replayed from.

pub mod kept;
pub mod traced;

#[cfg(test)]
pub(super) mod fixture;
