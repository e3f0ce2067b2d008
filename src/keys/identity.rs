//! What one process proves itself with.

use std::fmt;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::folder::{AUTHORITY_FILE, FILE_BYTES_MAX, role_file};
use super::{Certificate, KeysError, RoleKind};
use crate::secret_file;

/// The authority's certificate, and the certificate and key of one role: PEM texts, so that they travel to another host
/// as they are. The key is never printed.
#[derive(Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    pub kind: RoleKind,
    /// Certificates that others are judged by.
    pub authority: String,
    /// Certificate and key, secret.
    pub own: String,
}

impl Identity {
    /// Reads the keys of a role from a folder that `marti keys new` made.
    ///
    /// # Errors
    /// A file is not there, others can read the key, or what [`Certificate::check`] says.
    pub fn read(folder: &Path, kind: RoleKind) -> Result<Self, KeysError> {
        let authority = folder.join(AUTHORITY_FILE);
        let authority =
            std::fs::read_to_string(&authority).map_err(|error| secret_file::named(&authority, &error.to_string()))?;
        let own = secret_file::read(&folder.join(role_file(kind)), FILE_BYTES_MAX)?;
        let identity = Self { kind, authority, own };
        Certificate::of(&identity)?.check()?;
        Ok(identity)
    }
}

impl fmt::Debug for Identity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Identity({}, ..)", self.kind)
    }
}
