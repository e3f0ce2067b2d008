//! One TCP connection between two processes that know each other: frames in, frames out.
//!
//! [`handshake`] makes one, [`listener`] makes many, [`blocking`] is the kind for plain threads. Every
//! write has a deadline; a read has one where the caller names it.

pub mod blocking;
pub mod credentials;
mod halves;
pub mod handshake;
pub mod listener;
pub mod read_buffer;
pub mod socket;
mod strangers;
pub mod tls;
mod tls_words;

use std::io;
use std::marker::PhantomData;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use bytes::{Buf, BytesMut};
use futures_util::StreamExt;
use tokio::io::AsyncWriteExt;
use tokio::time::timeout;
use tokio_util::codec::{Decoder, FramedRead};

pub use blocking::BlockingConnection;
pub use credentials::{Credentials, Introduction};
pub use handshake::{Peer, accept, connect};
pub use listener::{Arrival, Listener};
pub use socket::Socket;
pub use tls::Tls;

use self::halves::{ReadHalf, Stream, WriteHalf};
use super::hello::HELLO_BYTES_MAX;
use crate::protocol::frame::{self, CodecError, Message};

/// A frame that cannot be written within this time means a peer that no longer reads.
pub const WRITE_DEADLINE: Duration = Duration::from_secs(10);

/// Buffers grow by what has arrived, in steps of this, never by what a length claims.
const READ_BYTES: usize = 256 << 10;

/// What went wrong on a connection, and with whom.
#[derive(Debug, thiserror::Error)]
#[error("{peer}: {fault}")]
pub struct ConnectionError {
    /// Role and address as far as they are known.
    pub peer: Arc<str>,
    pub fault: Fault,
}

