//! What a certificate says of its holder.

use std::fmt;

use serde::{Deserialize, Serialize};

/// A role without its number: all nodes of a cluster hold the same certificate.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub enum RoleKind {
    Manager,
    Bus,
    Master,
    Node,
    Display,
}

impl RoleKind {
    pub const ALL: [Self; 5] = [Self::Manager, Self::Bus, Self::Master, Self::Node, Self::Display];

    pub const fn name(self) -> &'static str {
        match self {
            Self::Manager => "manager",
            Self::Bus => "bus",
            Self::Master => "master",
            Self::Node => "node",
            Self::Display => "display",
        }
    }

    /// The name in its certificate. It is a role's, not a host's: processes move.
    pub const fn certified_name(self) -> &'static str {
        match self {
            Self::Manager => "manager.marti",
            Self::Bus => "bus.marti",
            Self::Master => "master.marti",
            Self::Node => "node.marti",
            Self::Display => "display.marti",
        }
    }
}

impl fmt::Display for RoleKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
