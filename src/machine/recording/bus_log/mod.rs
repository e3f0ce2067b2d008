//! What crossed the bus: `bus.arrows`, an Arrow IPC stream, and its sidecar `bus.json`.
//!
//! docs/recording.md says how to read them. The columns are in `format` and `rows`, the files in `row_stream`, the
//! queue and the thread behind it in `writer`; `reader` gives back what was written, as far as it can be used.

mod format;
mod reader;
mod row_stream;
mod rows;
mod writer;

#[cfg(test)]
mod damage_tests;

pub use format::{FORMAT_VERSION, Metadata};
pub use reader::{ReadError, Reader, Usable};
pub use row_stream::{FILE_NAME, SIDECAR_NAME, Sidecar, folder, folder_of};
pub use writer::{Summary, Writer};
