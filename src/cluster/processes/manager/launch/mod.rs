//! Processes: their programs, how they are started on a host or joined from one, and how they end.

pub(super) mod children;
mod lifecycle;
pub(super) mod programs;
pub(super) mod slots;
