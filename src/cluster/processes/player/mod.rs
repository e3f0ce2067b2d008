//! Live replay: uploads the image of a recording to a running bus, then sends again the requests of its nodes and its master,
//! and compares every answer with the recorded one.
//!
//! Each of them has a connection and a thread of its own (`agent`), and at most one request on the bus, as when it was
//! recorded. The log is read twice, batch by batch: first to see that it can be played (`schedule`), then to play it.

mod agent;
mod latency;
mod outcome;
mod schedule;

use std::collections::BTreeMap;
use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, ScopedJoinHandle};
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, Sender, bounded};
use serde::Serialize;
use sha2::{Digest, Sha256};

use self::agent::{Agent, Due, Tally};
pub use self::latency::Latency;
pub use self::outcome::PlayOutcome;
use self::schedule::Schedule;
use super::event_queue::event_queue;
use super::loader::Loader;
use super::{scene_warnings, token};
use crate::protocol::connection::{ConnectionError, Credentials};
use crate::protocol::hello::Role;
use crate::topology::Topology;
use ground::ids::ClusterId;
use machine::hardware::transaction::{Initiator, Kind, Transaction};
use machine::recording::bus_log::{self, ReadError, Reader};
use trace::database::{Layout, Section};
use trace::preparation::PreparationError;
use trace::scene::SourceError;

/// For a bus to take a piece of the image.
const UPLOAD_DEADLINE: Duration = Duration::from_secs(60);
/// Parts of batches that wait for one agent.
const QUEUE_MAX: usize = 2;

/// How fast to play.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Pace {
    /// No request before the time at which it was recorded.
    Recorded,
    /// Each request as soon as the one before it was answered.
    Fastest,
}

/// What to play, and to whom.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct PlayRequest {
    /// The folder of a run, with `topology.toml` and `recording/`.
    pub recording: PathBuf,
    /// The address that `marti-bus --recording` printed.
    pub bus: SocketAddr,
    /// The file with the bus' token.
    pub token: PathBuf,
    pub pace: Pace,
    /// What the SHA-256 of the image must be, in hexadecimal, if that is known.
    pub scene_sha256: Option<String>,
    /// Whether to play what can be read of a damaged log; it is refused otherwise.
    pub may_be_damaged: bool,
}

