//! Newtypes for what is counted or named, so that a tile is never taken for a node.

use std::fmt;

use serde::{Deserialize, Serialize};

macro_rules! id {
    ($(#[$doc:meta])* $name:ident($inner:ty), $label:literal) => {
        $(#[$doc])*
        #[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug, Default, Serialize, Deserialize)]
        #[serde(transparent)]
        pub struct $name(pub $inner);

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, concat!($label, "{}"), self.0)
            }
        }
    };
}

id!(
    /// A processing node of a cluster, from 0. A replacement keeps the id of the node it replaces.
    NodeId(u16), "node "
);
id!(
    /// A cluster, from 0.
    ClusterId(u16), "cluster "
);
id!(
    /// A tile of the image, row-major from the upper left.
    TileId(u32), "tile "
);
id!(
    /// How many times a tile was handed out before, counted from 0.
    Attempt(u32), "attempt "
);
id!(
    /// How many processes held this place before, counted from 0: the first process of a node has epoch 0.
    Epoch(u32), "epoch "
);
id!(
    /// Bytes from the start of cluster memory.
    Address(u64), "address "
);

impl Epoch {
    /// Of a process that has no place yet and asks for one.
    pub const JOINING: Self = Self(u32::MAX);
}

/// A run. Epochs and attempts of two runs have nothing to do with each other.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug, Default, Serialize, Deserialize)]
#[serde(transparent)]
pub struct RunId(pub u64);

impl fmt::Display for RunId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "run {:016x}", self.0)
    }
}

/// The process that traced a tile.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug, Default, Serialize, Deserialize)]
pub struct Producer {
    pub run: RunId,
    pub node: NodeId,
    pub epoch: Epoch,
}

impl fmt::Display for Producer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({})", self.node, self.epoch)
    }
}
