//! Every process with the manager: configuration, signs of life, the end. No bulk data, so that no
//! heartbeat waits behind an upload.

use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::frame::{Message, messages};
use super::hello::{Role, RunToken};
use super::mac::MacKey;
use super::work::TileDone;
use crate::keys::Identity;
use ground::ids::{Attempt, ClusterId, Epoch, NodeId, Producer, TileId};
use machine::hardware::specification::{Arbiter, LocalMemory};
use machine::hardware::totals::{BusTotals, LostAttempt, MasterTotals};
use machine::tile_order::Assignment;
use trace::database::{Header, Layout};
use trace::picture::{AovSet, Tiling};
use trace::tracer::View;
use trace::tracer::octree::Octree;
use trace::tracer::simd::Simd;

/// Handed to a spawned process by its standard input, to one that joins by the manager's port: where to go, and the
/// secret.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct Bootstrap {
    pub role: Role,
    pub epoch: Epoch,
    /// A server's is the run's, a node's is its own.
    pub token: RunToken,
    pub manager: SocketAddr,
    /// What it proves itself with; `None`: plain TCP, or what it has of its own.
    pub identity: Option<Identity>,
    /// Where a server listens; `None`: at the interface by which it reaches the manager.
    pub bind: Option<IpAddr>,
    /// Under what others reach a server, an address or a name; `None`: under the address that it listens at.
    pub advertise: Option<String>,
    /// The text log of this process; `None`: standard error.
    pub log: Option<PathBuf>,
    /// Of both sides of the control connection.
    pub heartbeat_milliseconds: u64,
}

/// Commands of the manager to a process, heartbeats among them.
pub trait Command: Message {
    const HEARTBEAT: Self;

    fn is_heartbeat(&self) -> bool;
}

macro_rules! commands {
    ($($name:ident)*) => { $(
        impl Command for $name {
            const HEARTBEAT: Self = Self::Heartbeat;

            fn is_heartbeat(&self) -> bool {
                matches!(self, Self::Heartbeat)
            }
        }
    )* };
}

commands! { BusCommand MasterCommand NodeCommand DisplayCommand }

/// What a process reports to the manager. Each kind has a heartbeat and an incident.
pub trait Report: Message + Clone {
    const HEARTBEAT: Self;

    fn incident(text: String) -> Self;
}

macro_rules! reports {
    ($($name:ident)*) => { $(
        impl Report for $name {
            const HEARTBEAT: Self = Self::Heartbeat;

            fn incident(text: String) -> Self {
                Self::Incident(text)
            }
        }
    )* };
}

reports! { BusReport MasterReport NodeReport DisplayReport }

/// Manager to bus.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub enum BusCommand {
    Heartbeat,
    Configure(BusConfiguration),
    /// All tiles are accounted for: close the recording and report. The lost attempts are listed so that
    /// their fetches can be counted apart.
    Finish {
        lost: Vec<LostAttempt>,
    },
}

#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct BusConfiguration {
    pub cluster: ClusterId,
    pub arbiter: Arbiter,
    pub layout: Layout,
    /// The folder of its log, made if need be.
    pub recording: PathBuf,
}

/// Bus to manager.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub enum BusReport {
    Listening(SocketAddr),
    Heartbeat,
    Incident(String),
    /// It cannot go on, or its recording cannot be made whole; why.
    Failed(String),
    Finished(BusTotals),
}

/// Manager to master.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub enum MasterCommand {
    Heartbeat,
    Configure(MasterConfiguration),
    /// Tiles for the cluster's queue, in the order they are to be handed out.
    Tiles(Vec<TileGrant>),
    /// The process is confirmed dead: its tiles are to be handed out again.
    NodeLost {
        node: NodeId,
        epoch: Epoch,
    },
    /// The node will not be replaced: under interleaved assignment its tiles go to the others.
    NodeSetAside {
        node: NodeId,
    },
    Finish,
}

#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct TileGrant {
    pub tile: TileId,
    pub attempt: Attempt,
    /// Under interleaved assignment, the only node that may trace it.
    pub node: Option<NodeId>,
    /// Nodes that may not: they trace it, or have traced it, already.
    pub except: Vec<NodeId>,
}

