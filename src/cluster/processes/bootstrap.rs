//! How a process comes to life that `marti` is not: what the manager hands down, the log, the control connection.

use std::fmt::Display;
use std::future::Future;
use std::io::{self, IsTerminal, Read};
use std::mem::discriminant;
use std::net::{IpAddr, SocketAddr};
use std::process;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::sync_channel;
use std::thread;
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::{MissedTickBehavior, interval};

use crate::keys::KeysError;
use crate::protocol::connection::{ConnectionError, Credentials, Introduction, Tls};
use crate::protocol::control::Bootstrap;
use crate::protocol::frame::{self, CodecError, PREFIX_BYTES};
use crate::protocol::hello::{Hello, Role};
use ground::pulse::{Beacon, Pulse};
use ground::telemetry::{self, TelemetryError};

use super::event_queue::event_queue;
use super::health::{self, Health, HealthError, Metric};
use super::join::{self, JoinError, Origin};
use super::listening;

/// The manager writes the bootstrap at once after spawning.
const BOOTSTRAP_DEADLINE: Duration = Duration::from_secs(5);
/// How often a process's main thread shows that its event queue turns.
const TURN_PERIOD: Duration = Duration::from_millis(500);

/// A process that the manager spawned, or that joined it.
#[derive(Clone, Debug)]
pub struct Child {
    pub bootstrap: Bootstrap,
    /// Joined: it begins anew when its run has failed.
    pub joined: bool,
    /// Of the threads that must not get stuck.
    pub pulse: Pulse,
    tls: Option<Tls>,
    /// Gets its health, where that is served.
    health: Option<watch::Sender<Health>>,
    /// Asked to go.
    leaving: Arc<AtomicBool>,
}

