//! A TCP relay that can be cut: bytes wait then, in order, and go on when it has healed. What they mean it does
//! not know, so that it serves encrypted connections as well.

use std::io::{self, ErrorKind};
use std::net::{IpAddr, SocketAddr, TcpListener as StdTcpListener};
use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;
use tokio::task::{AbortHandle, JoinSet};
use tokio::time::{Instant, sleep, sleep_until, timeout};

/// More connections than this wait in the system's queue. A process that dials has one, its successor another.
const CONNECTIONS_MAX: usize = 16;
/// On their way, in each direction of a connection.
const BYTES_MAX: usize = 64 << 10;
/// For the other side to answer; it is on this host or one hop away.
const CONNECT_DEADLINE: Duration = Duration::from_secs(5);
/// Pause after the system could not accept.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// Its connections end when it is dropped.
#[derive(Debug)]
pub(super) struct Relay {
    address: SocketAddr,
    heals: watch::Sender<Instant>,
    task: AbortHandle,
}

impl Relay {
    /// Listens on a free port of `interface` and passes everything on to `upstream`. Called inside a tokio runtime.
    ///
    /// # Errors
    /// The interface cannot be bound.
    pub(super) fn start(interface: IpAddr, upstream: SocketAddr) -> io::Result<Self> {
        let listener = StdTcpListener::bind((interface, 0))?;
        listener.set_nonblocking(true)?;
        let listener = TcpListener::from_std(listener)?;
        let address = listener.local_addr()?;
        let (heals, gate) = watch::channel(Instant::now());
        let task = tokio::spawn(serve(listener, upstream, Gate(gate))).abort_handle();
        Ok(Self { address, heals, task })
    }

    /// Where to dial instead of the other side.
    pub(super) fn address(&self) -> SocketAddr {
        self.address
    }

    /// No byte passes, no connection begins or ends, until then. Of several cuts the longest counts.
    pub(super) fn cut(&self, until: Instant) {
        self.heals.send_modify(|heals| *heals = until.max(*heals));
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.task.abort();
    }
}

/// Open but for the time of a cut.
#[derive(Clone)]
struct Gate(watch::Receiver<Instant>);

impl Gate {
    async fn opened(&self) {
        loop {
            let heals = *self.0.borrow();
            if heals <= Instant::now() {
                return;
            }
            sleep_until(heals).await;
        }
    }
}

async fn serve(listener: TcpListener, upstream: SocketAddr, gate: Gate) {
    let mut connections = JoinSet::new();
    loop {
        gate.opened().await;
        tokio::select! {
            accepted = listener.accept(), if connections.len() < CONNECTIONS_MAX => match accepted {
                Ok((stream, _)) => drop(connections.spawn(relay(stream, upstream, gate.clone()))),
                Err(error) => {
                    tracing::warn!("relay to {upstream}: {error}");
                    sleep(ACCEPT_PAUSE).await;
                }
            },
            Some(_) = connections.join_next() => {}
        }
    }
}

async fn relay(downstream: TcpStream, upstream: SocketAddr, gate: Gate) {
    // It may have come just before the cut.
    gate.opened().await;
    let relayed = async {
        let late = |_| io::Error::from(ErrorKind::TimedOut);
        let upstream = timeout(CONNECT_DEADLINE, TcpStream::connect(upstream)).await.map_err(late)??;
        downstream.set_nodelay(true)?;
        upstream.set_nodelay(true)?;
        let (from_downstream, to_downstream) = downstream.into_split();
        let (from_upstream, to_upstream) = upstream.into_split();
        // An error in one direction ends both.
        tokio::try_join!(pump(from_downstream, to_upstream, &gate), pump(from_upstream, to_downstream, &gate))
    };
    if let Err(error) = relayed.await {
        tracing::debug!("relay to {upstream}: {error}");
        gate.opened().await;
    }
}

