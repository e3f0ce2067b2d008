//! A process that was not spawned: it asks the manager for a place until it gets one, and begins anew when the run has
//! failed under it.

use std::io::ErrorKind;
use std::net::{IpAddr, SocketAddr};
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{self, Command};
use std::time::Duration;

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;
use tokio::signal::unix::{SignalKind, signal};
use tokio::time::{Instant, sleep, timeout, timeout_at};

use super::event_queue::event_queue;
use super::{listening, token};
use crate::keys::Identity;
use crate::protocol::connection::{Introduction, Tls, connect};
use crate::protocol::control::Bootstrap;
use crate::protocol::hello::{Hello, Role, RunToken};
use crate::protocol::join::{JoinReply, JoinRequest};
use ground::ids::Epoch;

/// For the manager to answer the hello.
const CONNECT_DEADLINE: Duration = Duration::from_secs(5);
/// Between two signs of life of a manager that has no place.
const REPLY_DEADLINE: Duration = Duration::from_secs(10);
const PAUSE_MIN: Duration = Duration::from_millis(100);
const PAUSE_MAX: Duration = Duration::from_secs(5);

/// Where a process gets its place from.
#[derive(Clone, Debug)]
pub enum Origin {
    /// From the manager that spawned it, by standard input.
    Spawned,
    Joining(Box<Joining>),
}

/// Whom to join, and as what.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Joining {
    /// Name or IP address of the manager's host; looked up again for every try.
    pub manager: String,
    pub port: u16,
    /// The run's token, by its file, which is read again for every try: another run has another one.
    pub token: Option<PathBuf>,
    /// Its keys: a folder of `marti keys new`, or the file of this role; read again for every try.
    pub keys: Option<PathBuf>,
    /// The host of the topology to have a place on; `None`: any.
    pub host: Option<String>,
    /// Where a server listens, and under what others reach it, instead of what the topology says.
    pub bind: Option<IpAddr>,
    pub advertise: Option<String>,
    /// How long to try.
    pub patience: Duration,
    /// Where to report whether it has a place, on this host alone.
    pub health: Option<SocketAddr>,
}

#[derive(Debug, thiserror::Error)]
pub enum JoinError {
    #[error("no place at {manager} within {} s; the last reason: {why}", patience.as_secs_f64())]
    NoPlace { manager: String, patience: Duration, why: String },
    #[error("cannot wait: {0}")]
    System(std::io::Error),
    /// The keys or the token of this process itself; no manager can help.
    #[error("{0}")]
    OwnSecret(String),
}

/// Why a try came to nothing.
enum Refusal {
    /// Another try may come to more.
    Later(String),
    /// None will.
    Never(String),
}

/// Asks for a place until there is one. Ends the process where the run is over without it.
///
/// # Errors
/// There was none in time.
pub(super) fn join(role: Role, joining: &Joining) -> Result<Bootstrap, JoinError> {
    let runtime = event_queue().map_err(JoinError::System)?;
    runtime.block_on(ask(role, joining))
}

async fn ask(role: Role, joining: &Joining) -> Result<Bootstrap, JoinError> {
    let late = Instant::now() + joining.patience;
    let mut pauses = Pauses::new(process::id());
    let mut why = "nobody answered".to_owned();
    loop {
        match timeout_at(late, try_once(role, joining)).await {
            Ok(Ok(bootstrap)) => return Ok(bootstrap),
            Ok(Err(Refusal::Never(error))) => return Err(JoinError::OwnSecret(error)),
            Ok(Err(Refusal::Later(error))) if error != why => {
                tracing::warn!("no place yet: {error}");
                why = error;
            }
            Ok(Err(_)) => {}
            Err(_) => break,
        }
        if timeout_at(late, sleep(pauses.next())).await.is_err() {
            break;
        }
    }
    Err(JoinError::NoPlace {
        manager: format!("{}:{}", joining.manager, joining.port),
        patience: joining.patience,
        why,
    })
}

/// One conversation with the manager; it may last as long as the manager lives and has no place.
async fn try_once(role: Role, joining: &Joining) -> Result<Bootstrap, Refusal> {
    let identity = identity(role, joining)?;
    let introduction = introduction(role, joining, identity.as_ref())?;
    let bootstrap = ask_once(joining, &introduction).await.map_err(Refusal::Later)?;
    Ok(Bootstrap { identity, ..bootstrap })
}

