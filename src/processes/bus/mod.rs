//! The bus of a cluster: its shared memory, the arbitration between those who ask, the log of both.
//!
//! The control conversation runs here; the memory conversations in [`memory_loop`], on a thread of its own.

mod alone;
mod client;
pub mod memory_loop;
pub mod state;

use std::net::SocketAddr;
use std::thread;
use std::time::Duration;

use tokio::sync::{mpsc, oneshot};
use tokio::time::timeout;

pub use self::alone::{Alone, serve_alone};
use self::memory_loop::{Command, Handle, LoopError, MemoryLoop};
use self::state::{State, initiator};
use super::bootstrap::{StartError, live};
use super::folder_claim::ClaimError;
use super::{Child, ControlLink};
use crate::ids::Epoch;
use crate::machine::totals::BusTotals;
use crate::protocol::connection::{Arrival, ConnectionError, Credentials, Listener, WRITE_DEADLINE};
use crate::protocol::control::{BusCommand, BusConfiguration, BusReport};
use crate::pulse::Pulse;
use crate::recording::RecordingError;
use crate::recording::bus_log::{Metadata, ReadError, Writer};

/// Incidents on their way from the loop to the manager.
const INCIDENTS_MAX: usize = 64;
/// To serve what has arrived and make the recording whole.
const FINISH_DEADLINE: Duration = Duration::from_secs(60);

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
    #[error("the manager is gone")]
    Orphaned,
}

/// Serves until the manager says that it is over.
///
/// # Errors
/// Anything that keeps the bus from going on; the manager was told.
pub fn run(child: &Child) -> Result<(), BusError> {
    live(child, async {
        let mut link = ControlLink::open(child)?;
        let outcome = serve(child, &mut link).await;
        let report = match &outcome {
            Ok(totals) => BusReport::Finished(*totals),
            Err(error) => BusReport::Failed(error.to_string()),
        };
        // An error means that the manager is gone: the log has the outcome.
        let _ = link.reports.send(report).await;
        link.close();
        outcome.map(drop)
    })
}

/// Until the manager says that it is over.
async fn serve(child: &Child, link: &mut ControlLink<BusCommand, BusReport>) -> Result<BusTotals, BusError> {
    let configuration = match link.commands.recv().await {
        Some(BusCommand::Configure(configuration)) => configuration,
        Some(BusCommand::Finish { .. }) => return Ok(BusTotals::default()),
        Some(BusCommand::Heartbeat) | None => return Err(BusError::Orphaned),
    };
    let epoch = child.bootstrap.epoch;
    // On a machine of its own nobody has made it.
    std::fs::create_dir_all(&configuration.recording)?;
    let (incident_sender, mut incidents) = mpsc::channel(INCIDENTS_MAX);
    let (handle, mut ended) = start_loop(&configuration, epoch, incident_sender, None, child.pulse.clone())?;
    let mut listener = listen((child.interface(link.interface), 0).into(), child.credentials()).await?;
    let address = child.advertised(listener.address(), link.interface).await?;
    let mut reports = vec![BusReport::Listening(address)];
    loop {
        for report in reports.drain(..) {
            link.reports.send(report).await.map_err(|_| BusError::Orphaned)?;
        }
        tokio::select! {
            arrival = listener.arrival() => reports.extend(admit(arrival, &handle)?),
            Some(incident) = incidents.recv() => reports.push(BusReport::Incident(incident)),
            outcome = &mut ended => {
                outcome.map_err(|_| BusError::LoopEnded)??;
                return Err(BusError::LoopEnded);
            }
            command = link.commands.recv() => match command {
                Some(BusCommand::Finish { lost }) => {
                    handle.send(Command::Finish { lost })?;
                    let finished = timeout(FINISH_DEADLINE, ended).await.map_err(|_| BusError::Unfinished)?;
                    return finished.map_err(|_| BusError::LoopEnded)??.ok_or(BusError::LoopEnded);
                }
                Some(BusCommand::Configure(_)) => {
                    reports.push(BusReport::Incident("configured twice: the second is not heeded".to_owned()));
                }
                Some(BusCommand::Heartbeat) => {}
                None => return Err(BusError::Orphaned),
            },
        }
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
    // An error means that nobody waits for the outcome any more.
    thread::Builder::new().name("bus".to_owned()).spawn(move || {
        let beacon = pulse.beacon("bus");
        drop(sender.send(memory_loop.run(&beacon)));
    })?;
    Ok((handle, ended))
}

async fn listen(address: SocketAddr, credentials: Credentials) -> Result<Listener, BusError> {
    let admits = |role, _| match initiator(role) {
        Some(_) => Ok(()),
        None => Err("the manager, the master or a node".to_owned()),
    };
    Ok(Listener::bind_to(address, credentials, admits).await?)
}

/// Hands a peer to the loop; returns what the manager should know if there is none.
fn admit(arrival: Arrival, handle: &Handle) -> Result<Option<BusReport>, ConnectionError> {
    let admitted = arrival.and_then(|(peer, connection)| Ok((peer, connection.into_std()?)));
    let incident = match admitted {
        Ok((peer, socket)) => match handle.send(Command::Admit(peer, socket)) {
            Ok(()) => return Ok(None),
            Err(error) => format!("{peer}: not admitted: {error}"),
        },
        Err(error) if error.is_of_this_process() => return Err(error),
        Err(refused) => refused.to_string(),
    };
    tracing::warn!("{incident}");
    Ok(Some(BusReport::Incident(incident)))
}

#[cfg(test)]
mod tests;