/// Until one side ends, which the other learns as late as any byte.
async fn pump(mut from: OwnedReadHalf, mut to: OwnedWriteHalf, gate: &Gate) -> io::Result<()> {
    let mut buffer = vec![0; BYTES_MAX];
    loop {
        gate.opened().await;
        let read = from.read(&mut buffer).await?;
        let mut rest = &buffer[..read];
        while !rest.is_empty() {
            to.writable().await?;
            gate.opened().await;
            match to.try_write(rest) {
                Ok(written) => rest = &rest[written..],
                Err(error) if error.kind() == ErrorKind::WouldBlock => {}
                Err(error) => return Err(error),
            }
        }
        if read == 0 {
            gate.opened().await;
            return to.shutdown().await;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;

    use super::*;

    const BYTES: usize = 10 << 20;
    const LOOPBACK: IpAddr = IpAddr::V4(Ipv4Addr::LOCALHOST);

    /// A relay before a port that answers every byte.
    async fn before_an_echo() -> Relay {
        let listener = TcpListener::bind((LOOPBACK, 0)).await.expect("loopback");
        let relay = Relay::start(LOOPBACK, listener.local_addr().expect("bound")).expect("loopback");
        tokio::spawn(async move {
            while let Ok((stream, _)) = listener.accept().await {
                let (mut from, mut to) = stream.into_split();
                tokio::spawn(async move { tokio::io::copy(&mut from, &mut to).await });
            }
        });
        relay
    }

    fn after(milliseconds: u64) -> Instant {
        Instant::now() + Duration::from_millis(milliseconds)
    }

    #[tokio::test]
    async fn nothing_is_lost_by_cuts() {
        let relay = before_an_echo().await;
        let (mut from, mut to) = TcpStream::connect(relay.address()).await.expect("accepted").into_split();
        let sent: Vec<u8> = (0..BYTES).map(|i| ((i * i) >> 7) as u8).collect();
        let crc32c = crc32c::crc32c(&sent);
        let sender = tokio::spawn(async move {
            for piece in sent.chunks(BYTES / 100) {
                to.write_all(piece).await.expect("read");
            }
            to.shutdown().await.expect("open");
        });
        let (mut received, mut buffer, mut cuts) = (Vec::new(), vec![0; 100_000], 0);
        loop {
            let bytes = from.read(&mut buffer).await.expect("no reset");
            received.extend_from_slice(&buffer[..bytes]);
            if received.len() > cuts * BYTES / 8 && cuts < 8 {
                relay.cut(after(20));
                cuts += 1;
            }
            if bytes == 0 {
                break;
            }
        }
        sender.await.expect("sent");
        assert_eq!((received.len(), crc32c::crc32c(&received), cuts), (BYTES, crc32c, 8));
    }

    #[tokio::test]
    async fn a_cut_lets_nothing_pass_and_then_everything() {
        let relay = before_an_echo().await;
        let mut old = TcpStream::connect(relay.address()).await.expect("accepted");
        old.write_all(b"a").await.expect("open");
        assert_eq!(old.read_u8().await.expect("echoed"), b'a');
        let heals = after(300);
        relay.cut(heals);
        relay.cut(after(10));
        old.write_all(b"b").await.expect("the system takes it");
        // The system accepts a connection that the relay does not.
        let mut new = TcpStream::connect(relay.address()).await.expect("the system accepts");
        new.write_all(b"c").await.expect("the system takes it");
        let early = timeout(Duration::from_millis(200), async {
            tokio::select! {
                byte = old.read_u8() => byte,
                byte = new.read_u8() => byte,
            }
        });
        assert!(early.await.is_err(), "a deadline passes");
        assert_eq!(old.read_u8().await.expect("healed"), b'b');
        assert_eq!(new.read_u8().await.expect("healed"), b'c');
        assert!(Instant::now() >= heals);
    }

    #[tokio::test]
    async fn an_end_is_passed_on_after_the_cut() {
        let relay = before_an_echo().await;
        let mut stream = TcpStream::connect(relay.address()).await.expect("accepted");
        stream.write_all(b"a").await.expect("open");
        assert_eq!(stream.read_u8().await.expect("echoed"), b'a');
        let heals = after(100);
        relay.cut(heals);
        stream.shutdown().await.expect("open");
        assert_eq!(stream.read(&mut [0]).await.expect("no reset"), 0);
        assert!(Instant::now() >= heals);
        drop(relay);
    }

    #[tokio::test]
    async fn nobody_behind_it_is_an_end() {
        let listener = TcpListener::bind((LOOPBACK, 0)).await.expect("loopback");
        let nobody = listener.local_addr().expect("bound");
        drop(listener);
        let relay = Relay::start(LOOPBACK, nobody).expect("loopback");
        let mut stream = TcpStream::connect(relay.address()).await.expect("accepted");
        assert!(!matches!(stream.read(&mut [0]).await, Ok(1..)));
    }
}
