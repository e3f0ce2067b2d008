//! The octree ray tracer. Pure: no sockets, no clock, no entropy; every read of the database goes
//! through a [`MemoryPort`].

pub mod bvh8;
pub mod hit;
pub mod memory_port;
pub mod octree;
pub mod optics;
pub mod power;
pub mod primary;
pub mod primitives;
pub mod ray;
pub mod shade;
pub mod simd;
pub mod slices;
pub mod stats;
pub mod tile;
pub mod vector;
pub mod view;

pub use memory_port::{MemoryPort, RayKind};
pub use stats::TraceStats;
pub use tile::TileTracer;
pub use view::View;
