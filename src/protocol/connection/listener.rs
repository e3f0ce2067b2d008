//! A port that admits known peers only, and names the others.

use std::io;
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, mpsc};

use super::handshake::{HELLO_DEADLINE, Peer, accept};
use super::{Connection, ConnectionError, Credentials};
use crate::ids::Epoch;
use crate::protocol::hello::Role;

/// Connections that have not said hello yet; further ones wait in the system's queue.
const STRANGERS_MAX: usize = 64;
/// Arrivals that the process has not looked at yet.
const ARRIVALS_MAX: usize = 64;
/// Pause after the system could not accept (out of file descriptors, as a rule).
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// What came to a port: a peer, or the reason why somebody was refused.
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
        let listener = TcpListener::bind(address).await?;
        let address = listener.local_addr()?;
        let (sender, arrivals) = mpsc::channel(ARRIVALS_MAX);
        tokio::spawn(accept_until_dropped(listener, sender, Arc::new(credentials), Arc::new(admits)));
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
    listener: TcpListener,
    arrivals: mpsc::Sender<Arrival>,
    credentials: Arc<Credentials>,
    admits: Arc<A>,
) where
    A: Fn(Role, Epoch) -> Result<(), String> + Send + Sync + 'static,
{
    let strangers = Arc::new(Semaphore::new(STRANGERS_MAX));
    loop {
        tokio::select! {
            () = arrivals.closed() => return,
            next = next_stranger(&listener, &strangers) => {
                let (stream, permit) = next;
                let (arrivals, credentials, admits) = (arrivals.clone(), Arc::clone(&credentials), Arc::clone(&admits));
                tokio::spawn(async move {
                    let arrival = accept(stream, &credentials, &*admits, HELLO_DEADLINE).await;
                    drop(permit);
                    // An error means that the listener was dropped meanwhile.
                    let _ = arrivals.send(arrival).await;
                });
            }
        }
    }
}

async fn next_stranger(listener: &TcpListener, strangers: &Arc<Semaphore>) -> (TcpStream, OwnedSemaphorePermit) {
    loop {
        let Ok(permit) = Arc::clone(strangers).acquire_owned().await else {
            return std::future::pending().await;
        };
        match listener.accept().await {
            Ok((stream, _)) => return (stream, permit),
            Err(error) => {
                tracing::warn!("cannot accept a connection: {error}");
                tokio::time::sleep(ACCEPT_PAUSE).await;
            }
        }
    }
}
