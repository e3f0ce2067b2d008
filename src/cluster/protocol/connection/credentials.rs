//! What a listener judges by, and what a dialler shows.

use super::tls::Tls;
use crate::protocol::hello::{Hello, Role, RunToken};
use ground::ids::Epoch;

/// What a listener asks of everybody who dials: the run's token and, on any address but loopback, TLS.
#[derive(Clone, Debug)]
pub struct Credentials {
    /// The run's.
    pub token: RunToken,
    /// `None`: plain TCP.
    pub tls: Option<Tls>,
    /// Whether a process that asks for a place may come by its certificate alone: it does not know the token yet.
    pub joiners: bool,
}

impl Credentials {
    /// The token alone, for the loopback interface.
    pub fn plain(token: RunToken) -> Self {
        Self { token, tls: None, joiners: false }
    }

    /// How a process that has the run's token introduces itself to another one.
    pub fn introduction(&self, role: Role, epoch: Epoch) -> Introduction {
        Introduction { hello: Hello::new(role, epoch, self.token.of(role, epoch)), tls: self.tls.clone() }
    }
}

/// What the side that dials shows.
#[derive(Clone, Debug)]
pub struct Introduction {
    pub hello: Hello,
    /// `None`: plain TCP.
    pub tls: Option<Tls>,
}
