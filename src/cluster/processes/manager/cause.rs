//! Why a run ends.

use std::fmt;

/// What asked a run to end early.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Interrupt {
    Sigint,
    Sigterm,
    Sighup,
}

impl fmt::Display for Interrupt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Sigint => "SIGINT",
            Self::Sigterm => "SIGTERM",
            Self::Sighup => "SIGHUP",
        })
    }
}

#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) enum Cause {
    Complete,
    /// All nodes are set aside.
    NoNodes,
    Interrupted(Interrupt),
    /// A process that cannot be replaced died, which, and how; or the image cannot be vouched for.
    Failed(String),
}

impl Cause {
    /// Whether all that is left to do is to close the books and write the image.
    pub(super) fn is_orderly(&self) -> bool {
        matches!(self, Self::Complete | Self::NoNodes)
    }
}
