//! The manager: prepares the scene, starts the other processes, watches them, gives out the tiles, and tells
//! what came of it.
//!
//! `state` decides, `shell` moves messages and processes.

mod cause;
mod closing;
mod control_port;
mod disturbance;
mod event;
#[cfg(any(test, feature = "testing"))]
mod fixture;
mod folder;
mod launch;
mod metrics;
mod plan;
pub(in crate::processes) mod process;
mod reach;
mod shell;
#[cfg(any(test, feature = "testing"))]
pub(in crate::processes) mod simulated;
pub(in crate::processes) mod state;

use std::io;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use sha2::{Digest, Sha256};

use self::cause::Cause;
pub use self::cause::Interrupt;
use self::folder::output_folder::{Opening, OutputError, OutputFolder};
use self::folder::{output_folder, recorded};
use self::launch::programs::Programs;
use self::plan::Plan;
use super::event_queue::event_queue;
use super::health::HealthError;
use super::{scene_warnings, token};
use crate::chaos;
use crate::journal::{Journal, JournalError, Subject};
use crate::keys::{Identity, KeysError, RoleKind};
use crate::protocol::connection::{Credentials, Tls};
use crate::protocol::hello::{Role, RunToken};
use crate::protocol::mac::MacKey;
use crate::report::{Image, Report, Status, json};
use crate::topology::{Placement, Topology};
use ground::ids::Epoch;
use ground::telemetry::{self, TelemetryError};
use machine::hardware::specification::{Cluster, MemorySize};
use trace::picture::AovSet;
use trace::preparation::{self, PreparationError};
use trace::tracer::View;

/// What to run.
#[derive(Clone, Debug)]
pub struct RunRequest {
    pub topology: Topology,
    /// The folder for image, report, recording and logs; made if need be.
    pub out: PathBuf,
    /// Whether the tiles in the folder's journal are taken over.
    pub resume: bool,
    /// Whether the folder may hold what no run wrote.
    pub force: bool,
    /// Whether a scene with warnings is refused.
    pub strict: bool,
    pub aov: AovSet,
    pub exr: bool,
    /// Whether nodes record every reference, for replay.
    pub record_references: bool,
    /// Where the manager listens, instead of where the topology says.
    pub listen: Option<SocketAddr>,
    /// The folder of the cluster's keys: everything is said by TLS.
    pub keys: Option<PathBuf>,
    /// Whether addresses at which other machines can knock are used without TLS.
    pub insecure: bool,
    /// Faults on purpose.
    pub chaos: Option<chaos::FaultSchedule>,
    /// Where to serve health and metrics; of this host alone.
    pub health: Option<SocketAddr>,
    /// No progress on standard error.
    pub quiet: bool,
}

/// How a run ended that began.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum RunEnd {
    Done,
    /// Every node is set aside; the image is partial.
    TilesMissing,
    /// By this signal; the image is partial, unless all tiles were done.
    Interrupted(Interrupt),
    /// Why: a process that cannot be replaced died, or the image is not to be relied on. The image is there if the display
    /// lived.
    Failed(String),
}

#[derive(Clone, Debug)]
pub struct RunOutcome {
    pub end: RunEnd,
    /// The run's folder.
    pub out: PathBuf,
    /// Also written to `report.json`.
    pub report: Report,
}

