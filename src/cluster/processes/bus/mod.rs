//! The bus of a cluster: its shared memory, the arbitration between those who ask, the log of both.
//!
//! The control conversation runs here; the memory conversations in [`memory_loop`], on a thread of its own.

mod alone;
mod client;
pub mod control;
pub mod memory_loop;
pub mod state;

use std::net::SocketAddr;
use std::sync::Arc;
use std::thread;

use tokio::sync::{mpsc, oneshot};

pub use self::alone::{Alone, serve_alone};
use self::control::{Answer, Control, FINISH_DEADLINE, Task};
use self::memory_loop::{Command, Handle, LoopError, MemoryLoop};
use self::state::State;
use super::Child;
use super::bootstrap::StartError;
use super::driver::live::{self, ProcessError, Worker};
use super::folder_claim::ClaimError;
use crate::protocol::connection::{Connection, ConnectionError, Peer, WRITE_DEADLINE};
use crate::protocol::control::BusConfiguration;
use ground::ids::Epoch;
use ground::pulse::Pulse;
use machine::hardware::totals::BusTotals;
use machine::recording::RecordingError;
use machine::recording::bus_log::{Metadata, ReadError, Writer};

/// Incidents on their way from the loop to the manager.
const INCIDENTS_MAX: usize = 64;
#[derive(Debug, thiserror::Error)]
pub enum BusError {
    #[error(transparent)]
    Start(#[from] StartError),
    #[error("{0}")]
    System(#[from] std::io::Error),
    #[error(transparent)]
    Connection(#[from] ConnectionError),
    #[error(transparent)]
    Recording(#[from] RecordingError),
    #[error(transparent)]
    Loop(#[from] LoopError),
    #[error(transparent)]
    Read(#[from] ReadError),
    #[error(transparent)]
    Folder(#[from] ClaimError),
    #[error("{0} is not an address of this host alone, expected one such as 127.0.0.1:0")]
    NotLoopback(SocketAddr),
    #[error("{} is the recording that is to be served, expected another folder", .0.display())]
    OutIsRecording(std::path::PathBuf),
    #[error("the thread that owns the memory connections has ended")]
    LoopEnded,
    #[error("the recording was not closed within {} s", FINISH_DEADLINE.as_secs())]
    Unfinished,
}

/// Serves until the manager ends it.
///
/// # Errors
/// Anything that keeps the bus from going on; it was reported to the manager.
pub fn run(child: &Child) -> Result<(), ProcessError> {
    let memory = Memory { epoch: child.bootstrap.epoch, pulse: child.pulse.clone(), running: None };
    live::run(child, Control::default(), memory, Arc::default())
}

/// The thread that owns the memory connections, once the bus is configured.
struct Memory {
    epoch: Epoch,
    pulse: Pulse,
    running: Option<Running>,
}

struct Running {
    handle: Handle,
    incidents: mpsc::Receiver<String>,
    /// `None`: it has been reported.
    ended: Option<oneshot::Receiver<LoopOutcome>>,
}

impl Worker<Control> for Memory {
    fn begin(&mut self, task: Task) -> Result<Option<Answer>, String> {
        let begun = match (task, &self.running) {
            (Task::Serve(configuration), _) => {
                let (sender, incidents) = mpsc::channel(INCIDENTS_MAX);
                start_loop(&configuration, self.epoch, sender, None, self.pulse.clone()).map(|(handle, ended)| {
                    self.running = Some(Running { handle, incidents, ended: Some(ended) });
                })
            }
            (Task::Finish { lost }, Some(running)) => {
                running.handle.send(Command::Finish { lost }).map_err(BusError::System)
            }
            (Task::Finish { .. }, None) => Err(BusError::LoopEnded),
        };
        begun.map(|()| None).map_err(|error| error.to_string())
    }

    async fn answer(&mut self) -> Answer {
        let Some(Running { incidents, ended, .. }) = &mut self.running else { return std::future::pending().await };
        let outcome = tokio::select! {
            Some(incident) = incidents.recv() => return Answer::Incident(incident),
            outcome = end(ended) => outcome,
        };
        *ended = None;
        let totals = outcome
            .map_err(|error| error.to_string())
            .and_then(|totals| totals.ok_or_else(|| BusError::LoopEnded.to_string()));
        Answer::Ended(totals)
    }

    fn take_over(&mut self, peer: Peer, connection: Connection) -> Result<Option<Connection>, String> {
        let Some(running) = &self.running else { return Ok(None) };
        admit(peer, connection, &running.handle).map(|()| None)
    }
}

async fn end(ended: &mut Option<oneshot::Receiver<LoopOutcome>>) -> Result<Option<BusTotals>, BusError> {
    match ended {
        Some(ended) => Ok(ended.await.map_err(|_| BusError::LoopEnded)??),
        None => std::future::pending().await,
    }
}

type LoopOutcome = Result<Option<BusTotals>, LoopError>;

fn start_loop(
    configuration: &BusConfiguration,
    epoch: Epoch,
    incidents: mpsc::Sender<String>,
    farewell: Option<oneshot::Sender<()>>,
    pulse: Pulse,
) -> Result<(Handle, oneshot::Receiver<LoopOutcome>), BusError> {
    let BusConfiguration { cluster, arbiter, layout, recording } = configuration;
    std::fs::create_dir_all(recording)
        .map_err(|error| std::io::Error::new(error.kind(), format!("{}: {error}", recording.display())))?;
    let metadata = Metadata { cluster: *cluster, epoch, arbiter: *arbiter, layout: layout.clone() };
    let recording = Writer::create(recording, &metadata)?;
    let state = State::new(configuration, epoch);
    let (mut memory_loop, handle) = MemoryLoop::new(state, recording, incidents, WRITE_DEADLINE)?;
    if let Some(farewell) = farewell {
        memory_loop.tell_when_the_loader_leaves(farewell);
    }
    let (sender, ended) = oneshot::channel();
    // An error means that the outcome is not awaited any more.
    thread::Builder::new().name("bus".to_owned()).spawn(move || {
        let beacon = pulse.beacon("bus");
        drop(sender.send(memory_loop.run(&beacon)));
    })?;
    Ok((handle, ended))
}

/// Hands a peer to the loop.
///
/// # Errors
/// It cannot be served; why, with its name.
fn admit(peer: Peer, connection: Connection, handle: &Handle) -> Result<(), String> {
    let socket = connection.into_std().map_err(|error| error.to_string())?;
    handle.send(Command::Admit(peer, socket)).map_err(|error| format!("{peer}: not admitted: {error}"))
}

#[cfg(test)]
mod tests;
