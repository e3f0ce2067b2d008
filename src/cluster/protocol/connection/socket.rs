//! A socket for those who do their own system calls, plain or under TLS, blocking or not.

use std::io::{self, ErrorKind, Read, Write};

use super::read_buffer::would_block;

/// Reads and writes as `S` does: an error that would block may be tried again.
#[derive(Debug)]
pub enum Socket<S> {
    Plain(S),
    Tls(Box<TlsSocket<S>>),
}

/// A session whose handshake is done, and what carries it.
#[derive(Debug)]
pub struct TlsSocket<S> {
    session: rustls::Connection,
    socket: S,
    /// The last read took all there was.
    drained: bool,
}

impl<S> Socket<S> {
    pub(super) fn tls(session: rustls::Connection, socket: S) -> Self {
        Self::Tls(Box::new(TlsSocket { session, socket, drained: false }))
    }

    /// The same connection, on what `change` makes of its socket.
    pub fn map<T>(self, change: impl FnOnce(S) -> T) -> Socket<T> {
        match self {
            Self::Plain(socket) => Socket::Plain(change(socket)),
            Self::Tls(tls) => {
                let TlsSocket { session, socket, drained } = *tls;
                Socket::Tls(Box::new(TlsSocket { session, socket: change(socket), drained }))
            }
        }
    }

    /// For polling.
    pub fn inner_mut(&mut self) -> &mut S {
        match self {
            Self::Plain(socket) => socket,
            Self::Tls(tls) => &mut tls.socket,
        }
    }

    /// Whether more may wait than a read has shown that did not fill its buffer. Under TLS a read hands out a record,
    /// and more of them may be there.
    pub fn holds_more(&self) -> bool {
        match self {
            Self::Plain(_) => false,
            Self::Tls(tls) => !tls.drained,
        }
    }
}

impl<S: Read + Write> Read for Socket<S> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Plain(socket) => socket.read(into),
            Self::Tls(tls) => tls.read(into),
        }
    }
}

impl<S: Read + Write> Write for Socket<S> {
    /// Under TLS, what was taken may still have to be sent: [`Self::flush`] does.
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::Plain(socket) => socket.write(bytes),
            Self::Tls(tls) => tls.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Plain(socket) => socket.flush(),
            Self::Tls(tls) => tls.send(),
        }
    }
}

impl<S: Read + Write> TlsSocket<S> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        loop {
            match self.session.reader().read(into) {
                Err(error) if error.kind() == ErrorKind::WouldBlock => {}
                // As of a plain socket: frames show whether something is missing, and no conversation takes its end for
                // a message.
                Err(error) if error.kind() == ErrorKind::UnexpectedEof => return Ok(0),
                read => return read,
            }
            let mut watched = Watched { socket: &mut self.socket, drained: &mut self.drained };
            if self.session.read_tls(&mut watched)? == 0 {
                return Ok(0);
            }
            if let Err(error) = self.session.process_new_packets() {
                // Tells the peer why, if it takes it at once.
                let _ = self.send();
                return Err(io::Error::new(ErrorKind::InvalidData, error));
            }
        }
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        // No more is taken than one write's worth while the socket takes nothing.
        self.send()?;
        let taken = self.session.writer().write(bytes)?;
        match self.send() {
            Err(error) if !would_block(&error) => Err(error),
            _ => Ok(taken),
        }
    }

    fn send(&mut self) -> io::Result<()> {
        while self.session.wants_write() {
            match self.session.write_tls(&mut self.socket) {
                Ok(0) => return Err(ErrorKind::WriteZero.into()),
                Err(error) if error.kind() != ErrorKind::Interrupted => return Err(error),
                _ => {}
            }
        }
        Ok(())
    }
}

struct Watched<'a, S> {
    socket: &'a mut S,
    drained: &'a mut bool,
}

impl<S: Read> Read for Watched<'_, S> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let bytes = self.socket.read(into)?;
        *self.drained = bytes < into.len();
        Ok(bytes)
    }
}
