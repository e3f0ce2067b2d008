//! Makes keys and certificates.

use std::time::Duration;

use rcgen::{
    BasicConstraints, CertificateParams, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer, KeyPair, KeyUsagePurpose,
};
use sha2::{Digest, Sha256};
use time::OffsetDateTime;

use super::{KeysError, RoleKind};

/// Clocks of hosts differ.
const BACKDATED: Duration = Duration::from_hours(24);

/// From when until when a certificate holds.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Validity {
    pub not_before: OffsetDateTime,
    pub not_after: OffsetDateTime,
}

impl Validity {
    /// So many days from now on.
    pub fn days(days: u32) -> Self {
        let now = OffsetDateTime::now_utc();
        Self { not_before: now - BACKDATED, not_after: now + Duration::from_hours(24 * u64::from(days)) }
    }
}

/// The key that signs the certificates of a cluster. Its own certificate does not expire: what it signs does.
pub struct Authority {
    issuer: Issuer<'static, KeyPair>,
    certificate: String,
}

impl Authority {
    /// # Errors
    /// The system has no random numbers.
    pub fn new() -> Result<Self, KeysError> {
        Self::with_key(KeyPair::generate().map_err(made)?)
    }

    /// The authority whose key this is; its certificate is made anew and says the same.
    ///
    /// # Errors
    /// The text is no key.
    pub fn from_key(pem: &str) -> Result<Self, KeysError> {
        Self::with_key(KeyPair::from_pem(pem).map_err(made)?)
    }

    fn with_key(key: KeyPair) -> Result<Self, KeysError> {
        let mut parameters = CertificateParams::default();
        // A name of its own, so that another authority's certificates are distinguished from forged ones.
        let digest = Sha256::digest(key.public_key_raw());
        let number: String = digest.iter().take(8).map(|byte| format!("{byte:02x}")).collect();
        parameters.distinguished_name.push(DnType::CommonName, format!("marti authority {number}"));
        parameters.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
        parameters.key_usages = vec![KeyUsagePurpose::KeyCertSign];
        let certificate = parameters.self_signed(&key).map_err(made)?.pem();
        Ok(Self { issuer: Issuer::new(parameters, key), certificate })
    }

    /// In PEM.
    pub fn certificate(&self) -> &str {
        &self.certificate
    }

    /// In PEM, secret.
    pub fn key(&self) -> String {
        self.issuer.key().serialize_pem()
    }

    /// A new key of a role, its certificate and the authority's, in PEM, secret.
    ///
    /// # Errors
    /// The system has no random numbers.
    pub fn issue(&self, kind: RoleKind, validity: Validity) -> Result<String, KeysError> {
        let key = KeyPair::generate().map_err(made)?;
        let mut parameters = CertificateParams::new([kind.certified_name().to_owned()]).map_err(made)?;
        parameters.distinguished_name.push(DnType::CommonName, format!("marti {kind}"));
        // Most processes both dial and listen.
        parameters.extended_key_usages = vec![ExtendedKeyUsagePurpose::ServerAuth, ExtendedKeyUsagePurpose::ClientAuth];
        parameters.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        (parameters.not_before, parameters.not_after) = (validity.not_before, validity.not_after);
        let certificate = parameters.signed_by(&key, &self.issuer).map_err(made)?;
        Ok([certificate.pem(), key.serialize_pem(), self.certificate.clone()].concat())
    }
}

fn made(error: rcgen::Error) -> KeysError {
    KeysError::Make(error.to_string())
}
