//! marti: a multiprocessor architecture for ray tracing images, for real.
//!
//! After M-P. Hébert, M. D. J. McNeill, B. Shah, R. L. Grimsdale, P. F. Lister, *MARTI, a
//! Multiprocessor Architecture for Ray Tracing Images*, 1991. ARCHITECTURE.md has the code map.

#[cfg(target_endian = "big")]
compile_error!("the database image, the wire format and the hashes of marti are little-endian");

pub mod atomic_file;
pub mod chaos;
pub mod cli;
pub mod database;
pub mod floating_point;
pub mod ids;
pub mod image_file;
pub mod journal;
pub mod keys;
pub mod machine;
pub mod oracle;
pub mod outlet;
pub mod patient_file;
pub mod picture;
pub mod preparation;
pub mod processes;
pub mod progress;
pub mod protocol;
pub mod pulse;
pub mod recording;
pub mod regular_file;
pub mod render;
pub mod replay;
pub mod report;
pub mod scene;
pub mod secret_file;
pub mod study;
pub mod telemetry;
pub mod tile_order;
pub mod topology;
pub mod tracer;
