//! The first frame on every connection, and its answer.

use std::fmt;

use hmac::Mac as _;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::frame::messages;
use crate::keys::RoleKind;
use crate::protocol::mac;
use ground::ids::{ClusterId, Epoch, NodeId, RunId};

/// Raised with every change of a message.
pub const PROTOCOL_VERSION: u32 = 6;
pub const MAGIC: [u8; 8] = *b"marti\0\r\n";
/// Until a peer is known, no frame may be longer.
pub const HELLO_BYTES_MAX: usize = 4096;

/// Which process speaks.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub enum Role {
    Manager,
    Bus(ClusterId),
    Master(ClusterId),
    Node(NodeId),
    Display,
}

impl Role {
    /// Without its number.
    pub const fn kind(self) -> RoleKind {
        match self {
            Self::Manager => RoleKind::Manager,
            Self::Bus(_) => RoleKind::Bus,
            Self::Master(_) => RoleKind::Master,
            Self::Node(_) => RoleKind::Node,
            Self::Display => RoleKind::Display,
        }
    }
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Manager => f.write_str("manager"),
            Self::Bus(ClusterId(0)) => f.write_str("bus"),
            Self::Bus(cluster) => write!(f, "bus of {cluster}"),
            Self::Master(ClusterId(0)) => f.write_str("master"),
            Self::Master(cluster) => write!(f, "master of {cluster}"),
            Self::Node(node) => write!(f, "{node}"),
            Self::Display => f.write_str("display"),
        }
    }
}

/// A secret of one run: 32 random bytes that the manager hands down to servers by an inherited pipe; or what follows from
/// it for one process ([`Self::of`]): that is what a hello shows, and a node has no other. So neither another user nor a
/// process of an earlier run can join, and no node can pose as another process. Compared in constant time, never printed.
#[derive(Clone, Copy, Serialize, Deserialize)]
pub struct RunToken([u8; 32]);

impl RunToken {
    pub const fn new(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }

    /// Of a run's token: the token of a process of it. All processes that ask for a place have the same.
    #[must_use]
    pub fn of(self, role: Role, epoch: Epoch) -> Self {
        let (kind, number) = match role {
            _ if epoch == Epoch::JOINING => (0, 0),
            Role::Manager => (1, 0),
            Role::Bus(cluster) => (2, cluster.0),
            Role::Master(cluster) => (3, cluster.0),
            Role::Node(node) => (4, node.0),
            Role::Display => (5, 0),
        };
        let mut message = [0; 7];
        message[0] = kind;
        message[1..3].copy_from_slice(&number.to_le_bytes());
        message[3..].copy_from_slice(&epoch.0.to_le_bytes());
        Self(mac::hmac(&self.0, &message).finalize().into_bytes().into())
    }

    /// 64 digits, for a file that no other user can read.
    pub fn to_hexadecimal(self) -> String {
        self.0.iter().map(|byte| format!("{byte:02x}")).collect()
    }

    /// Of a run's token: a name of the run that does not betray the secret.
    pub fn run_id(self) -> RunId {
        let digest = Sha256::digest(self.0);
        RunId(u64::from_le_bytes(std::array::from_fn(|i| digest[i])))
    }

    pub fn from_hexadecimal(text: &str) -> Option<Self> {
        let digits = text.as_bytes();
        if digits.len() != 64 {
            return None;
        }
        let mut bytes = [0; 32];
        for (byte, digits) in bytes.iter_mut().zip(digits.chunks_exact(2)) {
            let digit = |at: usize| char::from(digits[at]).to_digit(16);
            *byte = (digit(0)? * 16 + digit(1)?) as u8;
        }
        Some(Self(bytes))
    }
}

impl PartialEq for RunToken {
    fn eq(&self, other: &Self) -> bool {
        self.0.iter().zip(&other.0).fold(0, |different, (a, b)| different | (a ^ b)) == 0
    }
}

impl fmt::Debug for RunToken {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("RunToken(..)")
    }
}

/// How every hello of every version begins, so that a peer of another version learns which it is.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct HelloPrelude {
    pub magic: [u8; 8],
    pub version: u32,
}

/// Sent by the side that dialled. Begins with a [`HelloPrelude`].
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct Hello {
    pub magic: [u8; 8],
    pub version: u32,
    /// Version of the program, for the log.
    pub build: String,
    pub role: Role,
    pub epoch: Epoch,
    /// This process's.
    pub token: RunToken,
}

impl Hello {
    pub fn new(role: Role, epoch: Epoch, token: RunToken) -> Self {
        Self {
            magic: MAGIC,
            version: PROTOCOL_VERSION,
            build: env!("CARGO_PKG_VERSION").to_owned(),
            role,
            epoch,
            token,
        }
    }
}

/// The answer of the side that listens; a refused peer is disconnected.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub enum HelloReply {
    Welcome,
    /// Says what was expected.
    Refused(String),
}

messages! {
    // What follows it is the rest of the hello.
    HelloPrelude: 12, bulk HELLO_BYTES_MAX - 12;
    Hello: HELLO_BYTES_MAX, bulk 0;
    HelloReply: HELLO_BYTES_MAX, bulk 0;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_process_has_a_token_of_its_own_and_none_tells_the_runs() {
        let run = RunToken::new([7; 32]);
        let (node, epoch) = (Role::Node(NodeId(3)), Epoch(4));
        let others = [
            run.of(Role::Node(NodeId(2)), epoch),
            run.of(node, Epoch(5)),
            run.of(Role::Bus(ClusterId(3)), epoch),
            run.of(Role::Master(ClusterId(3)), epoch),
            run.of(Role::Manager, epoch),
            run.of(node, Epoch::JOINING),
            RunToken::new([8; 32]).of(node, epoch),
            run,
        ];
        assert!(others.into_iter().all(|other| other != run.of(node, epoch)));
        assert!(run.of(node, epoch) == run.of(node, epoch));
        assert!(run.of(node, Epoch::JOINING) == run.of(Role::Display, Epoch::JOINING), "it has no place yet");
        assert!(run.of(node, epoch).of(Role::Manager, Epoch(0)) != run.of(Role::Manager, Epoch(0)));
    }
}
