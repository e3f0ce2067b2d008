//! A bus by itself, without a manager: its memory waits for a client that uploads the database of a recording.

use std::fs;
use std::io::{self, Write};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::{mpsc, oneshot};
use tokio::time::timeout;

use super::control::FINISH_DEADLINE;
use super::memory_loop::Command;
use super::{BusError, INCIDENTS_MAX, admit, start_loop};
use crate::processes::driver::Admission;
use crate::processes::event_queue::event_queue;
use crate::processes::folder_claim::{FolderClaim, named};
use crate::processes::{StartError, token};
use crate::protocol::connection::{Credentials, Listener};
use crate::protocol::control::BusConfiguration;
use crate::protocol::hello::RunToken;
use ground::ids::Epoch;
use ground::pulse::Pulse;
use ground::telemetry;
use machine::hardware::totals::BusTotals;
use machine::recording::bus_log;

/// What to serve, and where.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Alone {
    /// The folder of a run, or its `recording`: whose layout and arbiter the bus has.
    pub recording: PathBuf,
    /// Of this host alone; port 0 is a free one.
    pub bind: SocketAddr,
    /// The folder for this bus' own recording, its text log and the file with its token, `bus.token`.
    pub out: PathBuf,
}

impl Alone {
    fn token(&self) -> PathBuf {
        self.out.join("bus.token")
    }
}

/// Prints the address it got, then serves until its loader leaves, or SIGINT or SIGTERM arrives.
///
/// # Errors
/// The recording has no schema of a bus log, a folder cannot be written, the address cannot be bound, or what keeps
/// any bus from going on.
pub fn serve_alone(alone: &Alone) -> Result<BusTotals, BusError> {
    if !alone.bind.ip().is_loopback() {
        return Err(BusError::NotLoopback(alone.bind));
    }
    // The schema alone is needed: rows may be damaged.
    let recorded = bus_log::Reader::salvage(&bus_log::folder(&alone.recording))?.metadata().clone();
    let (_claim, recording) = prepare(alone)?;
    let configuration =
        BusConfiguration { cluster: recorded.cluster, arbiter: recorded.arbiter, layout: recorded.layout, recording };
    let secret = token::random()?;
    token::write(&alone.token(), secret)?;
    let runtime = event_queue()?;
    let served = runtime.block_on(serve(alone.bind, secret, &configuration));
    // Nobody can use it any more.
    let _ = fs::remove_file(alone.token());
    match &served {
        Ok(totals) => tracing::info!("served {} transactions", totals.transactions),
        Err(error) => tracing::error!("{error}"),
    }
    served
}

/// Claims the folder, and puts the log of an earlier bus aside; returns the folder of the recording.
fn prepare(alone: &Alone) -> Result<(FolderClaim, PathBuf), BusError> {
    let mut claim = FolderClaim::take(&alone.out)?;
    let (recording, logs) = (alone.out.join("recording"), alone.out.join("logs"));
    let source = bus_log::folder(&alone.recording);
    let real = |folder: &Path| folder.canonicalize().map_err(|error| named(folder, &error));
    if recording.exists() && real(&source)? == real(&recording)? {
        return Err(BusError::OutIsRecording(recording));
    }
    claim.put_aside("recording")?;
    for folder in [&recording, &logs] {
        fs::create_dir_all(folder).map_err(|error| named(folder, &error))?;
    }
    telemetry::start(Some(&logs.join("bus.log"))).map_err(StartError::from)?;
    if let Some(warning) = claim.warning() {
        tracing::warn!("{warning}");
    }
    Ok((claim, recording))
}

async fn serve(bind: SocketAddr, secret: RunToken, configuration: &BusConfiguration) -> Result<BusTotals, BusError> {
    let mut interrupt = signal(SignalKind::interrupt())?;
    let mut terminate = signal(SignalKind::terminate())?;
    let (incident_sender, mut incidents) = mpsc::channel(INCIDENTS_MAX);
    let (farewell, mut loader_left) = oneshot::channel();
    let (handle, ended) = start_loop(configuration, Epoch(0), incident_sender, Some(farewell), Pulse::default())?;
    let admits = |role, _| Admission::BusClients.check(role);
    let mut listener = Listener::bind_to(bind, Credentials::plain(secret), admits).await?;
    say(listener.address())?;
    let why = loop {
        tokio::select! {
            arrival = listener.arrival() => match arrival {
                Ok((peer, connection)) => {
                    if let Err(why) = admit(peer, connection, &handle) {
                        tracing::warn!("{why}");
                    }
                }
                Err(error) if error.is_of_this_process() => return Err(error.into()),
                Err(refused) => tracing::warn!("{refused}"),
            },
            Some(_) = incidents.recv() => {}
            left = &mut loader_left => match left {
                Ok(()) => break "the loader has left",
                Err(_) => {
                    ended.await.map_err(|_| BusError::LoopEnded)??;
                    return Err(BusError::LoopEnded);
                }
            },
            Some(()) = interrupt.recv() => break "SIGINT",
            Some(()) = terminate.recv() => break "SIGTERM",
        }
    };
    tracing::info!("{why}: the end");
    handle.send(Command::Finish { lost: Vec::new() })?;
    let finished = timeout(FINISH_DEADLINE, ended).await.map_err(|_| BusError::Unfinished)?;
    finished.map_err(|_| BusError::LoopEnded)??.ok_or(BusError::LoopEnded)
}

/// Whoever started this process waits for the line.
fn say(address: SocketAddr) -> io::Result<()> {
    let mut out = io::stdout().lock();
    writeln!(out, "{address}")?;
    out.flush()
}
