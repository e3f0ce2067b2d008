//! What happened in a run, kept as data: Arrow IPC streams, each with a sidecar that says it is whole.
//!
//! [`bus_log`] is what crossed the bus, [`references`] what tracers read before any memory saw it. [`frames`] and
//! [`batches`] read streams that nobody vouches for. docs/recording.md tells how to read them with other tools.

pub mod batches;
pub mod bus_log;
mod error;
pub mod frames;
pub mod references;

pub use bus_log::{FILE_NAME, FORMAT_VERSION, Metadata, SIDECAR_NAME, Sidecar, Summary, Writer};
pub use error::RecordingError;

use crate::database::{Layout, Section};

/// The layout as a schema's metadata tell it: JSON, records of each section.
fn records_json(layout: &Layout) -> String {
    let records = Section::ALL.map(|section| format!(r#""{}": {}"#, section.name(), layout.span(section).records));
    format!("{{{}}}", records.join(", "))
}