#[derive(Debug, thiserror::Error)]
pub enum Fault {
    #[error("{0}")]
    Io(io::Error),
    #[error("the connection was closed in the middle of a frame")]
    Torn,
    #[error("the connection was closed")]
    Closed,
    #[error("{0}")]
    Frame(#[from] CodecError),
    #[error("silent for {} ms while {awaited} was expected", deadline.as_millis())]
    Silent { awaited: &'static str, deadline: Duration },
    #[error("did not read for {} ms", deadline.as_millis())]
    Stuck { deadline: Duration },
    #[error("did not read {messages} messages")]
    Unread { messages: usize },
    /// A message that has no place at this point of the conversation.
    #[error("{0}")]
    Unexpected(String),
    /// The two sides do not agree on TLS, or on who they are.
    #[error("{0}")]
    Tls(String),
    /// The other side's words.
    #[error("it refused this process: {0}")]
    RefusedUs(String),
    /// Our words about the other side.
    #[error("refused: {0}")]
    Refused(String),
    /// Of a port of this process, not of a peer.
    #[error("no connection was accepted for {} s: {error}", deadline.as_secs())]
    NotAccepting { deadline: Duration, error: io::Error },
}

impl From<io::Error> for Fault {
    fn from(error: io::Error) -> Self {
        if let Some(error) = error.get_ref().and_then(|inner| inner.downcast_ref::<rustls::Error>()) {
            return Self::Tls(tls_words::words(error));
        }
        match error.kind() {
            io::ErrorKind::UnexpectedEof => Self::Torn,
            io::ErrorKind::ConnectionReset | io::ErrorKind::BrokenPipe => Self::Closed,
            _ => Self::Io(error),
        }
    }
}

impl ConnectionError {
    /// Whether no peer is at fault, but the system lets this process accept none.
    pub fn is_of_this_process(&self) -> bool {
        matches!(self.fault, Fault::NotAccepting { .. })
    }
}

impl Fault {
    fn of(self, peer: &Arc<str>) -> ConnectionError {
        ConnectionError { peer: Arc::clone(peer), fault: self }
    }
}

/// Cuts what arrives into frames. Reserves room for what has arrived, not for what is claimed.
#[derive(Debug)]
struct FrameDecoder {
    bytes_max: usize,
}

impl Decoder for FrameDecoder {
    type Item = BytesMut;
    type Error = Fault;

    fn decode(&mut self, received: &mut BytesMut) -> Result<Option<BytesMut>, Fault> {
        let Some(bytes) = frame::frame_bytes(received, self.bytes_max)? else {
            return Ok(None);
        };
        let missing = (frame::PREFIX_BYTES + bytes).saturating_sub(received.len());
        if missing > 0 {
            received.reserve(missing.min(READ_BYTES));
            return Ok(None);
        }
        received.advance(frame::PREFIX_BYTES);
        Ok(Some(received.split_to(bytes)))
    }

    fn decode_eof(&mut self, received: &mut BytesMut) -> Result<Option<BytesMut>, Fault> {
        match self.decode(received)? {
            None if !received.is_empty() => Err(Fault::Torn),
            frame => Ok(frame),
        }
    }
}

/// A connection whose handshake is done, or about to be.
#[derive(Debug)]
pub struct Connection {
    frames: FramedRead<ReadHalf, FrameDecoder>,
    writer: WriteHalf,
    peer: Arc<str>,
    local: SocketAddr,
}

impl Connection {
    /// No frame may be longer than a hello until [`Self::split`] says what is expected.
    fn new(stream: Stream, peer: Arc<str>) -> io::Result<Self> {
        let local = stream.prepare()?;
        let (reader, writer) = stream.split();
        Ok(Self { frames: FramedRead::new(reader, FrameDecoder { bytes_max: HELLO_BYTES_MAX }), writer, peer, local })
    }

    /// Role and address of the other side, for errors.
    pub fn peer(&self) -> &Arc<str> {
        &self.peer
    }

    /// The address of this side: one at which the other side reaches this host.
    pub fn local_address(&self) -> SocketAddr {
        self.local
    }

    /// The two directions of a conversation, whose frames may be as long as its messages allow.
    pub fn split<Out: Message, In: Message>(self) -> (Sender<Out>, Receiver<In>) {
        let (sender, receiver) = self.split_frames(frame::frame_bytes_max::<In>());
        let sender = Sender { frames: sender, buffer: Vec::new(), message: PhantomData };
        (sender, Receiver { frames: receiver, message: PhantomData })
    }

    /// The two directions as frames, of which those that come have at most so many bytes.
    pub fn split_frames(mut self, bytes_max: usize) -> (FrameSender, FrameReceiver) {
        self.frames.decoder_mut().bytes_max = bytes_max;
        let sender = FrameSender { writer: self.writer, peer: Arc::clone(&self.peer), wire_bytes: 0 };
        (sender, FrameReceiver { frames: self.frames, peer: self.peer, wire_bytes: 0 })
    }

    /// The bare socket, non-blocking, for a loop that does its own reading.
    ///
    /// # Errors
    /// The peer has sent more than its hello already, which no conversation allows.
    pub fn into_std(self) -> Result<Socket<std::net::TcpStream>, ConnectionError> {
        if !self.frames.read_buffer().is_empty() {
            return Err(Fault::Refused("it spoke before it was welcome".to_owned()).of(&self.peer));
        }
        halves::reunite(self.frames.into_inner(), self.writer).map_err(|error| Fault::from(error).of(&self.peer))
    }
}

/// The direction in which frames go out.
#[derive(Debug)]
pub struct FrameSender {
    writer: WriteHalf,
    peer: Arc<str>,
    wire_bytes: u64,
}

impl FrameSender {
    /// Sends a whole frame, its length included.
    ///
    /// # Errors
    /// The peer is gone, or does not read within [`WRITE_DEADLINE`].
    pub async fn send(&mut self, frame: impl Buf) -> Result<(), ConnectionError> {
        let bytes = frame.remaining();
        write_frame(&mut self.writer, frame, WRITE_DEADLINE).await.map_err(|fault| fault.of(&self.peer))?;
        self.wire_bytes += bytes as u64;
        Ok(())
    }

    /// Bytes sent since the handshake.
    pub fn wire_bytes(&self) -> u64 {
        self.wire_bytes
    }

    /// What is wrong with what was to be sent to this peer.
    pub fn error(&self, fault: impl Into<Fault>) -> ConnectionError {
        fault.into().of(&self.peer)
    }

    /// Tells the peer that nothing more comes; it can still be listened to.
    pub async fn finish(mut self) {
        // An error means that the peer is gone, which is the aim.
        let _ = timeout(WRITE_DEADLINE, self.writer.shutdown()).await;
    }
}

/// The direction in which messages of one kind go out.
#[derive(Debug)]
pub struct Sender<M> {
    frames: FrameSender,
    buffer: Vec<u8>,
    message: PhantomData<fn(M)>,
}

impl<M: Message> Sender<M> {
    /// # Errors
    /// The peer is gone, does not read within [`WRITE_DEADLINE`], or the message is too long.
    pub async fn send(&mut self, message: &M) -> Result<(), ConnectionError> {
        self.send_with_bulk(message, [].as_slice()).await
    }

    /// The bulk bytes, in one piece or several, are not copied.
    ///
    /// # Errors
    /// As [`Self::send`].
    pub async fn send_with_bulk(&mut self, message: &M, bulk: impl Buf) -> Result<(), ConnectionError> {
        self.buffer.clear();
        frame::encode_head(message, bulk.remaining(), &mut self.buffer)
            .map_err(|error| Fault::from(error).of(&self.frames.peer))?;
        self.frames.send(self.buffer.as_slice().chain(bulk)).await
    }

    /// Bytes sent since the handshake.
    pub fn wire_bytes(&self) -> u64 {
        self.frames.wire_bytes
    }

    /// Tells the peer that nothing more comes; it can still be listened to.
    pub async fn finish(self) {
        self.frames.finish().await;
    }
}

async fn write_frame(writer: &mut WriteHalf, mut frame: impl Buf, deadline: Duration) -> Result<(), Fault> {
    let written = async {
        writer.write_all_buf(&mut frame).await?;
        // Under TLS, what was taken is not sent yet.
        writer.flush().await
    };
    match timeout(deadline, written).await {
        Ok(written) => Ok(written?),
        Err(_) => Err(Fault::Stuck { deadline }),
    }
}

/// The direction from which frames come in.
#[derive(Debug)]
pub struct FrameReceiver {
    frames: FramedRead<ReadHalf, FrameDecoder>,
    peer: Arc<str>,
    wire_bytes: u64,
}

impl FrameReceiver {
    /// What follows the length of the next frame; `None` when the peer closed between two. May be cancelled without losing
    /// one.
    ///
    /// # Errors
    /// The connection is torn, or a frame is too long: nothing more can be received.
    pub async fn receive(&mut self) -> Result<Option<BytesMut>, ConnectionError> {
        let Some(frame) = self.frames.next().await else {
            return Ok(None);
        };
        let frame = frame.map_err(|fault| fault.of(&self.peer))?;
        self.wire_bytes += (frame::PREFIX_BYTES + frame.len()) as u64;
        Ok(Some(frame))
    }

    /// Bytes received since the handshake, in whole frames.
    pub fn wire_bytes(&self) -> u64 {
        self.wire_bytes
    }

    /// What is wrong with what this peer sent.
    pub fn error(&self, fault: impl Into<Fault>) -> ConnectionError {
        fault.into().of(&self.peer)
    }
}

/// The direction from which messages of one kind come in.
#[derive(Debug)]
pub struct Receiver<M> {
    frames: FrameReceiver,
    message: PhantomData<fn() -> M>,
}

impl<M: Message> Receiver<M> {
    pub fn peer(&self) -> &Arc<str> {
        &self.frames.peer
    }

    /// Bytes received since the handshake, in whole frames.
    pub fn wire_bytes(&self) -> u64 {
        self.frames.wire_bytes
    }

    /// The next message, which has no bulk bytes; `None` when the peer closed between two frames. May be
    /// cancelled without losing a frame.
    ///
    /// # Errors
    /// The connection is torn, or what came is not such a message: nothing more can be received.
    pub async fn receive(&mut self) -> Result<Option<M>, ConnectionError> {
        let Some(frame) = self.frames.receive().await? else {
            return Ok(None);
        };
        frame::decode_whole(&frame).map(Some).map_err(|error| self.frames.error(error))
    }

    /// As [`Self::receive`], with the bulk bytes that follow the message.
    ///
    /// # Errors
    /// As [`Self::receive`].
    pub async fn receive_with_bulk(&mut self) -> Result<Option<(M, BytesMut)>, ConnectionError> {
        let Some(mut frame) = self.frames.receive().await? else {
            return Ok(None);
        };
        let (message, bulk) = frame::decode::<M>(&frame).map_err(|error| self.frames.error(error))?;
        let message_bytes = frame.len() - bulk.len();
        frame.advance(message_bytes);
        Ok(Some((message, frame)))
    }

    /// As [`Self::receive`], but silence until the deadline is an error.
    ///
    /// # Errors
    /// As [`Self::receive`], or the deadline passed; the connection is as it was then.
    pub async fn receive_within(&mut self, deadline: Duration) -> Result<Option<M>, ConnectionError> {
        match timeout(deadline, self.receive()).await {
            Ok(received) => received,
            Err(_) => Err(self.frames.error(Fault::Silent { awaited: M::NAME, deadline })),
        }
    }
}

#[cfg(test)]
mod refusal_tests;
#[cfg(test)]
mod tests;
