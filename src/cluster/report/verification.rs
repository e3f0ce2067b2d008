//! Which tiles of the image were rendered by more than one node, with the same bytes.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use ground::ids::{Producer, RunId};

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Verification {
    /// Tiles of the image that at least two processes rendered, with the same bytes.
    pub tiles: u64,
    /// Tiles of the image that nothing but the process that rendered each vouches for.
    pub unverified_tiles: u64,
    /// By run, node and epoch: every process whose tiles are in the image.
    pub processes: Vec<Process>,
}

/// A process of a node, and its tiles in the image.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Process {
    pub node: u16,
    pub epoch: u32,
    /// `None`: this run's; else the number of an earlier one, 16 hexadecimal digits.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub earlier_run: Option<String>,
    pub tiles: u32,
    /// Of these, those that another process rendered with the same bytes.
    pub verified: u32,
    /// Whether its latest tile is one of them.
    pub latest_verified: bool,
    /// The nodes that agreed.
    pub by: Vec<u16>,
}

impl Process {
    /// A process without a verified tile; `this` is the run that reports.
    pub fn new(producer: Producer, this: RunId, tiles: u32) -> Self {
        let Producer { run, node, epoch } = producer;
        Self {
            node: node.0,
            epoch: epoch.0,
            earlier_run: (run != this).then(|| format!("{:016x}", run.0)),
            tiles,
            verified: 0,
            latest_verified: false,
            by: Vec::new(),
        }
    }
}

#[cfg(test)]
pub(super) fn fixture() -> Verification {
    let (run, this) = (RunId(0xabc), RunId(1));
    let process = Process::new(Producer { run, ..Producer::default() }, this, 3);
    let process = Process { verified: 1, latest_verified: true, by: vec![1], ..process };
    Verification { tiles: 1, unverified_tiles: 3, processes: vec![process] }
}
