//! The file of a role's certificate and key.
#![no_main]

use cluster::keys::{Authority, Certificate, Identity, RoleKind};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|pem: &str| {
    let identity = Identity { kind: RoleKind::Node, pem: pem.to_owned() };
    if let Ok(certificate) = Certificate::of(&identity) {
        let _ = certificate.check();
        let _ = certificate.last_day();
    }
    let _ = Certificate::fingerprint(pem);
    let _ = Authority::from_key(pem);
});
