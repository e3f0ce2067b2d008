//! What went wrong with TLS, in the words of this program.

use rustls::AlertDescription::{
    self, BadCertificate, CertificateExpired, CertificateRequired, DecryptError, UnknownCA,
};
use rustls::{CertificateError, Error};

use crate::keys::{RoleKind, day_of};

const OTHER_AUTHORITY: &str = "expected keys of one `marti keys new` on both sides";

/// The rest of a sentence that begins with the peer.
pub(super) fn words(error: &Error) -> String {
    match error {
        Error::InvalidCertificate(error) => certificate(error),
        Error::NoCertificatesPresented => "it showed no certificate, expected one of this cluster".to_owned(),
        Error::InvalidMessage(_) => {
            "it does not speak TLS, which is expected here: give both sides keys, or neither".to_owned()
        }
        Error::PeerIncompatible(_) => "it does not speak TLS 1.3, expected nothing older".to_owned(),
        Error::DecryptError => "it sent what was not encrypted for this connection".to_owned(),
        Error::AlertReceived(alert) => told(*alert),
        other => format!("TLS failed: {other}"),
    }
}

fn certificate(error: &CertificateError) -> String {
    match error {
        CertificateError::ExpiredContext { not_after, .. } => {
            format!("its certificate expired on {}, make new ones with `marti keys rotate DIR`", day_of(*not_after))
        }
        CertificateError::NotValidYetContext { not_before, .. } => {
            format!("its certificate is valid from {} on only: is the clock of this host right?", day_of(*not_before))
        }
        CertificateError::UnknownIssuer => format!("its certificate is of another authority, {OTHER_AUTHORITY}"),
        CertificateError::NotValidForNameContext { expected, presented } => {
            let kind = |named: &str| RoleKind::ALL.into_iter().find(|kind| named.contains(kind.certified_name()));
            let name = |found: Option<RoleKind>| found.map_or("no role", RoleKind::name);
            let found = presented.iter().find_map(|named| kind(named));
            format!("expected the certificate of {}, it showed that of {}", name(kind(&expected.to_str())), name(found))
        }
        other => format!("its certificate is refused: {other}"),
    }
}

/// What the other side made of ours.
fn told(alert: AlertDescription) -> String {
    match alert {
        CertificateRequired => "it asks for a certificate, and this process showed none".to_owned(),
        UnknownCA | DecryptError => {
            format!("it does not know the authority of this process's certificate, {OTHER_AUTHORITY}")
        }
        BadCertificate => "the certificate of this process is not that of the role that was dialled".to_owned(),
        CertificateExpired => {
            "the certificate of this process has expired, make new ones with `marti keys rotate DIR`".to_owned()
        }
        other => format!("it broke off TLS: {other:?}"),
    }
}
