//! What crossed the bus, kept as data: `bus.arrows`, an Arrow IPC stream, and its sidecar `bus.json`.
//!
//! docs/recording.md tells how to read them. The columns are in `format`, the files in `row_stream`, the queue
//! and the thread behind it in `writer`.

mod format;
pub mod frames;
pub mod references;
mod row_stream;
mod writer;

pub use format::{FORMAT_VERSION, Metadata};
pub use row_stream::{FILE_NAME, SIDECAR_NAME, Sidecar};
pub use writer::{RecordingError, Summary, Writer};

use crate::database::{Layout, Section};

/// The layout as a schema's metadata tell it: JSON, records of each section.
fn records_json(layout: &Layout) -> String {
    let records = Section::ALL.map(|section| format!(r#""{}": {}"#, section.name(), layout.span(section).records));
    format!("{{{}}}", records.join(", "))
}
