//! A connection for a plain thread, where a request is a round trip and latency is everything.

use std::io::{ErrorKind, Write};
use std::marker::PhantomData;
use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::handshake::{judge_reply, unless_tls};
use super::read_buffer::{ReadBuffer, would_block};
use super::socket::Socket;
use super::{ConnectionError, Fault, Introduction, READ_BYTES, WRITE_DEADLINE};
use crate::protocol::frame::{self, Message};
use crate::protocol::hello::{HELLO_BYTES_MAX, HelloReply, Role};

/// Sends `Out`, receives `In`. One write and one read a round trip where the frames are small; nothing is
/// allocated once the buffers have grown to the largest frame.
#[derive(Debug)]
pub struct BlockingConnection<Out, In> {
    socket: Socket<TcpStream>,
    peer: Arc<str>,
    /// For a whole frame to arrive.
    deadline: Duration,
    outgoing: Vec<u8>,
    incoming: ReadBuffer,
    messages: PhantomData<fn(Out) -> In>,
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
        introduction: &Introduction,
        deadline: Duration,
    ) -> Result<Self, ConnectionError> {
        let peer: Arc<str> = format!("{role} at {address}").into();
        Self::introduce(role, address, introduction, deadline, &peer).map_err(|fault| fault.of(&peer))
    }

    fn introduce(
        role: Role,
        address: SocketAddr,
        introduction: &Introduction,
        deadline: Duration,
        peer: &Arc<str>,
    ) -> Result<Self, Fault> {
        let stream = TcpStream::connect_timeout(&address, deadline).map_err(Fault::Io)?;
        stream.set_nodelay(true)?;
        stream.set_write_timeout(Some(WRITE_DEADLINE))?;
        let mut socket = match &introduction.tls {
            None => Socket::Plain(stream),
            Some(tls) => tls.connect_blocking(role.kind(), stream, deadline)?,
        };
        socket.inner_mut().set_read_timeout(Some(deadline))?;
        let mut connection = Self {
            socket,
            peer: Arc::clone(peer),
            deadline,
            outgoing: frame::encode(&introduction.hello, &[])?,
            incoming: ReadBuffer::with_room(READ_BYTES),
            messages: PhantomData,
        };
        connection.write_outgoing()?;
        let bytes = connection.await_frame(HELLO_BYTES_MAX, HelloReply::NAME).map_err(unless_tls)?;
        judge_reply(connection.incoming.take(bytes))?;
        Ok(connection)
    }

    /// An error of this conversation, with the peer's name.
    pub fn error(&self, fault: Fault) -> ConnectionError {
        fault.of(&self.peer)
    }

    /// # Errors
    /// The peer is gone, does not read within [`WRITE_DEADLINE`], or the message is too long.
    pub fn send(&mut self, message: &Out, bulk: &[u8]) -> Result<(), ConnectionError> {
        self.outgoing.clear();
        frame::encode_into(message, &mut self.outgoing, |out| out.extend_from_slice(bulk))
            .map_err(Fault::from)
            .and_then(|()| self.write_outgoing())
            .map_err(|fault| fault.of(&self.peer))
    }

    fn write_outgoing(&mut self) -> Result<(), Fault> {
        let written = self.socket.write_all(&self.outgoing).and_then(|()| self.socket.flush());
        written
            .map_err(|error| if would_block(&error) { Fault::Stuck { deadline: WRITE_DEADLINE } } else { error.into() })
    }

    /// The next message and its bulk bytes.
    ///
    /// # Errors
    /// The peer is gone, is silent until the deadline, or what came is not such a message: nothing more
    /// can be received.
    pub fn receive(&mut self) -> Result<(In, &[u8]), ConnectionError> {
        match self.await_frame(frame::frame_bytes_max::<In>(), In::NAME) {
            Ok(bytes) => frame::decode(self.incoming.take(bytes)).map_err(|error| Fault::from(error).of(&self.peer)),
            Err(fault) => Err(fault.of(&self.peer)),
        }
    }
}

impl<Out, In> BlockingConnection<Out, In> {
    /// Bytes of the next frame, its length included, once it is whole.
    fn await_frame(&mut self, bytes_max: usize, awaited: &'static str) -> Result<usize, Fault> {
        let deadline = self.deadline;
        // Asked for when the first read did not bring the whole frame: the clock costs.
        let mut late = None;
        loop {
            if let Some(bytes) = self.incoming.whole_frame(bytes_max)? {
                return Ok(bytes);
            }
            if late.is_some_and(|late| Instant::now() >= late) {
                return Err(Fault::Silent { awaited, deadline });
            }
            match self.incoming.fill_from(&mut self.socket) {
                Ok(_) => {}
                Err(Fault::Io(error)) if error.kind() == ErrorKind::Interrupted => {}
                Err(Fault::Io(error)) if would_block(&error) => return Err(Fault::Silent { awaited, deadline }),
                Err(fault) => return Err(fault),
            }
            late.get_or_insert_with(|| Instant::now() + deadline);
        }
    }
}