async fn ask_once(joining: &Joining, introduction: &Introduction) -> Result<Bootstrap, String> {
    let said = |error: &dyn std::fmt::Display| error.to_string();
    let like = joining.bind.unwrap_or([127, 0, 0, 1].into());
    let address = listening::look_up(&joining.manager, joining.port, like).await.map_err(|error| said(&error))?;
    let connection =
        connect(Role::Manager, address, introduction, CONNECT_DEADLINE).await.map_err(|error| said(&error))?;
    let (mut sender, mut receiver) = connection.split::<JoinRequest, JoinReply>();
    sender.send(&JoinRequest { host: joining.host.clone() }).await.map_err(|error| said(&error))?;
    loop {
        match receiver.receive_within(REPLY_DEADLINE).await.map_err(|error| said(&error))? {
            Some(JoinReply::Wait) => {}
            Some(JoinReply::Place(bootstrap)) => {
                return Ok(Bootstrap {
                    // It has answered here.
                    manager: address,
                    bind: joining.bind.or(bootstrap.bind),
                    advertise: joining.advertise.clone().or(bootstrap.advertise),
                    ..*bootstrap
                });
            }
            Some(JoinReply::Over) => {
                tracing::info!("the run is over");
                process::exit(0);
            }
            None => return Err(format!("the manager at {address} closed the connection")),
        }
    }
}

fn identity(role: Role, joining: &Joining) -> Result<Option<Identity>, Refusal> {
    let read = |path: &PathBuf| Identity::read(path, role.kind()).map_err(|error| Refusal::Never(error.to_string()));
    joining.keys.as_ref().map(read).transpose()
}

/// Without a token a certificate must do. A token's file may be there once the run is.
fn introduction(role: Role, joining: &Joining, identity: Option<&Identity>) -> Result<Introduction, Refusal> {
    let refusal = |error: std::io::Error| match error.kind() {
        ErrorKind::NotFound => Refusal::Later(error.to_string()),
        _ => Refusal::Never(error.to_string()),
    };
    let token = match &joining.token {
        Some(path) => token::read(path).map_err(refusal)?,
        None => RunToken::new([0; 32]),
    };
    let tls = identity.map(Tls::new).transpose().map_err(|error| Refusal::Never(error.to_string()))?;
    Ok(Introduction { hello: Hello::new(role, Epoch::JOINING, token), tls })
}

/// Ever longer, up to a bound, and not the same for processes that were started together.
struct Pauses {
    next: Duration,
    random: Pcg32,
}

impl Pauses {
    fn new(seed: u32) -> Self {
        Self { next: PAUSE_MIN, random: Pcg32::seed_from_u64(u64::from(seed)) }
    }

    /// Half to all of what doubles every time.
    fn next(&mut self) -> Duration {
        let pause = self.next;
        self.next = (pause * 2).min(PAUSE_MAX);
        pause.mul_f64(0.5 + 0.5 * f64::from(self.random.next_u32()) / 2f64.powi(32))
    }
}

/// The same program with the same arguments in the place of this process, which has a clean slate then. Returns only
/// where that is not possible.
pub fn begin_anew() {
    if is_asked_to_go(PAUSE_MIN) {
        process::exit(0);
    }
    let error = std::env::current_exe().map(|program| Command::new(program).args(std::env::args_os().skip(1)).exec());
    let (Ok(error) | Err(error)) = error;
    tracing::error!("cannot begin anew: {error}");
}

/// Whether SIGTERM arrives in this time. A node's handler is still there and would swallow it.
fn is_asked_to_go(within: Duration) -> bool {
    let Ok(runtime) = event_queue() else { return false };
    runtime.block_on(async {
        let Ok(mut terminate) = signal(SignalKind::terminate()) else { return false };
        timeout(within, terminate.recv()).await.is_ok()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_grow_to_a_bound_and_differ() {
        let pauses = |seed| {
            let mut pauses = Pauses::new(seed);
            (0..12).map(|_| pauses.next()).collect::<Vec<_>>()
        };
        for (i, pause) in pauses(1).into_iter().enumerate() {
            let longest = (PAUSE_MIN * (1 << i)).min(PAUSE_MAX);
            assert!(longest / 2 <= pause && pause <= longest, "{i}: {pause:?}");
        }
        assert_eq!(pauses(1), pauses(1));
        assert_ne!(pauses(1), pauses(2));
    }
}
