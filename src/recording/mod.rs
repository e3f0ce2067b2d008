//! What happened in a run, kept as data: Arrow IPC streams, each with a sidecar that says it is whole.
//!
//! [`bus_log`] is what crossed the bus. [`frames`] and [`batches`] read streams that nobody vouches for.

pub mod batches;
pub mod bus_log;
pub mod frames;

pub use bus_log::{FILE_NAME, FORMAT_VERSION, Metadata, RecordingError, SIDECAR_NAME, Sidecar, Summary, Writer};