#[derive(Debug, thiserror::Error)]
pub enum StartError {
    #[error("{program} is started by `marti run`, or joins one by --join ({why})")]
    ByHand { program: &'static str, why: String },
    #[error("{program} was told to be a {role}")]
    WrongRole { program: &'static str, role: Role },
    #[error(transparent)]
    Telemetry(#[from] TelemetryError),
    #[error("manager: {0}")]
    Manager(#[from] ConnectionError),
    #[error(transparent)]
    Join(#[from] JoinError),
    #[error(transparent)]
    Keys(#[from] KeysError),
    #[error(transparent)]
    Health(#[from] HealthError),
    #[error("cannot start a thread: {0}")]
    Thread(io::Error),
    #[error("{0}")]
    System(io::Error),
}

impl Child {
    /// Reads the bootstrap from standard input, or asks the manager for a place, and starts the log. `role` is this
    /// program's; its number does not count.
    ///
    /// # Errors
    /// Standard input is a terminal, ends early, is silent for 5 s, or holds something else; nobody has a place for
    /// this process in time; the bootstrap is for another role; the log cannot be opened; the address of its health
    /// cannot be had.
    pub fn start(program: &'static str, role: Role, origin: &Origin) -> Result<Self, StartError> {
        let (bootstrap, joined, health) = match origin {
            Origin::Spawned => (read_in_time().map_err(|why| StartError::ByHand { program, why })?, false, None),
            Origin::Joining(joining) => {
                telemetry::start(None)?;
                let health = joining.health.map(health::serve_aside).transpose()?;
                (join::join(role, joining)?, true, health)
            }
        };
        if discriminant(&bootstrap.role) != discriminant(&role) {
            return Err(StartError::WrongRole { program, role: bootstrap.role });
        }
        if !joined {
            telemetry::start(bootstrap.log.as_deref())?;
        }
        tracing::info!("{program} {} as {} ({})", env!("CARGO_PKG_VERSION"), bootstrap.role, bootstrap.epoch);
        Ok(Self { health, ..Self::new(bootstrap, joined)? })
    }

    /// # Errors
    /// Its keys cannot be used.
    pub(super) fn new(bootstrap: Bootstrap, joined: bool) -> Result<Self, StartError> {
        let tls = bootstrap.identity.as_ref().map(Tls::new).transpose()?;
        let pulse = Pulse::default();
        Ok(Self { bootstrap, joined, pulse, tls, health: None, leaving: Arc::default() })
    }

    /// How this process introduces itself, to whomever it dials.
    pub fn introduction(&self) -> Introduction {
        let Bootstrap { role, epoch, token, .. } = self.bootstrap;
        match role {
            Role::Node(_) => Introduction { hello: Hello::new(role, epoch, token), tls: self.tls.clone() },
            _ => self.credentials().introduction(role, epoch),
        }
    }

    /// What this process asks of those who dial it.
    pub fn credentials(&self) -> Credentials {
        Credentials { tls: self.tls.clone(), ..Credentials::plain(self.bootstrap.token) }
    }

    /// Notes that this process was asked to go: whatever becomes of its run, it joins no other.
    pub(super) fn leave(&self) {
        self.leaving.store(true, Ordering::Relaxed);
    }

    pub fn is_leaving(&self) -> bool {
        self.leaving.load(Ordering::Relaxed)
    }

    /// Ends this process, whose manager is gone or that is stuck: at once, whatever its other threads do.
    pub(super) fn end_at_once(&self) -> ! {
        if self.is_leaving() {
            process::exit(0);
        }
        if self.joined {
            join::begin_anew();
        }
        process::exit(1)
    }

    /// Reports its health: it is ready while its control connection is open.
    pub(super) fn tell(&self, ready: bool) {
        let Some(health) = &self.health else { return };
        let (role, epoch) = (self.bootstrap.role, self.bootstrap.epoch.0);
        let place = Metric::gauge("place", "Whether it has this place.", f64::from(ready)).of("role", role);
        health.send_replace(Health { ready, metrics: vec![place.of("epoch", epoch)] });
    }

    /// Where a server of this process listens; `reached` is its end of the control connection.
    pub(super) fn interface(&self, reached: IpAddr) -> IpAddr {
        self.bootstrap.bind.unwrap_or(reached)
    }

    /// Under which address others reach a server of this process.
    ///
    /// # Errors
    /// The name that is to be advertised is not known.
    pub(super) async fn advertised(&self, listens: SocketAddr, reached: IpAddr) -> io::Result<SocketAddr> {
        listening::advertised(self.bootstrap.advertise.as_deref(), listens, reached).await
    }
}

/// Lives a process' life on this thread, shows that the thread's event queue turns, and logs what goes wrong.
pub(super) fn live<T, E: From<StartError> + Display>(
    child: &Child,
    life: impl Future<Output = Result<T, E>>,
) -> Result<T, E> {
    let lived = event_queue().map_err(|error| StartError::System(error).into()).and_then(|runtime| {
        runtime.spawn(show_turns(child.pulse.beacon("main")));
        runtime.block_on(life)
    });
    lived.inspect_err(|error| tracing::error!("{error}"))
}

async fn show_turns(beacon: Beacon) {
    let mut tick = interval(TURN_PERIOD);
    tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        tick.tick().await;
        beacon.turn();
    }
}

/// Standard input has no deadline of its own, hence the thread; it ends with the process at the latest.
fn read_in_time() -> Result<Bootstrap, String> {
    let input = std::io::stdin();
    if input.is_terminal() {
        return Err("standard input is a terminal".to_owned());
    }
    let (sender, receiver) = sync_channel(1);
    thread::Builder::new()
        .name("bootstrap".to_owned())
        // An error means that the deadline has passed.
        .spawn(move || drop(sender.send(read(&mut input.lock()))))
        .map_err(|error| error.to_string())?;
    receiver
        .recv_timeout(BOOTSTRAP_DEADLINE)
        .unwrap_or_else(|_| Err(format!("nothing on standard input for {} s", BOOTSTRAP_DEADLINE.as_secs())))
}

fn read(input: &mut impl Read) -> Result<Bootstrap, String> {
    let mut received = vec![0; PREFIX_BYTES];
    input.read_exact(&mut received).map_err(|_| "standard input is empty".to_owned())?;
    let too_long = |error: CodecError| format!("standard input holds {error}");
    let bytes = frame::frame_bytes(&received, frame::frame_bytes_max::<Bootstrap>()).map_err(too_long)?;
    received.resize(bytes.unwrap_or_default(), 0);
    input.read_exact(&mut received).map_err(|_| "standard input ends early".to_owned())?;
    let (bootstrap, _) = frame::decode(&received).map_err(|error| format!("standard input is {error}"))?;
    Ok(bootstrap)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::hello::RunToken;
    use ground::ids::{Epoch, NodeId};

    fn bootstrap() -> Bootstrap {
        Bootstrap {
            role: Role::Node(NodeId(3)),
            epoch: Epoch(1),
            token: RunToken::new([7; 32]),
            manager: ([127, 0, 0, 1], 4242).into(),
            identity: None,
            bind: Some([127, 0, 0, 2].into()),
            advertise: Some("there.example".to_owned()),
            log: Some("logs/node-3.log".into()),
            heartbeat_milliseconds: 250,
        }
    }

    #[test]
    fn a_bootstrap_is_read_back() {
        let frame = frame::encode(&bootstrap(), &[]).expect("short");
        assert_eq!(read(&mut frame.as_slice()), Ok(bootstrap()));
    }

    #[test]
    fn anything_else_says_what_it_is() {
        let frame = frame::encode(&bootstrap(), &[]).expect("short");
        let refused = |mut input: &[u8]| read(&mut input).expect_err("not a bootstrap");
        assert_eq!(refused(b""), "standard input is empty");
        assert_eq!(refused(&frame[..20]), "standard input ends early");
        assert!(refused(&[0xff; 64]).contains("at most 32768"), "a claim of 4 GiB");
        assert!(refused(&[0, 0, 0, 4, 9, 9, 9, 9]).contains("not a Bootstrap"));
    }
}