#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct MasterConfiguration {
    pub bus: SocketAddr,
    /// Of the cluster; the others follow it.
    pub first_node: NodeId,
    pub nodes: u16,
    /// Of each node: they decide how many tiles it may hold.
    pub threads: u16,
    pub assignment: Assignment,
    /// A tile not acknowledged for so long is reported as late.
    pub tile_deadline_milliseconds: u64,
    /// For permits, and to check receipts.
    pub key: MacKey,
}

/// Master to manager.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub enum MasterReport {
    Listening(SocketAddr),
    Heartbeat,
    Incident(String),
    /// The cluster's queue can take so many more tiles.
    TilesWanted(u32),
    /// First tile handed to this process; it is at work.
    NodeReady {
        node: NodeId,
        epoch: Epoch,
    },
    Done {
        node: NodeId,
        epoch: Epoch,
        done: Box<TileDone>,
    },
    /// These attempts died with their node; the tiles need a new attempt.
    Lost(Vec<LostAttempt>),
    /// None of the cluster's nodes can take these grants.
    Returned(Vec<(TileId, Attempt)>),
    /// The process did what no honest one does.
    Forged {
        node: NodeId,
        epoch: Epoch,
        why: String,
    },
    /// Tiles that the process may trace wait for longer than the tile deadline, and it asks for none: it is to be killed.
    Idle {
        node: NodeId,
        epoch: Epoch,
    },
    /// The tile deadline passed: the node is to be killed.
    Late {
        node: NodeId,
        epoch: Epoch,
        tile: TileId,
    },
    Finished(MasterTotals),
}

impl MasterReport {
    /// The node that it is about.
    pub fn node(&self) -> Option<NodeId> {
        match self {
            Self::NodeReady { node, .. }
            | Self::Done { node, .. }
            | Self::Forged { node, .. }
            | Self::Idle { node, .. }
            | Self::Late { node, .. } => Some(*node),
            Self::Listening(_)
            | Self::Heartbeat
            | Self::Incident(_)
            | Self::TilesWanted(_)
            | Self::Lost(_)
            | Self::Returned(_)
            | Self::Finished(_) => None,
        }
    }
}

/// Manager to node.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub enum NodeCommand {
    Heartbeat,
    Configure(Box<NodeConfiguration>),
    /// There is a new display: what the last one did not acknowledge goes there again.
    Display(SocketAddr),
    /// From now on, one bit of every tile is to be wrong.
    Corrupt,
    Finish,
}

#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct NodeConfiguration {
    pub cluster: ClusterId,
    pub master: SocketAddr,
    pub bus: SocketAddr,
    pub display: SocketAddr,
    pub header: Header,
    pub view: View,
    pub tiling: Tiling,
    pub aov: AovSet,
    pub octree: Octree,
    pub local_memory: LocalMemory,
    /// That trace; more than one where the node has the whole database.
    pub threads: u16,
    pub seed: u64,
    /// The folder of the recording, if references are to be recorded; it exists.
    pub references: Option<PathBuf>,
}

/// Node to manager.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub enum NodeReport {
    Heartbeat,
    Incident(String),
    /// What went wrong, just before the process ends by itself.
    Failed(String),
    /// It holds the whole database and is ready to trace so.
    Packets(Packets),
    /// It was asked to go, holds no tile any more, and ends by itself.
    Leaving,
    Finished,
}

/// What a node traces with that holds the whole database.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Packets {
    pub simd: Simd,
    /// Of the structure that it made of the database, besides it.
    pub derived_bytes: u64,
}

/// Manager to display.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub enum DisplayCommand {
    Heartbeat,
    Configure(DisplayConfiguration),
    /// All tiles of this process are wrong, those in the frame and those that arrive later.
    Condemn(Producer),
    /// Answered by [`DisplayReport::Holdings`] of the same number, after everything that came of what had arrived before.
    TellHoldings {
        question: u32,
    },
    /// Write what there is, whole or partial, and report.
    Finish,
}