#[derive(Debug, thiserror::Error)]
pub enum RunError {
    #[error(transparent)]
    Preparation(#[from] PreparationError),
    #[error("the scene has warnings, which --strict makes errors")]
    Warnings,
    #[error("--aov asks for other planes than the run began with, expected those or no --aov")]
    Planes,
    #[error("there are no references to record where cluster.local_memory.size is \"all\": expected a share or bytes")]
    NothingToRecord,
    #[error(
        "references cannot be recorded by nodes on {host}, which does not see the output folder: expected host.shared_files = true"
    )]
    NoSharedFiles { host: String },
    #[error(
        "{address} is an address that other machines can reach: expected --keys DIR (`marti keys new DIR` makes them), or --insecure in a network that you trust"
    )]
    NoKeys { address: String },
    #[error(transparent)]
    Keys(#[from] KeysError),
    #[error("{0}")]
    Tiling(String),
    #[error("cluster.local_memory: {0}")]
    LocalMemory(#[from] machine::hardware::local_memory::GeometryError),
    #[error("--chaos: {0}")]
    Chaos(#[from] chaos::NoSuchSlot),
    #[error(transparent)]
    Health(#[from] HealthError),
    /// What is to be resumed cannot be.
    #[error(transparent)]
    Journal(#[from] JournalError),
    /// The error names the file.
    #[error("{0}")]
    Output(io::Error),
    #[error(transparent)]
    Folder(#[from] OutputError),
    #[error(transparent)]
    Telemetry(#[from] TelemetryError),
    #[error("the system has no {what}: {error}")]
    System { what: &'static str, error: String },
}

impl RunError {
    /// Whether what was asked for cannot be right, however often it is tried.
    pub fn is_bad_input(&self) -> bool {
        match self {
            Self::Preparation(_)
            | Self::Warnings
            | Self::Planes
            | Self::NothingToRecord
            | Self::NoSharedFiles { .. }
            | Self::NoKeys { .. }
            | Self::Keys(_)
            | Self::Tiling(_)
            | Self::LocalMemory(_)
            | Self::Chaos(_) => true,
            Self::Journal(error) => matches!(error, JournalError::Header { .. }),
            Self::Health(error) => matches!(error, HealthError::NotLoopback(_)),
            // A folder that another process has may be free the next time.
            Self::Folder(error) => matches!(error, OutputError::Foreign { .. } | OutputError::NotUnicode(_)),
            Self::Telemetry(error) => matches!(error, TelemetryError::Level),
            _ => false,
        }
    }
}

/// Where a run leaves the topology that it resolved, in its folder.
pub fn resolved_topology(out: &Path) -> PathBuf {
    out.join(output_folder::TOPOLOGY_NAME)
}

/// The report in a run's folder, if it says that the run is done, and the image that it is of is there.
pub fn finished(out: &Path) -> Option<Report> {
    let report = json::read(&output_folder::report(out)).ok()?;
    let Image { files, file_sha256, .. } = &report.image;
    // The folder may have been moved since.
    let is_there = |file: &PathBuf| file.file_name().is_some_and(|name| out.join(name).is_file());
    let is_of_this_image = file_sha256.is_some() && *file_sha256 == output_folder::image_sha256(out);
    (report.status == Status::Done && files.iter().all(is_there) && is_of_this_image).then_some(report)
}

/// Renders a topology with all its processes; returns when none of them lives any more.
///
/// # Errors
/// The scene is wrong, the output folder is another's or cannot be written, or a process failed that cannot be replaced.
pub fn run(request: RunRequest) -> Result<RunOutcome, RunError> {
    let start = Instant::now();
    let programs = Programs::of_this_process()
        .map_err(|error| RunError::System { what: "path of this program", error: error.to_string() })?;
    let RunRequest { topology, out, .. } = &request;
    if request.record_references && topology.cluster.local_memory.size == MemorySize::All {
        return Err(RunError::NothingToRecord);
    }
    let placement = topology.placement();
    if request.record_references
        && let Some(host) = placement.nodes_without_files()
    {
        return Err(RunError::NoSharedFiles { host: host.name.clone() });
    }
    let first = placement.of_manager();
    let listen = request.listen.unwrap_or((first.interface(), first.port).into());
    let warning = match open_address(listen, &placement).filter(|_| request.keys.is_none()) {
        Some(address) if !request.insecure => return Err(RunError::NoKeys { address }),
        Some(address) => Some(format!("{address} is used without keys: who can reach it can read all that is said")),
        None if request.insecure && request.keys.is_some() => Some("--insecure has no effect beside --keys".to_owned()),
        None if request.insecure => {
            Some("--insecure has no effect: no other machine can reach the addresses of this run".to_owned())
        }
        None => None,
    };
    let Keys { tls, identities } = match &request.keys {
        Some(folder) => Keys::read(folder, &placement, &topology.cluster)?,
        None => Keys::default(),
    };
    let faults = faults(&request)?;
    let opening = if request.resume { Opening::Resume } else { Opening::Anew { force: request.force } };
    let mut folder = OutputFolder::open(out, topology, opening)?;
    let prepared = topology.prepare()?;
    scene_warnings::show(&prepared.warnings);
    if request.strict && prepared.warnings.iter().any(preparation::is_certain) {
        return Err(RunError::Warnings);
    }
    let database = prepared.database.database();
    let image = prepared.view.image;
    let tiling = topology.image.tiling(image.width(), image.height()).map_err(RunError::Tiling)?;
    let memory = closing::memory_shape(topology, &database.header.layout)?;

    let scene_sha256 = Sha256::digest(database.bytes()).into();
    let fingerprint = fingerprint(&scene_sha256, &prepared.view);
    let aov = if request.resume {
        // What an interrupted run has begun to hold is held to the end.
        let journal = output_folder::journal(out);
        let aov = Journal::planes(&journal).unwrap_or(request.aov);
        if !request.aov.is_empty() && request.aov != aov {
            return Err(RunError::Planes);
        }
        Journal::check(&journal, &Subject { tiling, aov, fingerprint })?;
        aov
    } else {
        request.aov
    };

    match telemetry::start(Some(&folder.logs().join("manager.log"))) {
        // A second run in one process goes on in the first one's log.
        Err(TelemetryError::Started) => {}
        started => started?,
    }
    let secret = secret()?;
    let plan = Plan {
        id: secret.run_id(),
        key: MacKey::new(token::random_bytes().map_err(no_randomness)?),
        cluster: topology.cluster,
        placement,
        octree: topology.octree,
        run: topology.run,
        header: database.header.clone(),
        view: prepared.view.clone(),
        tiling,
        aov,
        exr: request.exr,
        record_references: request.record_references,
        journal: output_folder::journal(out),
        resume: request.resume,
        fingerprint,
        image: folder.image(),
        recording: folder.recording(),
    };
    let joiners_token = (plan.placement.has_joiners() && request.keys.is_none()).then(|| folder.join_token());
    if let Some(path) = &joiners_token {
        token::write(path, secret.of(Role::Manager, Epoch::JOINING)).map_err(RunError::Output)?;
    }
    let run = shell::Run {
        start,
        programs,
        credentials: Credentials { tls, joiners: plan.placement.has_joiners(), ..Credentials::plain(secret) },
        identities,
        warnings: warning.into_iter().chain(folder.warning()).collect(),
        listen,
        words: Arc::clone(&database.words),
        health: request.health,
        quiet: request.quiet,
        faults,
    };
    let facts = closing::Facts::new(topology, &prepared, memory);
    let seal = || recorded::seal(topology, &prepared, &scene_sha256, tiling, memory.local_bytes);
    let recorded = request.record_references.then(seal).transpose().map_err(RunError::Output)?;
    let runtime = event_queue().map_err(|error| RunError::System { what: "descriptor", error: error.to_string() })?;
    // The buses hold the database; the manager keeps its words alone, for buses that come later.
    drop(prepared);
    let finished = runtime.block_on(run.finish(plan, &mut folder));
    if let Some(path) = joiners_token {
        // Nobody can use it any more.
        let _ = std::fs::remove_file(path);
    }
    let (state, chaos) = finished?;
    // Whatever still lives is killed with its task.
    drop(runtime);

    folder.end();
    // What is in the folder's recording may be an earlier run's; a run that was interrupted early may have none.
    let has_begun = !matches!(state.over(), Some(Cause::Interrupted(_))) || folder.recording().is_dir();
    let recorded = recorded.filter(|_| folder.failed_start().is_none() && has_begun);
    let (checks, unsealed) = match recorded.map(|seal| recorded::close(&seal, &state, &folder.recording())) {
        Some(Err(error)) => (Vec::new(), Some(format!("the recording cannot be closed: {error}"))),
        sealed => (sealed.and_then(Result::ok).unwrap_or_default(), None),
    };
    let mut report = Report { chaos, ..closing::report(&state, facts, checks, start.elapsed()) };
    report.image.file_sha256 = output_folder::image_sha256(out).filter(|_| !report.image.files.is_empty());
    if let (None, Some(why)) = (&report.error, unsealed) {
        (report.status, report.error) = (Status::Failed, Some(why));
    }
    let written = json::write(&report, &folder.report());
    if let Some(why) = &report.error {
        let report_lacks = written.err().map(|error| format!("; there is no report: {error}"));
        let place = folder.failed_start().map(|place| {
            let earlier = if folder.has_put_aside() { "there and in earlier" } else { "as it was" };
            format!("; logs and report are in {}, and what an earlier run left is {earlier}", place.display())
        });
        let why = [Some(why.clone()), report_lacks, place].into_iter().flatten().collect();
        return Ok(RunOutcome { end: RunEnd::Failed(why), out: request.out, report });
    }
    written.map_err(RunError::Output)?;
    let end = match state.over() {
        Some(Cause::Complete) => RunEnd::Done,
        Some(Cause::Interrupted(signal)) => RunEnd::Interrupted(*signal),
        Some(Cause::Failed(_) | Cause::NoNodes) | None => RunEnd::TilesMissing,
    };
    Ok(RunOutcome { end, out: request.out, report })
}

fn faults(request: &RunRequest) -> Result<Vec<chaos::Fault>, chaos::NoSuchSlot> {
    let cluster = &request.topology.cluster;
    let cast = chaos::Cast { clusters: cluster.count, nodes: cluster.all_nodes() };
    request.chaos.as_ref().map_or(Ok(Vec::new()), |schedule| schedule.faults(cast))
}

/// SHA-256 of all that decides the image's bits: the database, by its own, the view and its settings.
fn fingerprint(scene_sha256: &[u8; 32], view: &View) -> [u8; 32] {
    let mut hash = Sha256::new();
    hash.update(scene_sha256);
    hash.update(format!("{view:?}"));
    hash.finalize().into()
}

/// What the manager and the processes that it starts prove themselves with.
#[derive(Default)]
struct Keys {
    tls: Option<Tls>,
    identities: Vec<Identity>,
}

impl Keys {
    /// Who joins brings its own: a manager that starts no node needs no node's keys.
    fn read(folder: &Path, placement: &Placement, cluster: &Cluster) -> Result<Self, KeysError> {
        let identities = RoleKind::ALL.into_iter().filter(|&kind| plan::starts(placement, cluster, kind));
        Ok(Self {
            tls: Some(Tls::new(&Identity::read(folder, RoleKind::Manager)?)?),
            identities: identities.map(|kind| Identity::read(folder, kind)).collect::<Result<_, _>>()?,
        })
    }
}

/// What other machines could knock at, if anything.
fn open_address(listen: SocketAddr, placement: &Placement) -> Option<String> {
    let first = (!listen.ip().is_loopback()).then(|| listen.ip().to_string());
    first.or_else(|| placement.open_address())
}

fn secret() -> Result<RunToken, RunError> {
    token::random().map_err(no_randomness)
}

fn no_randomness(error: io::Error) -> RunError {
    RunError::System { what: "random numbers", error: error.to_string() }
}
