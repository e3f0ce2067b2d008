//! The two directions of one TCP connection, plain or under TLS, each for a task of its own.

use std::io::{self, IoSlice};
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Waker, ready};

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio_rustls::TlsStream;

use super::socket::Socket;

/// A connection that is not split yet.
#[derive(Debug)]
pub(super) enum Stream {
    Plain(TcpStream),
    Tls(Box<TlsStream<TcpStream>>),
}

/// Both directions of a TLS session share its state; neither holds the lock while it waits.
type Shared = Arc<Mutex<TlsStream<TcpStream>>>;

#[derive(Debug)]
pub(super) enum ReadHalf {
    Plain(OwnedReadHalf),
    Tls(Shared),
}

/// The stream to the peer ends when this is dropped.
#[derive(Debug)]
pub(super) enum WriteHalf {
    Plain(OwnedWriteHalf),
    Tls(TlsWriter),
}

#[derive(Debug)]
pub(super) struct TlsWriter(Option<Shared>);

impl Stream {
    fn tcp(&self) -> &TcpStream {
        match self {
            Self::Plain(stream) => stream,
            Self::Tls(stream) => stream.get_ref().0,
        }
    }

    /// Sends each write at once; returns the address of this side.
    pub(super) fn prepare(&self) -> io::Result<SocketAddr> {
        self.tcp().set_nodelay(true)?;
        self.tcp().local_addr()
    }

    pub(super) fn split(self) -> (ReadHalf, WriteHalf) {
        match self {
            Self::Plain(stream) => {
                let (reader, writer) = stream.into_split();
                (ReadHalf::Plain(reader), WriteHalf::Plain(writer))
            }
            Self::Tls(stream) => {
                let shared = Arc::new(Mutex::new(*stream));
                (ReadHalf::Tls(Arc::clone(&shared)), WriteHalf::Tls(TlsWriter(Some(shared))))
            }
        }
    }
}

/// The bare socket of two halves that were split.
pub(super) fn reunite(reader: ReadHalf, writer: WriteHalf) -> io::Result<Socket<std::net::TcpStream>> {
    let apart = || io::Error::other("two halves of different connections");
    match (reader, writer) {
        (ReadHalf::Plain(reader), WriteHalf::Plain(writer)) => {
            let stream = reader.reunite(writer).map_err(|_| apart())?;
            Ok(Socket::Plain(stream.into_std()?))
        }
        (ReadHalf::Tls(shared), WriteHalf::Tls(mut writer)) => {
            drop(writer.0.take());
            let stream = Arc::into_inner(shared).ok_or_else(apart)?.into_inner().map_err(|_| apart())?;
            let (stream, session) = match stream {
                TlsStream::Client(stream) => {
                    let (stream, session) = stream.into_inner();
                    (stream, session.into())
                }
                TlsStream::Server(stream) => {
                    let (stream, session) = stream.into_inner();
                    (stream, session.into())
                }
            };
            Ok(Socket::tls(session, stream.into_std()?))
        }
        _ => Err(apart()),
    }
}

/// A panic elsewhere leaves a session that fails by itself, if at all.
fn lock(shared: &Shared) -> MutexGuard<'_, TlsStream<TcpStream>> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

impl AsyncRead for ReadHalf {
    fn poll_read(self: Pin<&mut Self>, cx: &mut Context<'_>, into: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        match self.get_mut() {
            Self::Plain(reader) => Pin::new(reader).poll_read(cx, into),
            Self::Tls(shared) => match ready!(Pin::new(&mut *lock(shared)).poll_read(cx, into)) {
                // As of a plain socket: frames show whether something is missing.
                Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Poll::Ready(Ok(())),
                read => Poll::Ready(read),
            },
        }
    }
}

impl TlsWriter {
    fn poll<T>(&self, act: impl FnOnce(Pin<&mut TlsStream<TcpStream>>) -> Poll<io::Result<T>>) -> Poll<io::Result<T>> {
        match &self.0 {
            Some(shared) => act(Pin::new(&mut *lock(shared))),
            None => Poll::Ready(Err(io::ErrorKind::NotConnected.into())),
        }
    }
}

impl Drop for TlsWriter {
    fn drop(&mut self) {
        let Some(shared) = self.0.take() else { return };
        let mut stream = lock(&shared);
        let mut cx = Context::from_waker(Waker::noop());
        // What does not fit the socket's buffer now is not sent; the end of the stream is sent in any case.
        if Pin::new(&mut *stream).poll_shutdown(&mut cx).is_pending() {
            let _ = Pin::new(stream.get_mut().0).poll_shutdown(&mut cx);
        }
    }
}

impl AsyncWrite for WriteHalf {
    fn poll_write(self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        match self.get_mut() {
            Self::Plain(writer) => Pin::new(writer).poll_write(cx, bytes),
            Self::Tls(writer) => writer.poll(|stream| stream.poll_write(cx, bytes)),
        }
    }

    fn poll_write_vectored(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        pieces: &[IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        match self.get_mut() {
            Self::Plain(writer) => Pin::new(writer).poll_write_vectored(cx, pieces),
            Self::Tls(writer) => writer.poll(|stream| stream.poll_write_vectored(cx, pieces)),
        }
    }

    fn is_write_vectored(&self) -> bool {
        true
    }

    fn poll_flush(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        match self.get_mut() {
            Self::Plain(writer) => Pin::new(writer).poll_flush(cx),
            Self::Tls(writer) => writer.poll(|stream| stream.poll_flush(cx)),
        }
    }

    fn poll_shutdown(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        match self.get_mut() {
            Self::Plain(writer) => Pin::new(writer).poll_shutdown(cx),
            Self::Tls(writer) => writer.poll(|stream| stream.poll_shutdown(cx)),
        }
    }
}
