//! The numbers that could go wrong: edges, degenerate and extreme geometry, rays that hurt. Every kernel is held
//! against the oracle, and all of them against each other bit by bit. The cases are numbered; each test says which it
//! holds.

mod degenerate;
mod edges;
mod extremes;
#[cfg(target_arch = "x86_64")]
mod floating_point;
mod generated;
mod images;
mod materials;
mod rays;
mod reference;
mod shading;
mod subjects;
mod trees;
mod watertight;
