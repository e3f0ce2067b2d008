//! Mutual TLS 1.3 under a connection: both sides show a certificate of the same authority, and each checks that the
//! other's names the role that it is taken for. Nothing is decoded before.
//!
//! Each connection has a handshake of its own with keys of its own: sessions are not resumed and there are no early
//! data, so that what was recorded of one connection means nothing on another.

use std::io::{self, Read, Write};
use std::net::TcpStream as StdStream;
use std::sync::Arc;
use std::time::{Duration, Instant};

use rustls::client::Resumption;
use rustls::server::{NoServerSessionStorage, WebPkiClientVerifier};
use rustls::version::TLS13;
use rustls::{ClientConfig, ClientConnection, ServerConfig};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::timeout;
use tokio_rustls::{TlsAcceptor, TlsConnector, TlsStream};

use super::Fault;
use super::read_buffer::would_block;
use super::socket::Socket;
use crate::keys::{Certificate, Identity, KeysError, RoleKind, certified_name, certified_role};

/// For a refused peer to take note of why.
const LINGER: Duration = Duration::from_millis(200);
/// What a refused peer may still send meanwhile.
const LINGER_BYTES_MAX: usize = 16 << 10;

/// What one process proves itself with, and by what it judges others. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Tls {
    client: Arc<ClientConfig>,
    server: Arc<ServerConfig>,
}

impl Tls {
    /// # Errors
    /// The identity would be refused by its peers: it has expired, or is of another authority or role.
    pub fn new(identity: &Identity) -> Result<Self, KeysError> {
        let certificate = Certificate::of(identity)?;
        certificate.check()?;
        Self::unchecked(identity.kind, certificate)
    }

    /// As [`Self::new`], whatever the peers will say of it.
    fn unchecked(kind: RoleKind, certificate: Certificate) -> Result<Self, KeysError> {
        let malformed = |what: String| KeysError::Malformed { kind, what };
        let Certificate { roots, own, key, provider, .. } = certificate;
        let verifier = WebPkiClientVerifier::builder_with_provider(Arc::clone(&roots), Arc::clone(&provider)).build();
        let verifier = verifier.map_err(|error| malformed(error.to_string()))?;
        let mut server = ServerConfig::builder_with_provider(Arc::clone(&provider))
            .with_protocol_versions(&[&TLS13])
            .map(|server| server.with_client_cert_verifier(verifier))
            .and_then(|server| server.with_single_cert(vec![own.clone()], key.clone_key()))
            .map_err(|error| malformed(error.to_string()))?;
        server.session_storage = Arc::new(NoServerSessionStorage {});
        server.send_tls13_tickets = 0;
        let mut client = ClientConfig::builder_with_provider(provider)
            .with_protocol_versions(&[&TLS13])
            .map(|client| client.with_root_certificates(roots))
            .and_then(|client| client.with_client_auth_cert(vec![own], key))
            .map_err(|error| malformed(error.to_string()))?;
        client.resumption = Resumption::disabled();
        Ok(Self { client: Arc::new(client), server: Arc::new(server) })
    }

    /// Where the other side refuses this process, the first read fails.
    pub(super) async fn connect(&self, kind: RoleKind, stream: TcpStream) -> Result<TlsStream<TcpStream>, Fault> {
        let name = certified_name(kind).map_err(|error| Fault::Tls(error.to_string()))?;
        Ok(TlsConnector::from(Arc::clone(&self.client)).connect(name, stream).await.map_err(broken_off)?.into())
    }

    /// As [`Self::connect`], for a plain thread.
    pub(super) fn connect_blocking(
        &self,
        kind: RoleKind,
        stream: StdStream,
        deadline: Duration,
    ) -> Result<Socket<StdStream>, Fault> {
        let name = certified_name(kind).map_err(|error| Fault::Tls(error.to_string()))?;
        let mut session = ClientConnection::new(Arc::clone(&self.client), name).map_err(io::Error::other)?;
        let mut until = Until { stream: &stream, late: Instant::now() + deadline };
        while session.is_handshaking() {
            session.complete_io(&mut until).map_err(|error| match error {
                error if would_block(&error) => Fault::Silent { awaited: "a TLS handshake", deadline },
                error => broken_off(error),
            })?;
        }
        Ok(Socket::tls(session.into(), stream))
    }

    /// Also returns the role that the peer's certificate names.
    pub(super) async fn accept(&self, stream: TcpStream) -> Result<(TlsStream<TcpStream>, Option<RoleKind>), Fault> {
        match TlsAcceptor::from(Arc::clone(&self.server)).accept(stream).into_fallible().await {
            Ok(stream) => {
                let shown = stream.get_ref().1.peer_certificates().and_then(|chain| chain.first());
                let kind = shown.and_then(certified_role);
                Ok((stream.into(), kind))
            }
            Err((error, stream)) => {
                linger(stream).await;
                Err(broken_off(error))
            }
        }
    }
}

/// A handshake has no frames that could be torn.
fn broken_off(error: io::Error) -> Fault {
    match error.into() {
        Fault::Torn => Fault::Closed,
        fault => fault,
    }
}

/// A socket that is closed while something arrives takes back what it has sent: the alert that says why.
async fn linger(mut stream: TcpStream) {
    let drained = async {
        stream.shutdown().await?;
        let (mut ignored, mut rest) = ([0; 1024], LINGER_BYTES_MAX);
        while rest > 0 {
            match stream.read(&mut ignored).await? {
                0 => break,
                bytes => rest = rest.saturating_sub(bytes),
            }
        }
        io::Result::Ok(())
    };
    // Whatever it says: the peer is refused.
    let _ = timeout(LINGER, drained).await;
}

/// A socket of which no read ends later than a handshake should.
struct Until<'a> {
    stream: &'a StdStream,
    late: Instant,
}

impl Read for Until<'_> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let left = self.late.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(io::ErrorKind::TimedOut.into());
        }
        self.stream.set_read_timeout(Some(left))?;
        self.stream.read(into)
    }
}

impl Write for Until<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.stream.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Of an identity that its peers will refuse.
    pub(in super::super) fn unchecked(identity: &Identity) -> Tls {
        Tls::unchecked(identity.kind, Certificate::of(identity).expect("well-formed")).expect("a key")
    }

    /// Dials without a certificate of its own.
    pub(in super::super) fn without_certificate(identity: &Identity) -> Tls {
        let tls = Tls::new(identity).expect("good keys");
        let Certificate { roots, provider, .. } = Certificate::of(identity).expect("well-formed");
        let client = ClientConfig::builder_with_provider(provider).with_protocol_versions(&[&TLS13]);
        let client = client.expect("TLS 1.3").with_root_certificates(roots).with_no_client_auth();
        Tls { client: Arc::new(client), ..tls }
    }
}
