//! A connection for a plain thread, where a request is a round trip and latency is everything.

use std::io::{ErrorKind, Read, Write};
use std::marker::PhantomData;
use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::handshake::judge_reply;
use super::{ConnectionError, Fault, READ_BYTES, WRITE_DEADLINE};
use crate::codec::{self, Message};
use crate::protocol::hello::{HELLO_BYTES_MAX, Hello, HelloReply, Role};

/// Sends `Out`, receives `In`. One write and one read a round trip where the frames are small; nothing is
/// allocated once the buffers have grown to the largest frame.
#[derive(Debug)]
pub struct BlockingConnection<Out, In> {
    stream: TcpStream,
    peer: Arc<str>,
    /// For a whole frame to arrive.
    deadline: Duration,
    outgoing: Vec<u8>,
    incoming: Incoming,
    messages: PhantomData<fn(Out) -> In>,
}

/// Bytes received and not yet handed out: `buffer[start..end]`.
#[derive(Debug)]
struct Incoming {
    buffer: Vec<u8>,
    start: usize,
    end: usize,
}

impl<Out: Message, In: Message> BlockingConnection<Out, In> {
    /// Dials the process that holds `role` and introduces this one. The deadline holds for connecting and
    /// for every reply from then on.
    ///
    /// # Errors
    /// Nobody answers within the deadline, or this process is refused.
    pub fn connect(
        role: Role,
        address: SocketAddr,
        hello: &Hello,
        deadline: Duration,
    ) -> Result<Self, ConnectionError> {
        let peer: Arc<str> = format!("{role} at {address}").into();
        Self::introduce(address, hello, deadline, &peer).map_err(|fault| fault.of(&peer))
    }

    fn introduce(address: SocketAddr, hello: &Hello, deadline: Duration, peer: &Arc<str>) -> Result<Self, Fault> {
        let stream = TcpStream::connect_timeout(&address, deadline).map_err(Fault::Io)?;
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(deadline))?;
        stream.set_write_timeout(Some(WRITE_DEADLINE))?;
        let incoming = Incoming { buffer: vec![0; READ_BYTES], start: 0, end: 0 };
        let mut connection = Self {
            stream,
            peer: Arc::clone(peer),
            deadline,
            outgoing: codec::encode(hello, &[])?,
            incoming,
            messages: PhantomData,
        };
        connection.write_outgoing()?;
        judge_reply(connection.incoming.frame(&connection.stream, HELLO_BYTES_MAX, deadline, HelloReply::NAME)?)?;
        Ok(connection)
    }

    pub fn peer(&self) -> &Arc<str> {
        &self.peer
    }

    /// # Errors
    /// The peer is gone, does not read within [`WRITE_DEADLINE`], or the message is too long.
    pub fn send(&mut self, message: &Out, bulk: &[u8]) -> Result<(), ConnectionError> {
        self.outgoing.clear();
        codec::encode_into(message, &mut self.outgoing, |out| out.extend_from_slice(bulk))
            .map_err(Fault::from)
            .and_then(|()| self.write_outgoing())
            .map_err(|fault| fault.of(&self.peer))
    }

    fn write_outgoing(&mut self) -> Result<(), Fault> {
        self.stream.write_all(&self.outgoing).map_err(|error| match error.kind() {
            ErrorKind::WouldBlock | ErrorKind::TimedOut => Fault::Stuck { deadline: WRITE_DEADLINE },
            _ => error.into(),
        })
    }

    /// The next message and its bulk bytes.
    ///
    /// # Errors
    /// The peer is gone, is silent until the deadline, or what came is not such a message: nothing more
    /// can be received.
    pub fn receive(&mut self) -> Result<(In, &[u8]), ConnectionError> {
        self.incoming
            .frame(&self.stream, codec::frame_bytes_max::<In>(), self.deadline, In::NAME)
            .and_then(|frame| Ok(codec::decode(frame)?))
            .map_err(|fault| fault.of(&self.peer))
    }
}

impl Incoming {
    /// Hands out the next frame, without its length.
    fn frame(
        &mut self,
        mut stream: &TcpStream,
        bytes_max: usize,
        deadline: Duration,
        awaited: &'static str,
    ) -> Result<&[u8], Fault> {
        // Asked for when the first read did not bring the whole frame: the clock costs.
        let mut late = None;
        loop {
            let received = self.buffer.get(self.start..self.end).unwrap_or_default();
            let needed = match codec::frame_bytes(received, bytes_max)? {
                Some(bytes) if received.len() >= codec::PREFIX_BYTES + bytes => {
                    let first = self.start + codec::PREFIX_BYTES;
                    self.start = first + bytes;
                    return Ok(&self.buffer[first..first + bytes]);
                }
                Some(bytes) => codec::PREFIX_BYTES + bytes,
                None => codec::PREFIX_BYTES,
            };
            self.make_room(needed);
            match stream.read(&mut self.buffer[self.end..]) {
                Ok(0) if self.start == self.end => return Err(Fault::Closed),
                Ok(0) => return Err(Fault::Torn),
                Ok(bytes) => self.end += bytes,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                    return Err(Fault::Silent { awaited, deadline });
                }
                Err(error) => return Err(error.into()),
            }
            if self.end - self.start < needed
                && Instant::now() >= *late.get_or_insert_with(|| Instant::now() + deadline)
            {
                return Err(Fault::Silent { awaited, deadline });
            }
        }
    }

    /// Makes room behind what has been received: by moving it to the front, then by doubling, never to
    /// more than the frame needs.
    fn make_room(&mut self, needed: usize) {
        if self.start > 0 {
            self.buffer.copy_within(self.start..self.end, 0);
            self.end -= self.start;
            self.start = 0;
        }
        if self.end == self.buffer.len() {
            self.buffer.resize((self.buffer.len() * 2).min(needed.max(READ_BYTES)), 0);
        }
    }
}
