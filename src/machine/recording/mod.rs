//! What happened in a run, kept as data: Arrow IPC streams, each with a sidecar that says it is whole.
//!
//! [`bus_log`] is what crossed the bus, [`references`] what tracers read before any memory saw it. [`frames`] and
//! [`batches`] read streams that are not trusted. docs/recording.md says how to read them with other tools.

pub mod batches;
pub mod bus_log;
mod error;
pub mod frames;
mod metadata;
pub mod references;
mod sidecar;

pub use bus_log::{FILE_NAME, FORMAT_VERSION, Metadata, SIDECAR_NAME, Sidecar, Summary, Writer};
pub use error::RecordingError;
