//! The text log of a process.

use std::fs::OpenOptions;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use tracing_subscriber::EnvFilter;
use tracing_subscriber::fmt::writer::BoxMakeWriter;

/// Names what is logged, in the syntax of `tracing_subscriber::EnvFilter`: `MARTI_LOG=debug`.
pub const FILTER_VARIABLE: &str = "MARTI_LOG";

#[derive(Debug, thiserror::Error)]
pub enum TelemetryError {
    #[error("cannot open the log {}: {error}", path.display())]
    Open { path: PathBuf, error: std::io::Error },
    #[error("{FILTER_VARIABLE} is not a filter: {0}; expected for example `info` or `marti=debug`")]
    Filter(#[from] tracing_subscriber::filter::ParseError),
    #[error("a log was started before")]
    Started,
}

/// Appends what this process logs, panics included, to a file, or to standard error. A process calls it once.
///
/// # Errors
/// The file cannot be opened, [`FILTER_VARIABLE`] is not a filter, or a log was started before.
pub fn start(path: Option<&Path>) -> Result<(), TelemetryError> {
    let open = |path: &Path| {
        let file = OpenOptions::new().create(true).append(true).open(path);
        file.map_err(|error| TelemetryError::Open { path: path.to_owned(), error })
    };
    let writer = match path.map(open).transpose()? {
        Some(file) => BoxMakeWriter::new(Mutex::new(file)),
        None => BoxMakeWriter::new(std::io::stderr),
    };
    let filter = match std::env::var(FILTER_VARIABLE) {
        Ok(directives) => EnvFilter::try_new(directives)?,
        Err(_) => EnvFilter::new("info"),
    };
    let subscriber = tracing_subscriber::fmt().with_env_filter(filter).with_ansi(false).with_writer(writer).finish();
    tracing::subscriber::set_global_default(subscriber).map_err(|_| TelemetryError::Started)?;
    let print = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        tracing::error!("{panic}");
        print(panic);
    }));
    Ok(())
}
