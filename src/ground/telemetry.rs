//! The text log of a process. It never decides what becomes of the process: see [`outlet`](crate::outlet).

use std::backtrace::{Backtrace, BacktraceStatus};
use std::path::Path;
use std::sync::OnceLock;

use tracing::level_filters::LevelFilter;

use crate::outlet::{Outlet, STANDARD_ERROR};

/// Names the least severe level that is logged: `MARTI_LOG=debug`.
pub const LEVEL_VARIABLE: &str = "MARTI_LOG";

/// The file of this process's log, if it has one.
static LOG: OnceLock<Outlet> = OnceLock::new();

#[derive(Debug, thiserror::Error)]
pub enum TelemetryError {
    #[error("{LEVEL_VARIABLE} is not a level, expected off, error, warn, info, debug or trace")]
    Level,
    #[error("a log was started before")]
    Started,
}

/// Appends what this process logs, panics included, to a file, or to standard error. A process calls it once. Lines that
/// cannot be written are counted ([`lost`]).
///
/// # Errors
/// [`LEVEL_VARIABLE`] is not a level, or a log was started before.
pub fn start(path: Option<&Path>) -> Result<(), TelemetryError> {
    let level = match std::env::var_os(LEVEL_VARIABLE) {
        Some(name) => name.to_str().and_then(|name| name.parse().ok()).ok_or(TelemetryError::Level)?,
        None => LevelFilter::INFO,
    };
    let log: &'static Outlet = path.map_or(&STANDARD_ERROR, |path| LOG.get_or_init(|| Outlet::file(path)));
    // Its own message about a line that it cannot write would panic where standard error cannot be written either.
    let subscriber = tracing_subscriber::fmt().log_internal_errors(false).with_max_level(level).with_ansi(false);
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
