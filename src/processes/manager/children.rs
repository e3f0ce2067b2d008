//! The processes themselves: started with what they must know on standard input, killed, confirmed dead.

use std::collections::HashMap;
use std::fs::OpenOptions;
use std::io;
use std::net::SocketAddr;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{ExitStatus, Stdio};
use std::time::Duration;

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use tokio::io::AsyncWriteExt;
use tokio::process::{Child, Command};
use tokio::sync::mpsc;
use tokio::time::{Instant, sleep_until};

use super::executables::Executables;
use super::process::ProcessId;
use super::state::Event;
use crate::codec;
use crate::protocol::control::Bootstrap;
use crate::protocol::hello::RunToken;

/// Signs of life within a heartbeat's deadline.
const HEARTBEATS: u32 = 4;
/// Orders to stop that a process was not given yet.
const STOPS_MAX: usize = 8;

/// Starts and kills; each child has a task of its own that waits for its end and tells it.
pub(super) struct Children {
    pub(super) executables: Executables,
    pub(super) logs: PathBuf,
    pub(super) token: RunToken,
    pub(super) heartbeat_deadline: Duration,
    pub(super) events: mpsc::Sender<Event>,
    /// How long each is to stop; dropping one kills.
    pub(super) alive: HashMap<ProcessId, mpsc::Sender<Duration>>,
}

impl Children {
    /// `manager` is where it finds us.
    pub(super) fn spawn(&mut self, id: ProcessId, manager: SocketAddr) {
        let log = self.logs.join(format!("{}.log", id.log_stem()));
        let period = (self.heartbeat_deadline / HEARTBEATS).as_millis();
        let bootstrap = Bootstrap {
            role: id.role,
            epoch: id.epoch,
            token: self.token,
            manager,
            log: log.clone(),
            heartbeat_milliseconds: u64::try_from(period).unwrap_or(u64::MAX),
        };
        let (alive, stops) = mpsc::channel(STOPS_MAX);
        self.alive.insert(id, alive);
        let (executable, events) = (self.executables.path(id), self.events.clone());
        tokio::spawn(async move {
            let how = match live(&executable, &bootstrap, &log, stops).await {
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

    /// Whether it was started and not killed; it may have ended by itself.
    pub(super) fn is_alive(&self, id: ProcessId) -> bool {
        self.alive.contains_key(&id)
    }

    /// By SIGSTOP; it goes on after so long.
    ///
    /// # Errors
    /// Why not: the process is not one of this host's, or has ended.
    pub(super) fn stop(&self, id: ProcessId, time: Duration) -> Result<(), String> {
        let alive = self.alive.get(&id).ok_or("it is no process of this host")?;
        alive.try_send(time).map_err(|_| "it has ended, or stops already".to_owned())
    }
}

/// From start to end. The child has a process group of its own, so that a Ctrl-C in the terminal reaches the
/// manager alone.
async fn live(
    executable: &Path,
    bootstrap: &Bootstrap,
    log: &Path,
    mut stops: mpsc::Receiver<Duration>,
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
    let mut goes_on = None;
    loop {
        tokio::select! {
            status = child.wait() => return status,
            stop = stops.recv() => match stop {
                Some(time) => {
                    signal(&child, Signal::SIGSTOP)?;
                    goes_on = goes_on.max(Some(Instant::now() + time));
                }
                None => break,
            },
            () = sleep_until(goes_on.unwrap_or_else(Instant::now)), if goes_on.is_some() => {
                signal(&child, Signal::SIGCONT)?;
                goes_on = None;
            }
        }
    }
    child.start_kill()?;
    child.wait().await
}

/// Its number is still its own: nobody has waited for it.
fn signal(child: &Child, signal: Signal) -> io::Result<()> {
    let pid = child.id().and_then(|pid| i32::try_from(pid).ok());
    pid.map_or(Ok(()), |pid| Ok(kill(Pid::from_raw(pid), signal)?))
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
