//! What crossed the bus, kept as data: `bus.arrows`, an Arrow IPC stream, and its sidecar `bus.json`.
//!
//! docs/recording.md tells how to read them. The columns are in [`format`], files and thread in [`writer`].

pub mod format;
pub mod writer;

pub use format::{FORMAT_VERSION, Metadata};
pub use writer::{RecordingError, Sidecar, Summary, Writer};
