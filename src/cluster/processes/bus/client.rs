//! One memory connection, non-blocking: what has come in, what has yet to go out.

use std::io::{ErrorKind, Write};
use std::time::{Duration, Instant};

use mio::net::TcpStream;

use crate::protocol::connection::read_buffer::{ReadBuffer, would_block};
use crate::protocol::connection::{Fault, Peer, Socket};
use crate::protocol::frame::{self, Message};
use crate::protocol::hello::Role;
use crate::protocol::memory::MemoryRequest;

/// Holds several requests without bulk bytes; the loader's grows.
const INPUT_BYTES: usize = 4 << 10;
/// A buffer that a bulk reply has made larger is given back.
const OUTPUT_BYTES_KEPT: usize = 64 << 10;

/// A peer with at most one request on the bus. Nothing is read from it while a reply is not sent whole, so
/// that its buffers hold one request and one reply at most.
#[derive(Debug)]
pub(super) struct Client {
    pub(super) socket: Socket<TcpStream>,
    pub(super) peer: Peer,
    input: ReadBuffer,
    /// A read may bring something.
    readable: bool,
    /// Replies, of which `sent` bytes are gone.
    pub(super) output: Vec<u8>,
    sent: usize,
    stuck_since: Option<Instant>,
    /// Both directions, since the handshake.
    pub(super) wire_bytes: u64,
}

impl Client {
    pub(super) fn new(socket: Socket<std::net::TcpStream>, peer: Peer) -> Self {
        Self {
            socket: socket.map(TcpStream::from_std),
            peer,
            input: ReadBuffer::with_room(INPUT_BYTES),
            readable: true,
            output: Vec::new(),
            sent: 0,
            stuck_since: None,
            wire_bytes: 0,
        }
    }

    pub(super) fn wake(&mut self) {
        self.readable = true;
    }

    /// The next request and its bulk bytes; `None` while there is none, or while a reply is not sent whole.
    pub(super) fn next_request(&mut self) -> Result<Option<(MemoryRequest, &[u8])>, Fault> {
        if !self.output.is_empty() {
            return Ok(None);
        }
        // The loader alone sends bulk bytes.
        let bytes_max = match self.peer.role {
            Role::Manager => frame::frame_bytes_max::<MemoryRequest>(),
            _ => MemoryRequest::BYTES_MAX,
        };
        loop {
            if let Some(bytes) = self.input.whole_frame(bytes_max)? {
                self.wire_bytes += bytes as u64;
                return Ok(Some(frame::decode(self.input.take(bytes))?));
            }
            if !self.readable {
                return Ok(None);
            }
            match self.input.fill_from(&mut self.socket) {
                // A short read has taken all there was: no second read is needed to learn that.
                Ok(more) => self.readable = more || self.socket.holds_more(),
                Err(Fault::Io(error)) if would_block(&error) => self.readable = false,
                Err(Fault::Io(error)) if error.kind() == ErrorKind::Interrupted => {}
                Err(fault) => return Err(fault),
            }
        }
    }

    /// Sends what the peer takes at once.
    pub(super) fn flush(&mut self) -> Result<(), Fault> {
        loop {
            let rest = self.output.get(self.sent..).unwrap_or_default();
            let written =
                if rest.is_empty() { self.socket.flush().map(|()| None) } else { self.socket.write(rest).map(Some) };
            match written {
                Ok(None) => break,
                Ok(Some(0)) => return Err(Fault::Closed),
                Ok(Some(bytes)) => {
                    self.sent += bytes;
                    self.wire_bytes += bytes as u64;
                    self.stuck_since = None;
                }
                Err(error) if would_block(&error) => {
                    self.stuck_since.get_or_insert_with(Instant::now);
                    return Ok(());
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error.into()),
            }
        }
        self.output.clear();
        self.output.shrink_to(OUTPUT_BYTES_KEPT);
        self.sent = 0;
        self.stuck_since = None;
        Ok(())
    }

    /// Whether a reply waits to be sent.
    pub(super) fn is_stuck(&self) -> bool {
        self.stuck_since.is_some()
    }

    /// Whether the peer has taken nothing of a reply for so long.
    pub(super) fn is_stuck_for(&self, deadline: Duration) -> bool {
        self.stuck_since.is_some_and(|since| since.elapsed() >= deadline)
    }
}
