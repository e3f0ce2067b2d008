//! The identity of a cluster: an authority, and one certificate a role that it signed. What a process proves itself
//! with on any address but loopback.

mod authority;
mod certificate;
mod folder;
mod identity;
mod role_kind;

use std::io;
use std::path::PathBuf;

use time::Date;

pub use self::authority::{Authority, Validity};
pub use self::certificate::{Certificate, day_of};
pub(crate) use self::certificate::{certified_name, certified_role};
pub use self::folder::{KeyFolder, Shown};
pub use self::identity::Identity;
pub use self::role_kind::RoleKind;

#[derive(Debug, thiserror::Error)]
pub enum KeysError {
    /// The error names the file.
    #[error("{0}")]
    File(#[from] io::Error),
    #[error("{} is there already: `marti keys rotate` makes new certificates, expected a folder without keys", .0.display())]
    Exists(PathBuf),
    #[error("the certificate of {kind} expired on {day}, make new ones with `marti keys rotate DIR`")]
    Expired { kind: RoleKind, day: Date },
    #[error("the certificate of {kind} is valid from {day} on only: is the clock of this host right?")]
    NotValidYet { kind: RoleKind, day: Date },
    #[error("the certificate of {kind} is not of the authority beside it")]
    OtherAuthority { kind: RoleKind },
    #[error("expected the certificate of {kind}, found that of {}", found.map_or("no role", RoleKind::name))]
    OtherRole { kind: RoleKind, found: Option<RoleKind> },
    #[error("the keys of {kind}: {what}")]
    Malformed { kind: RoleKind, what: String },
    #[error("cannot make a certificate: {0}")]
    Make(String),
}

#[cfg(test)]
mod tests;