#[derive(Debug, thiserror::Error)]
pub enum PlayError {
    #[error(transparent)]
    Recording(#[from] ReadError),
    #[error(transparent)]
    Topology(#[from] SourceError),
    #[error(transparent)]
    Preparation(#[from] PreparationError),
    #[error("the image has {rebuilt} records of {section}, recorded were {recorded}: the scene or marti is another")]
    OtherLayout { section: &'static str, recorded: u64, rebuilt: u64 },
    #[error("the image's records of {section} have {rebuilt} bytes, recorded were {recorded}: the topology is another")]
    OtherRecords { section: &'static str, recorded: u64, rebuilt: u64 },
    #[error("the image has SHA-256 {rebuilt}, recorded was {recorded}: the scene or marti is another")]
    OtherScene { recorded: String, rebuilt: String },
    #[error("the {bytes} bytes at {address} of the image are not those recorded: the scene or marti is another")]
    OtherImage { address: u64, bytes: u32 },
    #[error("the recorded upload ends after {recorded} of {image} bytes: there is nothing to play")]
    UploadCut { recorded: u64, image: u64 },
    #[error("sequence {sequence} of the recording cannot be played again: {why}")]
    Unplayable { sequence: u64, why: String },
    #[error("{0}")]
    Token(io::Error),
    #[error("bus: {0}")]
    Upload(String),
    #[error(transparent)]
    Connection(#[from] ConnectionError),
    #[error("the system has no {what}: {error}")]
    System { what: &'static str, error: io::Error },
}

impl PlayError {
    /// Whether what was asked for cannot be right, however often it is tried.
    pub fn is_bad_input(&self) -> bool {
        !matches!(self, Self::Upload(_) | Self::Connection(_) | Self::System { .. })
    }
}

/// Plays a recording to a bus that has its layout and nothing in its memory yet.
///
/// # Errors
/// The recording is damaged, is of another image than its topology makes now, or holds what cannot be played again;
/// the bus refuses this process, a piece of the image or a request, or is silent. Answers that differ are no error: they
/// are counted.
pub fn play(request: &PlayRequest) -> Result<PlayOutcome, PlayError> {
    let credentials = Credentials::plain(token::read(&request.token).map_err(PlayError::Token)?);
    let topology = Topology::read(&request.recording.join("topology.toml"), &[])?;
    let log = open(request)?;
    let prepared = topology.prepare()?;
    scene_warnings::show(&prepared.warnings);
    let database = prepared.database.database();
    let image = database.bytes();
    check_layout(&log.metadata().layout, &database.header.layout)?;
    check_hash(request.scene_sha256.as_deref(), image)?;
    let schedule = Schedule::read(log, image, topology.cluster.all_nodes(), request.may_be_damaged)?;

    let runtime = event_queue();
    let runtime = runtime.map_err(|error| PlayError::System { what: "event queue", error })?;
    let start = Instant::now();
    let loader = runtime.block_on(upload(request.bus, &credentials, open(request)?, image))?;
    let upload_seconds = start.elapsed().as_secs_f64();

    let agents = connect(request.bus, &credentials, &schedule)?;
    let start = Instant::now();
    let tally = replay(request, &schedule, agents, start)?;
    let played = Played { seconds: start.elapsed().as_secs_f64(), upload_seconds, uploaded_bytes: image.len() as u64 };
    // The bus by itself ends when its loader leaves.
    runtime.block_on(loader.leave());
    Ok(outcome(request.pace, &schedule, &tally, played))
}

fn open(request: &PlayRequest) -> Result<Reader, PlayError> {
    let folder = bus_log::folder(&request.recording);
    Ok(if request.may_be_damaged { Reader::salvage(&folder)? } else { Reader::open(&folder)? })
}

fn check_layout(recorded: &Layout, rebuilt: &Layout) -> Result<(), PlayError> {
    for section in Section::ALL {
        let (records, found) = (recorded.span(section).records, rebuilt.span(section).records);
        if records != found {
            return Err(PlayError::OtherLayout { section: section.name(), recorded: records, rebuilt: found });
        }
        let (bytes, found) = (recorded.record_bytes(section), rebuilt.record_bytes(section));
        if bytes != found {
            return Err(PlayError::OtherRecords { section: section.name(), recorded: bytes, rebuilt: found });
        }
    }
    Ok(())
}

fn check_hash(recorded: Option<&str>, image: &[u8]) -> Result<(), PlayError> {
    let Some(recorded) = recorded else { return Ok(()) };
    let rebuilt: String = Sha256::digest(image).iter().map(|byte| format!("{byte:02x}")).collect();
    if !recorded.eq_ignore_ascii_case(&rebuilt) {
        return Err(PlayError::OtherScene { recorded: recorded.to_owned(), rebuilt });
    }
    Ok(())
}

/// Stores the image in the pieces in which it was stored; the loader stays on the bus.
async fn upload(
    bus: SocketAddr,
    credentials: &Credentials,
    mut log: Reader,
    image: &[u8],
) -> Result<Loader, PlayError> {
    let mut loader =
        Loader::connect(ClusterId(0), bus, credentials, UPLOAD_DEADLINE).await.map_err(PlayError::Upload)?;
    let mut uploaded = 0;
    while uploaded < image.len() {
        let Some(rows) = log.next_rows()? else { break };
        for row in rows.iter().filter(|row| row.kind == Kind::Write) {
            // The schedule has read the same: pieces follow one another to the image's end.
            let Some(address) = row.address else { continue };
            let piece = image.get(uploaded..uploaded + row.bytes as usize).unwrap_or_default();
            loader.store(address, piece).await.map_err(PlayError::Upload)?;
            uploaded += piece.len();
        }
    }
    Ok(loader)
}

fn connect(
    bus: SocketAddr,
    credentials: &Credentials,
    schedule: &Schedule,
) -> Result<BTreeMap<Initiator, Agent>, PlayError> {
    let nodes = schedule.nodes.iter().map(|node| Initiator::Node(*node));
    let initiators = nodes.chain(schedule.has_jobs.then_some(Initiator::Master));
    let mut agents = BTreeMap::new();
    for initiator in initiators {
        let role = match initiator {
            Initiator::Node(node) => Role::Node(node),
            Initiator::Master | Initiator::Loader => Role::Master(ClusterId(0)),
        };
        agents.insert(initiator, Agent::connect(bus, role, credentials)?);
    }
    Ok(agents)
}

/// Gives each row to the agent of its initiator.
fn replay(
    request: &PlayRequest,
    schedule: &Schedule,
    agents: BTreeMap<Initiator, Agent>,
    start: Instant,
) -> Result<Tally, PlayError> {
    let due = match request.pace {
        Pace::Recorded => Due::Recorded { start, first_request: schedule.first_request },
        Pace::Fastest => Due::AtOnce,
    };
    let stop = AtomicBool::new(false);
    thread::scope(|scope| {
        let mut queues = BTreeMap::new();
        let mut threads = Vec::new();
        for (initiator, agent) in agents {
            let (queue, rows): (Sender<Vec<Transaction>>, Receiver<_>) = bounded(QUEUE_MAX);
            let stop = &stop;
            let name = format!("{initiator:?}");
            let thread =
                thread::Builder::new().name(name).spawn_scoped(scope, move || agent.send_all(&rows, due, stop));
            threads.push(thread.map_err(|error| PlayError::System { what: "thread", error })?);
            queues.insert(initiator, queue);
        }
        let handed_out = hand_out(open(request)?, schedule, &queues);
        drop(queues);
        if !matches!(handed_out, Ok(true)) {
            stop.store(true, Ordering::Relaxed);
            return join(threads).and(handed_out.map(|_| Tally::new()));
        }
        join(threads)
    })
}

/// `false`: a agent has ended early.
fn hand_out(
    mut log: Reader,
    schedule: &Schedule,
    queues: &BTreeMap<Initiator, Sender<Vec<Transaction>>>,
) -> Result<bool, PlayError> {
    let mut left = schedule.transactions;
    while left > 0 {
        let Some(rows) = log.next_rows()? else { break };
        let mut parts: BTreeMap<Initiator, Vec<Transaction>> = BTreeMap::new();
        for row in rows.into_iter().filter(|row| row.kind != Kind::Write) {
            let initiator = match (row.kind, row.node) {
                (Kind::Fetch | Kind::Bulk | Kind::Pixels, Some(node)) => Initiator::Node(node),
                _ => Initiator::Master,
            };
            parts.entry(initiator).or_default().push(row);
            left -= 1;
        }
        for (initiator, part) in parts {
            if queues.get(&initiator).is_none_or(|queue| queue.send(part).is_err()) {
                return Ok(false);
            }
        }
    }
    Ok(true)
}

fn join(threads: Vec<ScopedJoinHandle<'_, Result<Tally, ConnectionError>>>) -> Result<Tally, PlayError> {
    let mut tally = Tally::new();
    for thread in threads {
        match thread.join() {
            Ok(sent) => tally.add(&sent?),
            Err(panic) => std::panic::resume_unwind(panic),
        }
    }
    Ok(tally)
}

struct Played {
    seconds: f64,
    upload_seconds: f64,
    uploaded_bytes: u64,
}

fn outcome(pace: Pace, schedule: &Schedule, tally: &Tally, played: Played) -> PlayOutcome {
    let count = |kind: Kind| tally.transactions[kind as usize];
    let bytes = |kind: Kind| tally.bytes[kind as usize];
    let transactions = tally.transactions.iter().sum();
    let moved_bytes = bytes(Kind::Fetch) + bytes(Kind::Bulk);
    let Played { seconds, upload_seconds, uploaded_bytes } = played;
    PlayOutcome {
        pace,
        nodes: schedule.nodes.len() as u64,
        uploaded_bytes,
        upload_seconds,
        transactions,
        fetches: count(Kind::Fetch),
        bulk_reads: count(Kind::Bulk),
        jobs: count(Kind::Job),
        pixels: count(Kind::Pixels),
        moved_bytes,
        modelled_bytes: bytes(Kind::Job) + bytes(Kind::Pixels),
        mismatches: tally.mismatches,
        first_mismatch: tally.first_mismatch.as_ref().map(|(_, what)| what.clone()),
        latency_microseconds: tally.latencies.summary(),
        seconds,
        recorded_seconds: schedule.recorded_nanoseconds as f64 / 1e9,
        transactions_per_second: transactions as f64 / seconds,
        mebibytes_per_second: moved_bytes as f64 / f64::from(1 << 20) / seconds,
        late_microseconds_max: (pace == Pace::Recorded).then_some(tally.late.as_secs_f64() * 1e6),
        left_out: schedule.fault.as_ref().map(ToString::to_string),
    }
}
