//! Nodes (who send pixels) with the display (which acknowledges them).

use serde::{Deserialize, Serialize};

use super::frame::messages;
use super::mac::Mac;
use ground::ids::{Attempt, TileId};

/// From a node. The bulk bytes are the tile's planes as [`trace::picture::Pixels::write_bytes`] lays them out.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct TilePixels {
    pub tile: TileId,
    pub attempt: Attempt,
    /// The master's: the attempt was handed to this process.
    pub permit: Mac,
    /// Of the bulk bytes.
    pub crc32c: u32,
}

/// From the display.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub enum ImageReply {
    /// The tile is in the frame buffer, by this attempt or by an earlier one. The receipt proves it to the master.
    Acknowledged { tile: TileId, attempt: Attempt, receipt: Mac },
    /// The connection ends after this.
    Refused(String),
}

messages! {
    // The display narrows this to the largest tile of its image.
    TilePixels: 64, bulk u32::MAX as usize - 64;
    ImageReply: 4 << 10, bulk 0;
}
