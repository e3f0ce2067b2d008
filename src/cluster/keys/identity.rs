//! What one process proves itself with.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::RoleKind;

/// One role's certificate and key, and the certificate of the authority by which others are judged: a PEM text, so that
/// it travels to another host as it is. It is never printed.
#[derive(Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    pub kind: RoleKind,
    /// Secret.
    pub pem: String,
}

impl fmt::Debug for Identity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Identity({}, ..)", self.kind)
    }
}