#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct DisplayConfiguration {
    pub tiling: Tiling,
    pub aov: AovSet,
    /// The file that every tile is appended to before it is acknowledged.
    pub journal: PathBuf,
    /// Whether the tiles in the journal are taken over; if not, it starts over.
    pub resume: bool,
    /// Of scene and image settings: a journal of others is refused.
    pub fingerprint: [u8; 32],
    /// To check permits, and for receipts.
    pub key: MacKey,
    /// The image file, ending in `.png`; the others are beside it under the same stem.
    pub image: PathBuf,
    pub exr: bool,
}

/// Display to manager.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub enum DisplayReport {
    /// What it has from the journal; sent before it listens.
    Restored(Holdings),
    Listening(SocketAddr),
    Heartbeat,
    Incident(String),
    /// A later result of a tile was compared with the one in the frame.
    Compared(Comparison),
    /// The process sent what it was not permitted to, or what no tracer computes.
    Forged {
        node: NodeId,
        epoch: Epoch,
        why: String,
    },
    /// The frame has no tile of this process any more, and takes none. The tiles that it had.
    Condemned(Producer, TileSet),
    Holdings {
        question: u32,
        holdings: Holdings,
    },
    Finished(DisplayTotals),
    Failed(String),
}

/// A bit a tile: bit i mod 8 of byte i / 8. Tiles beyond its bytes are not in it.
#[derive(Clone, PartialEq, Eq, Default, Debug, Serialize, Deserialize)]
#[serde(transparent)]
pub struct TileSet(Vec<u8>);

impl TileSet {
    pub fn contains(&self, tile: TileId) -> bool {
        self.0.get(tile.0 as usize / 8).is_some_and(|byte| byte >> (tile.0 % 8) & 1 == 1)
    }
}

/// Of all tiles from the first on, those that are marked.
impl FromIterator<bool> for TileSet {
    fn from_iter<I: IntoIterator<Item = bool>>(marks: I) -> Self {
        let mut bytes = Vec::new();
        for (i, mark) in marks.into_iter().enumerate() {
            if i % 8 == 0 {
                bytes.push(0);
            }
            if let Some(byte) = bytes.last_mut() {
                *byte |= u8::from(mark) << (i % 8);
            }
        }
        Self(bytes)
    }
}

/// What is in the frame, and whose it is.
#[derive(Clone, PartialEq, Eq, Default, Debug, Serialize, Deserialize)]
pub struct Holdings {
    pub tiles: TileSet,
    /// At most [`PRODUCERS_MAX`].
    pub shares: Vec<Share>,
}

/// Most processes of one image, those of earlier runs included.
pub const PRODUCERS_MAX: usize = 1 << 16;

/// The tiles of one process in the frame.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Share {
    pub producer: Producer,
    pub tiles: u32,
    /// The one that came last.
    pub latest: TileId,
}

/// Two results of one tile, compared byte for byte.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Comparison {
    pub tile: TileId,
    /// The one in the frame.
    pub kept: TileResult,
    pub other: TileResult,
}

/// A tile's pixels, and where they come from.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct TileResult {
    pub producer: Producer,
    /// SHA-256 of the bytes.
    pub digest: [u8; 32],
}

#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct DisplayTotals {
    /// Of the linear f32 RGB, row-major, little-endian; hexadecimal.
    pub sha256: String,
    pub tiles_done: u32,
    /// Results for tiles that were done already.
    pub tiles_stale: u64,
    pub wire_bytes: u64,
    pub written: Vec<PathBuf>,
}

messages! {
    // With keys and certificates; less than a pipe takes at once.
    Bootstrap: 32 << 10, bulk 0;
    BusCommand: 1 << 20, bulk 0;
    BusReport: 64 << 10, bulk 0;
    MasterCommand: 1 << 20, bulk 0;
    MasterReport: 64 << 10, bulk 0;
    // A scene may have many lights.
    NodeCommand: 4 << 20, bulk 0;
    NodeReport: 64 << 10, bulk 0;
    DisplayCommand: 64 << 10, bulk 0;
    // One bit per tile.
    DisplayReport: 4 << 20, bulk 0;
}
