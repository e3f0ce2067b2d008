//! A port that admits known peers only, and names the others.

use std::io;
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio::sync::mpsc;
use tokio::task::{AbortHandle, JoinSet};
use tokio::time::{MissedTickBehavior, interval};

use super::handshake::{HELLO_DEADLINE, Peer, accept};
use super::strangers::Strangers;
use super::{Connection, ConnectionError, Credentials, Fault};
use crate::protocol::hello::Role;
use ground::ids::Epoch;

/// Connections that have not said hello yet. Each takes some 10 KiB, under TLS some 30.
const STRANGERS_MAX: usize = 256;
/// Connections that the system makes before this process looks: who comes while there are so many dials again, by his
/// system, after a second.
const BACKLOG: u32 = 4096;
/// Arrivals that the process has not looked at yet.
const ARRIVALS_MAX: usize = 64;
/// Refusals that are reported one by one: so many, and then so many a period.
const REFUSALS_MAX: u32 = 32;
const REFUSALS_A_PERIOD: u32 = 2;
const REFUSALS_PERIOD: Duration = Duration::from_secs(1);
/// Pause after the system could not accept (out of file descriptors, as a rule), and for how long that may go on: less than
/// the 30 s after which a node gives up a server that does not answer, so that the server alone is replaced.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);
const ACCEPT_DEADLINE: Duration = Duration::from_secs(10);

/// What came to a port: a peer, or the reason why somebody was refused, or why nobody can come
/// ([`ConnectionError::is_of_this_process`]).
pub type Arrival = Result<(Peer, Connection), ConnectionError>;

/// Accepts and greets in tasks of its own until it is dropped.
#[derive(Debug)]
pub struct Listener {
    address: SocketAddr,
    arrivals: mpsc::Receiver<Arrival>,
}

impl Listener {
    /// Binds a free port of an interface. `admits` says whether there is a place for a role and epoch, and
    /// if not, what was expected. Called inside a tokio runtime.
    ///
    /// # Errors
    /// The interface cannot be bound.
    pub async fn bind(
        interface: IpAddr,
        credentials: Credentials,
        admits: impl Fn(Role, Epoch) -> Result<(), String> + Send + Sync + 'static,
    ) -> io::Result<Self> {
        Self::bind_to((interface, 0).into(), credentials, admits).await
    }

    /// As [`Self::bind`], with a port that somebody chose; 0 is a free one.
    ///
    /// # Errors
    /// The address cannot be bound.
    pub async fn bind_to(
        address: SocketAddr,
        credentials: Credentials,
        admits: impl Fn(Role, Epoch) -> Result<(), String> + Send + Sync + 'static,
    ) -> io::Result<Self> {
        let socket = if address.is_ipv4() { TcpSocket::new_v4() } else { TcpSocket::new_v6() }?;
        // A port that somebody chose can be bound again while connections of an earlier run linger.
        socket.set_reuseaddr(true)?;
        socket.bind(address)?;
        let listener = socket.listen(BACKLOG)?;
        let address = listener.local_addr()?;
        let (sender, arrivals) = mpsc::channel(ARRIVALS_MAX);
        let acceptor = Acceptor { listener, failures: 0 };
        tokio::spawn(accept_until_dropped(acceptor, sender, Arc::new(credentials), Arc::new(admits)));
        Ok(Self { address, arrivals })
    }

    /// The address it really got.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The next peer or refusal. May be cancelled without losing one.
    pub async fn arrival(&mut self) -> Arrival {
        match self.arrivals.recv().await {
            Some(arrival) => arrival,
            // The task that accepts ends after this receiver only.
            None => std::future::pending().await,
        }
    }
}

async fn accept_until_dropped<A>(
    mut acceptor: Acceptor,
    arrivals: mpsc::Sender<Arrival>,
    credentials: Arc<Credentials>,
    admits: Arc<A>,
) where
    A: Fn(Role, Epoch) -> Result<(), String> + Send + Sync + 'static,
{
    let mut greeted = JoinSet::new();
    let mut strangers: Strangers<AbortHandle> = Strangers::new(STRANGERS_MAX);
    let mut told = Told { budget: REFUSALS_MAX, untold: 0 };
    let mut tick = interval(REFUSALS_PERIOD);
    tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
    // An error of sending means that the listener was dropped meanwhile.
    loop {
        tokio::select! {
            () = arrivals.closed() => return,
            Some(outcome) = greeted.join_next() => {
                // Who was sent away was counted.
                let Ok((number, arrival)) = outcome else { continue };
                strangers.leave(number);
                if told.may_tell(&arrival) {
                    let _ = arrivals.send(arrival).await;
                }
            }
            accepted = acceptor.next() => {
                let (stream, address) = match accepted {
                    Ok(accepted) => accepted,
                    Err(error) => {
                        let fault = Fault::NotAccepting { deadline: ACCEPT_DEADLINE, error };
                        let _ = arrivals.send(Err(fault.of(&"its port".into()))).await;
                        continue;
                    }
                };
                let (number, credentials, admits) = (strangers.next(), Arc::clone(&credentials), Arc::clone(&admits));
                let handle = greeted.spawn(async move {
                    (number, accept(stream, &credentials, &*admits, HELLO_DEADLINE).await)
                });
                if let Some(crowded_out) = strangers.enter(address.ip(), handle) {
                    crowded_out.abort();
                    told.untold += 1;
                }
            }
            _ = tick.tick() => if let Some(summary) = told.refill() {
                let _ = arrivals.send(Err(summary)).await;
            },
        }
    }
}

/// Accepts connections, and goes on where the system lets it accept none.
struct Acceptor {
    listener: TcpListener,
    /// In a row.
    failures: u32,
}

impl Acceptor {
    /// The next connection. May be cancelled without losing one.
    ///
    /// # Errors
    /// There were only failures for [`ACCEPT_DEADLINE`]; the last one. May be called again.
    async fn next(&mut self) -> io::Result<(TcpStream, SocketAddr)> {
        loop {
            let error = match self.listener.accept().await {
                Ok(accepted) => {
                    self.failures = 0;
                    return Ok(accepted);
                }
                Err(error) => error,
            };
            if self.failures == 0 {
                tracing::warn!("cannot accept a connection: {error}");
            }
            self.failures += 1;
            if ACCEPT_PAUSE * self.failures > ACCEPT_DEADLINE {
                self.failures = 0;
                return Err(error);
            }
            tokio::time::sleep(ACCEPT_PAUSE).await;
        }
    }
}

/// How many refusals are reported one by one: a flood of them is reported as one.
struct Told {
    budget: u32,
    untold: u64,
}

impl Told {
    fn may_tell(&mut self, arrival: &Arrival) -> bool {
        if arrival.is_ok() {
            return true;
        }
        let left = self.budget.checked_sub(1);
        match left {
            Some(left) => self.budget = left,
            None => self.untold += 1,
        }
        left.is_some()
    }

    fn refill(&mut self) -> Option<ConnectionError> {
        self.budget = (self.budget + REFUSALS_A_PERIOD).min(REFUSALS_MAX);
        match std::mem::take(&mut self.untold) {
            0 => None,
            many => {
                let why = "more came than can be greeted, and whoever had not said hello made room".to_owned();
                Some(Fault::Refused(why).of(&format!("{many} more connections").into()))
            }
        }
    }
}
