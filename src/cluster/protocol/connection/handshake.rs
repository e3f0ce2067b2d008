//! Who speaks: the hello of the side that dialled, the judgement of the side that listens.

use std::fmt;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use bytes::BytesMut;
use futures_util::StreamExt;
use tokio::net::TcpStream;
use tokio::time::{Instant, timeout, timeout_at};

use super::halves::Stream;
use super::{Connection, ConnectionError, Credentials, Fault, Introduction, write_frame};
use crate::keys::RoleKind;
use crate::protocol::frame::{self, CodecError, Message};
use crate::protocol::hello::{Hello, HelloPrelude, HelloReply, MAGIC, PROTOCOL_VERSION, Role};
use ground::ids::Epoch;

/// From accepting a connection until its hello is whole.
pub const HELLO_DEADLINE: Duration = Duration::from_secs(2);

/// Who dialled, as the hello says and the token proves.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Peer {
    pub role: Role,
    pub epoch: Epoch,
    pub address: SocketAddr,
}

impl fmt::Display for Peer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.epoch {
            Epoch::JOINING => write!(f, "a process that joins, at {}", self.address),
            epoch => write!(f, "{} ({epoch}) at {}", self.role, self.address),
        }
    }
}

/// Dials the process that holds `role` and introduces this one.
///
/// # Errors
/// Nobody answers within the deadline, or this process is refused.
pub async fn connect(
    role: Role,
    address: SocketAddr,
    introduction: &Introduction,
    deadline: Duration,
) -> Result<Connection, ConnectionError> {
    let peer: Arc<str> = format!("{role} at {address}").into();
    match timeout(deadline, introduce(role, address, introduction, deadline, &peer)).await {
        Ok(introduced) => introduced.map_err(|fault| fault.of(&peer)),
        Err(_) => Err(Fault::Silent { awaited: HelloReply::NAME, deadline }.of(&peer)),
    }
}

async fn introduce(
    role: Role,
    address: SocketAddr,
    introduction: &Introduction,
    deadline: Duration,
    peer: &Arc<str>,
) -> Result<Connection, Fault> {
    let stream = TcpStream::connect(address).await.map_err(Fault::Io)?;
    let stream = match &introduction.tls {
        None => Stream::Plain(stream),
        Some(tls) => Stream::Tls(Box::new(tls.connect(role.kind(), stream).await?)),
    };
    let mut connection = Connection::new(stream, Arc::clone(peer))?;
    write_frame(&mut connection.writer, frame::encode(&introduction.hello, &[])?.as_slice(), deadline).await?;
    let frame = next_frame(&mut connection).await.map_err(unless_tls)?;
    judge_reply(&frame)?;
    Ok(connection)
}

pub(super) fn judge_reply(frame: &[u8]) -> Result<(), Fault> {
    match frame::decode::<HelloReply>(frame)? {
        (HelloReply::Welcome, _) => Ok(()),
        (HelloReply::Refused(why), _) => Err(Fault::RefusedUs(why)),
    }
}

async fn next_frame(connection: &mut Connection) -> Result<BytesMut, Fault> {
    connection.frames.next().await.unwrap_or(Err(Fault::Closed))
}

/// Where a plain frame was expected, TLS begins like one of a gigabyte.
pub(super) fn unless_tls(fault: Fault) -> Fault {
    match fault {
        // A handshake or an alert, of any version.
        Fault::Frame(CodecError::FrameTooLong { bytes, .. }) if matches!(bytes >> 16, 0x1603 | 0x1503) => {
            Fault::Tls("it speaks TLS, which is not expected here: give both sides keys, or neither".to_owned())
        }
        other => other,
    }
}

/// Reads the hello of a connection that was accepted, and answers it. `admits` says whether the listener
/// has a place for that role and epoch, and if not, what it expected.
///
/// # Errors
/// The peer is refused: its hello is late, too long, torn, garbage, of another version, without the run's
/// token, or not admitted. The error names its address and what was expected.
pub async fn accept(
    stream: TcpStream,
    credentials: &Credentials,
    admits: impl Fn(Role, Epoch) -> Result<(), String>,
    deadline: Duration,
) -> Result<(Peer, Connection), ConnectionError> {
    let address = stream.peer_addr();
    let unknown: Arc<str> = match &address {
        Ok(address) => address.to_string().into(),
        Err(_) => "a peer that left at once".into(),
    };
    let late = Instant::now() + deadline;
    let accepted = async {
        let address = address?;
        let (stream, certified) = match &credentials.tls {
            None => (Stream::Plain(stream), None),
            Some(tls) => {
                let accepted = timeout_at(late, tls.accept(stream)).await;
                let (stream, kind) = accepted.map_err(|_| Fault::Silent { awaited: "a TLS handshake", deadline })??;
                (Stream::Tls(Box::new(stream)), Some(kind))
            }
        };
        let mut connection = Connection::new(stream, Arc::clone(&unknown))?;
        let hello = match timeout_at(late, next_frame(&mut connection)).await {
            Ok(Ok(frame)) => judge(&frame, certified, credentials, admits),
            Ok(Err(fault)) => Err(unless_tls(fault)),
            Err(_) => Err(Fault::Silent { awaited: "a hello", deadline }),
        };
        let reply = match &hello {
            Ok(_) => HelloReply::Welcome,
            Err(Fault::Refused(why)) => HelloReply::Refused(why.clone()),
            Err(fault) => HelloReply::Refused(fault.to_string()),
        };
        let answered = write_frame(&mut connection.writer, frame::encode(&reply, &[])?.as_slice(), deadline).await;
        let hello = hello?;
        answered?;
        let peer = Peer { role: hello.role, epoch: hello.epoch, address };
        connection.peer = peer.to_string().into();
        Ok((peer, connection))
    };
    accepted.await.map_err(|fault: Fault| fault.of(&unknown))
}

/// Under TLS, `certified` is the role that the peer's certificate names.
fn judge(
    frame: &[u8],
    certified: Option<Option<RoleKind>>,
    credentials: &Credentials,
    admits: impl Fn(Role, Epoch) -> Result<(), String>,
) -> Result<Hello, Fault> {
    let prelude = frame::decode::<HelloPrelude>(frame);
    let Ok((HelloPrelude { magic: MAGIC, version }, _)) = prelude else {
        return Err(Fault::Refused("expected the hello of a marti process".to_owned()));
    };
    if version != PROTOCOL_VERSION {
        return Err(Fault::Refused(format!("it speaks protocol version {version}, expected {PROTOCOL_VERSION}")));
    }
    let (hello, _) = frame::decode::<Hello>(frame)?;
    if let Some(certified) = certified.filter(|certified| *certified != Some(hello.role.kind())) {
        let found = certified.map_or("no role", RoleKind::name);
        return Err(Fault::Refused(format!("it says that it is {}, its certificate is that of {found}", hello.role)));
    }
    let comes_by_certificate = credentials.joiners && certified.is_some() && hello.epoch == Epoch::JOINING;
    if hello.token != credentials.token.of(hello.role, hello.epoch) && !comes_by_certificate {
        return Err(Fault::Refused(format!("{} has not the token of this run", hello.role)));
    }
    admits(hello.role, hello.epoch).map_err(|expected| {
        Fault::Refused(format!("{} ({}) has no business here, expected {expected}", hello.role, hello.epoch))
    })?;
    Ok(hello)
}
