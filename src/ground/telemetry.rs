//! The text log of a process. It never decides what becomes of the process: see [`outlet`](crate::outlet).

use std::backtrace::{Backtrace, BacktraceStatus};
use std::path::Path;
use std::sync::OnceLock;

use tracing_subscriber::EnvFilter;

use crate::outlet::{Outlet, STANDARD_ERROR};

/// Names what is logged, in the syntax of `tracing_subscriber::EnvFilter`: `MARTI_LOG=debug`.
pub const FILTER_VARIABLE: &str = "MARTI_LOG";

/// The file of this process's log, if it has one.
static LOG: OnceLock<Outlet> = OnceLock::new();

#[derive(Debug, thiserror::Error)]
pub enum TelemetryError {
    #[error("{FILTER_VARIABLE} is not a filter: {0}; expected for example `info` or `marti=debug`")]
    Filter(#[from] tracing_subscriber::filter::ParseError),
    #[error("a log was started before")]
    Started,
}

/// Appends what this process logs, panics included, to a file, or to standard error. A process calls it once. Lines that
/// cannot be written are counted ([`lost`]).
///
/// # Errors
/// [`FILTER_VARIABLE`] is not a filter, or a log was started before.
pub fn start(path: Option<&Path>) -> Result<(), TelemetryError> {
    let filter = match std::env::var(FILTER_VARIABLE) {
        Ok(directives) => EnvFilter::try_new(directives)?,
        Err(_) => EnvFilter::new("info"),
    };
    let log: &'static Outlet = path.map_or(&STANDARD_ERROR, |path| LOG.get_or_init(|| Outlet::file(path)));
    // Its own message about a line that it cannot write would panic where standard error cannot be written either.
    let subscriber = tracing_subscriber::fmt().log_internal_errors(false).with_env_filter(filter).with_ansi(false);
    let subscriber = subscriber.with_writer(move || log).finish();
    tracing::subscriber::set_global_default(subscriber).map_err(|_| TelemetryError::Started)?;
    let is_file = path.is_some();
    // Without `tracing`, in which the thread may have panicked.
    std::panic::set_hook(Box::new(move |panic| {
        let backtrace = Backtrace::capture();
        let line = match backtrace.status() {
            BacktraceStatus::Captured => format!("ERROR {panic}\n{backtrace}\n"),
            _ => format!("ERROR {panic}\n"),
        };
        log.write_line(&line);
        if is_file {
            STANDARD_ERROR.write_line(&line);
        }
    }));
    Ok(())
}

/// How many lines of the log and to standard error could not be written, and why; empty if all were.
pub fn lost() -> Vec<String> {
    LOG.get().into_iter().chain([&STANDARD_ERROR]).filter_map(Outlet::lost).collect()
}
