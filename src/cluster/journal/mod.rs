//! The display's journal: every tile as it came, appended before its arrival is acknowledged. What is in it need
//! not be traced again, whoever dies: the display, or the manager with all that it started.
//!
//! `format` has the bytes, `reader` takes them from anything and trusts none, `writer` owns the file. docs/journal.md
//! is for other readers.

mod format;
mod reader;
mod writer;

pub use format::{FORMAT_VERSION, Record, Subject};
pub use reader::{HeaderFault, Next, Reader, Start};
pub use writer::{Journal, JournalError};

#[cfg(test)]
mod tests;
