//! What one process proves itself with.

use std::fmt;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::folder::{FILE_BYTES_MAX, role_file};
use super::{Certificate, KeysError, RoleKind};
use crate::secret_file;

/// One role's certificate and key, and the certificate of the authority by which others are judged: a PEM text, so that
/// it travels to another host as it is. It is never printed.
#[derive(Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    pub kind: RoleKind,
    /// Secret.
    pub pem: String,
}

impl Identity {
    /// Reads the keys of a role from a folder that `marti keys new` made, or from that role's file alone.
    ///
    /// # Errors
    /// The file is not there, others can read it, or what [`Certificate::check`] says.
    pub fn read(path: &Path, kind: RoleKind) -> Result<Self, KeysError> {
        let file = if path.is_dir() { path.join(role_file(kind)) } else { path.to_owned() };
        let identity = Self { kind, pem: secret_file::read(&file, FILE_BYTES_MAX)? };
        Certificate::of(&identity)?.check()?;
        Ok(identity)
    }
}

impl fmt::Debug for Identity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Identity({}, ..)", self.kind)
    }
}
