//! The certificates of an identity, parsed, and judged as a peer will judge them.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use rustls::client::WebPkiServerVerifier;
use rustls::client::danger::ServerCertVerifier;
use rustls::crypto::{CryptoProvider, ring};
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName, UnixTime};
use rustls::server::ParsedCertificate;
use rustls::{CertificateError, RootCertStore};
use sha2::{Digest, Sha256};
use time::{Date, OffsetDateTime};

use super::{Identity, KeysError, RoleKind};

/// An identity as TLS needs it.
#[derive(Debug)]
pub struct Certificate {
    kind: RoleKind,
    pub roots: Arc<RootCertStore>,
    pub own: CertificateDer<'static>,
    pub key: PrivateKeyDer<'static>,
    pub provider: Arc<CryptoProvider>,
}

impl Certificate {
    /// # Errors
    /// The text is not two certificates and a key.
    pub fn of(identity: &Identity) -> Result<Self, KeysError> {
        let Identity { kind, pem } = identity;
        let malformed = |what: &dyn fmt::Display| KeysError::Malformed { kind: *kind, what: what.to_string() };
        let certificates: Result<Vec<_>, _> = CertificateDer::pem_slice_iter(pem.as_bytes()).collect();
        let certificates = certificates.map_err(|error| malformed(&error))?;
        let [own, authorities @ ..] = certificates.as_slice() else {
            return Err(malformed(&"there is no certificate"));
        };
        let mut roots = RootCertStore::empty();
        for authority in authorities {
            roots.add(authority.clone()).map_err(|error| malformed(&error))?;
        }
        if roots.is_empty() {
            return Err(malformed(&"there is no certificate of an authority"));
        }
        let key = PrivateKeyDer::from_pem_slice(pem.as_bytes()).map_err(|error| malformed(&error))?;
        let provider = Arc::new(ring::default_provider());
        Ok(Self { kind: *kind, roots: Arc::new(roots), own: own.clone(), key, provider })
    }

    /// Whether peers with the same authority will accept it today: better reported at once than by each of them.
    ///
    /// # Errors
    /// It has expired, or is of another authority or another role.
    pub fn check(&self) -> Result<(), KeysError> {
        self.check_at(UnixTime::now())
    }

    /// The last day on which peers accept it.
    ///
    /// # Errors
    /// As [`Self::check`]'s.
    pub fn last_day(&self) -> Result<Date, KeysError> {
        self.check()?;
        // Judged at the end of time it has expired, and the verdict says when.
        match self.check_at(UnixTime::since_unix_epoch(Duration::from_secs(u64::MAX))) {
            Err(KeysError::Expired { day, .. }) => Ok(day),
            Err(other) => Err(other),
            Ok(()) => Ok(Date::MAX),
        }
    }

    /// Of the first certificate in a text, as `openssl x509 -fingerprint -sha256` writes it.
    pub fn fingerprint(pem: &str) -> Option<String> {
        let root = CertificateDer::from_pem_slice(pem.as_bytes()).ok()?;
        let bytes: Vec<String> = Sha256::digest(&root).iter().map(|byte| format!("{byte:02X}")).collect();
        Some(bytes.join(":"))
    }

    fn check_at(&self, now: UnixTime) -> Result<(), KeysError> {
        let kind = self.kind;
        let malformed = |what: String| KeysError::Malformed { kind, what };
        let verifier =
            WebPkiServerVerifier::builder_with_provider(Arc::clone(&self.roots), Arc::clone(&self.provider)).build();
        let verifier = verifier.map_err(|error| malformed(error.to_string()))?;
        match verifier.verify_server_cert(&self.own, &[], &certified_name(kind)?, &[], now) {
            Ok(_) => Ok(()),
            Err(rustls::Error::InvalidCertificate(error)) => Err(match error {
                CertificateError::ExpiredContext { not_after, .. } => {
                    KeysError::Expired { kind, day: day_of(not_after) }
                }
                CertificateError::NotValidYetContext { not_before, .. } => {
                    KeysError::NotValidYet { kind, day: day_of(not_before) }
                }
                CertificateError::UnknownIssuer => KeysError::OtherAuthority { kind },
                CertificateError::NotValidForName | CertificateError::NotValidForNameContext { .. } => {
                    KeysError::OtherRole { kind, found: certified_role(&self.own) }
                }
                other => malformed(other.to_string()),
            }),
            Err(other) => Err(malformed(other.to_string())),
        }
    }
}

/// The role that a certificate names.
pub(crate) fn certified_role(certificate: &CertificateDer<'_>) -> Option<RoleKind> {
    let parsed = ParsedCertificate::try_from(certificate).ok()?;
    let names = |kind: &RoleKind| {
        certified_name(*kind).is_ok_and(|name| rustls::client::verify_server_name(&parsed, &name).is_ok())
    };
    RoleKind::ALL.into_iter().find(names)
}

/// As TLS needs it.
pub(crate) fn certified_name(kind: RoleKind) -> Result<ServerName<'static>, KeysError> {
    ServerName::try_from(kind.certified_name()).map_err(|error| KeysError::Malformed { kind, what: error.to_string() })
}

/// In UTC.
pub fn day_of(time: UnixTime) -> Date {
    let seconds = i64::try_from(time.as_secs()).unwrap_or(i64::MAX);
    OffsetDateTime::from_unix_timestamp(seconds).map_or(Date::MAX, OffsetDateTime::date)
}
