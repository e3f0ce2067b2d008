//! Why a recording cannot be written.

use std::io;
use std::path::PathBuf;
use std::time::Duration;

use arrow_schema::ArrowError;

/// Why a recording cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    #[error("cannot write {}: {source}", path.display())]
    Io { path: PathBuf, source: io::Error },
    #[error("cannot write {}: {source}", path.display())]
    Arrow { path: PathBuf, source: ArrowError },
    #[error("{} was not written within {} s", path.display(), deadline.as_secs())]
    Stalled { path: PathBuf, deadline: Duration },
    #[error("the thread that writes {} ended early", path.display())]
    Ended { path: PathBuf },
}
