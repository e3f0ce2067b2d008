//! The folder with the keys of a cluster: `ca.pem`, `ca.key`, and a file a role.

use std::fs::DirBuilder;
use std::io::Read;
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};

use time::Date;

use super::{Authority, Certificate, Identity, KeysError, RoleKind, Validity};
use ground::regular_file;
use ground::secret_file;

/// The authority's certificate, which is also in each role's file.
const AUTHORITY_FILE: &str = "ca.pem";
/// The authority's key. It makes certificates; no run needs it.
const AUTHORITY_KEY_FILE: &str = "ca.key";
const FILE_BYTES_MAX: u64 = 64 << 10;
const OWNER_ONLY: u32 = 0o700;

fn role_file(kind: RoleKind) -> String {
    format!("{kind}.pem")
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

/// What there is to show of a folder.
#[derive(Debug)]
pub struct Shown {
    /// SHA-256.
    pub authority: String,
    /// The last day of each role's certificate, or what is wrong with it.
    pub roles: Vec<(RoleKind, Result<Date, KeysError>)>,
}

/// A folder of keys, there or to be made.
#[derive(Clone, Debug)]
pub struct KeyFolder {
    path: PathBuf,
}

impl KeyFolder {
    pub fn at(path: &Path) -> Self {
        Self { path: path.to_owned() }
    }

    /// Makes an authority and the certificates of all roles.
    ///
    /// # Errors
    /// There are keys already, or the folder cannot be written.
    pub fn create(&self, validity: Validity) -> Result<(), KeysError> {
        let names = RoleKind::ALL.map(role_file);
        let names = [AUTHORITY_FILE, AUTHORITY_KEY_FILE].into_iter().chain(names.iter().map(String::as_str));
        if let Some(there) = names.map(|name| self.path.join(name)).find(|path| path.exists()) {
            return Err(KeysError::Exists(there));
        }
        DirBuilder::new()
            .recursive(true)
            .mode(OWNER_ONLY)
            .create(&self.path)
            .map_err(|error| secret_file::named(&self.path, &error.to_string()))?;
        self.write_authority(&Authority::new()?, validity)
    }

    /// Makes new keys and certificates of all roles. The authority stays, so that processes with old ones and new ones
    /// know each other.
    ///
    /// # Errors
    /// There is no authority's key that only its owner can read, or the folder cannot be written.
    pub fn rotate(&self, validity: Validity) -> Result<(), KeysError> {
        let key = secret_file::read(&self.path.join(AUTHORITY_KEY_FILE), FILE_BYTES_MAX)?;
        self.write_roles(&Authority::from_key(&key)?, validity)
    }

    /// As [`Self::rotate`], under a new authority: nothing that the old one signed is accepted any more.
    ///
    /// # Errors
    /// As [`Self::rotate`].
    pub fn rotate_authority(&self, validity: Validity) -> Result<(), KeysError> {
        // Whoever may not use the old one has no business to replace it.
        secret_file::read(&self.path.join(AUTHORITY_KEY_FILE), FILE_BYTES_MAX)?;
        self.write_authority(&Authority::new()?, validity)
    }

    /// # Errors
    /// There is no authority's certificate.
    pub fn show(&self) -> Result<Shown, KeysError> {
        let path = self.path.join(AUTHORITY_FILE);
        let mut authority = String::new();
        regular_file::open(&path)
            .and_then(|file| file.take(FILE_BYTES_MAX).read_to_string(&mut authority))
            .map_err(|error| secret_file::named(&path, &error.to_string()))?;
        let fingerprint =
            Certificate::fingerprint(&authority).ok_or_else(|| secret_file::named(&path, "expected a certificate"))?;
        let last_day = |kind| {
            let identity = Identity::read(&self.path, kind)?;
            Certificate::of(&identity)?.last_day()
        };
        Ok(Shown { authority: fingerprint, roles: RoleKind::ALL.map(|kind| (kind, last_day(kind))).into() })
    }

    fn write_authority(&self, authority: &Authority, validity: Validity) -> Result<(), KeysError> {
        secret_file::write(&self.path.join(AUTHORITY_KEY_FILE), &authority.key())?;
        secret_file::write(&self.path.join(AUTHORITY_FILE), authority.certificate())?;
        self.write_roles(authority, validity)
    }

    fn write_roles(&self, authority: &Authority, validity: Validity) -> Result<(), KeysError> {
        for kind in RoleKind::ALL {
            secret_file::write(&self.path.join(role_file(kind)), &authority.issue(kind, validity)?)?;
        }
        Ok(())
    }
}
