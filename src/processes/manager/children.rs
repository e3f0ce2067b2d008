//! The processes themselves: started with what they must know on standard input, killed, confirmed dead.

use std::collections::HashMap;
use std::fs::OpenOptions;
use std::io;
use std::net::SocketAddr;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{ExitStatus, Stdio};
use std::time::Duration;

use nix::sys::signal::Signal;
use tokio::io::AsyncWriteExt;
use tokio::process::Command;
use tokio::sync::{mpsc, oneshot};

use super::executables::Executables;
use super::process::ProcessId;
use super::state::Event;
use crate::codec;
use crate::protocol::control::Bootstrap;
use crate::protocol::hello::RunToken;

/// Signs of life within a heartbeat's deadline.
const HEARTBEATS: u32 = 4;

/// Starts and kills; each child has a task of its own that waits for its end and tells it.
pub(super) struct Children {
    pub(super) executables: Executables,
    pub(super) logs: PathBuf,
    pub(super) token: RunToken,
    pub(super) manager: SocketAddr,
    pub(super) heartbeat_deadline: Duration,
    pub(super) events: mpsc::Sender<Event>,
    /// Dropping one kills.
    pub(super) alive: HashMap<ProcessId, oneshot::Sender<()>>,
}

impl Children {
    pub(super) fn spawn(&mut self, id: ProcessId) {
        let log = self.logs.join(format!("{}.log", id.log_stem()));
        let period = (self.heartbeat_deadline / HEARTBEATS).as_millis();
        let bootstrap = Bootstrap {
            role: id.role,
            epoch: id.epoch,
            token: self.token,
            manager: self.manager,
            log: log.clone(),
            heartbeat_milliseconds: u64::try_from(period).unwrap_or(u64::MAX),
        };
        let (kill, killed) = oneshot::channel();
        self.alive.insert(id, kill);
        let (executable, events) = (self.executables.path(id), self.events.clone());
        tokio::spawn(async move {
            let how = match live(&executable, &bootstrap, &log, killed).await {
                Ok(status) => describe(status, &log),
                Err(error) => format!("could not be started from {}: {error}", executable.display()),
            };
            // An error means that the manager has ended.
            let _ = events.send(Event::Exited(id, how)).await;
        });
    }

    /// By SIGKILL; its death is told as any other.
    pub(super) fn kill(&mut self, id: ProcessId) {
        self.alive.remove(&id);
    }
}

/// From start to end. The child has a process group of its own, so that a Ctrl-C in the terminal reaches the
/// manager alone.
async fn live(
    executable: &Path,
    bootstrap: &Bootstrap,
    log: &Path,
    killed: oneshot::Receiver<()>,
) -> io::Result<ExitStatus> {
    // What is printed before the log is open, or by an abort.
    let printed = OpenOptions::new().create(true).append(true).open(log)?;
    let mut child = Command::new(executable)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(printed)
        .process_group(0)
        .kill_on_drop(true)
        .spawn()?;
    if let Some(mut stdin) = child.stdin.take() {
        let frame = codec::encode(bootstrap, &[]).map_err(io::Error::other)?;
        // A child that does not read it has ended; its status says more. The frame fits the pipe's buffer.
        let _ = stdin.write_all(&frame).await;
    }
    tokio::select! {
        status = child.wait() => return status,
        _ = killed => {}
    }
    child.start_kill()?;
    child.wait().await
}

/// The rest of a sentence that begins with the process's name.
fn describe(status: ExitStatus, log: &Path) -> String {
    if let Some(signal) = status.signal() {
        let name = Signal::try_from(signal).map_or("unknown", Signal::as_str);
        return format!("died of signal {signal} ({name})");
    }
    match status.code() {
        Some(0) => "ended by itself".to_owned(),
        Some(code) => format!("ended with exit code {code}, see {}", log.display()),
        None => "ended".to_owned(),
    }
}
