//! Pixels and completions of tiles that were not handed to this node.

use cluster::protocol::connection::{Connection, Receiver};
use cluster::protocol::frame::Message;
use cluster::protocol::hello::Role;
use cluster::protocol::image::{ImageReply, TilePixels};
use cluster::protocol::mac::Mac;
use cluster::protocol::work::{WorkReply, WorkRequest};
use ground::ids::{Attempt, TileId};

use super::ground::Ground;
use super::{Outcome, deed, messages};

/// Other pixels of every tile.
const DISPUTES: u32 = 240;
const READIES: u32 = 1000;

pub(crate) async fn ahead(ground: &mut Ground) -> Outcome {
    let display = ground.dial(Role::Display).await?;
    all_grey(ground, display).await
}

/// Grey pixels of all tiles, as the process that dialled.
pub(crate) async fn all_grey(ground: &Ground, display: Connection) -> Outcome {
    let (mut display, replies) = display.split::<TilePixels, ImageReply>();
    tokio::spawn(read_all(replies));
    let tiling = ground.configuration.tiling;
    deed("sends all tiles in grey");
    for tile in (0..tiling.tile_count()).map(TileId) {
        let planes = messages::grey(tiling, tile, ground.configuration.aov);
        // An error means that the display has seen through it.
        if display
            .send_with_bulk(&messages::pixels(tile, Attempt(0), Mac::default(), &planes), planes.as_slice())
            .await
            .is_err()
        {
            break;
        }
    }
    Ok(())
}

pub(crate) async fn disputes(ground: &mut Ground) -> Outcome {
    let (mut display, replies) = ground.talk::<TilePixels, ImageReply>(Role::Display).await?;
    tokio::spawn(read_all(replies));
    let tiling = ground.configuration.tiling;
    deed("sends other pixels of all tiles");
    for round in 0..DISPUTES {
        for tile in (0..tiling.tile_count()).map(TileId) {
            let mut planes = messages::grey(tiling, tile, ground.configuration.aov);
            planes[..4].copy_from_slice(&(round as f32).to_le_bytes());
            let pixels = messages::pixels(tile, Attempt(round + 1), Mac::default(), &planes);
            if display.send_with_bulk(&pixels, planes.as_slice()).await.is_err() {
                return Ok(());
            }
        }
    }
    Ok(())
}

pub(crate) async fn not_held(ground: &mut Ground) -> Outcome {
    let (mut master, replies) = ground.talk::<WorkRequest, WorkReply>(ground.master()).await?;
    tokio::spawn(read_all(replies));
    deed("tells all tiles done");
    for tile in (0..ground.configuration.tiling.tile_count()).map(TileId) {
        if master.send(&messages::told(tile, Attempt(0))).await.is_err() {
            break;
        }
    }
    Ok(())
}

pub(crate) async fn readies(ground: &mut Ground) -> Outcome {
    let (mut master, replies) = ground.talk::<WorkRequest, WorkReply>(ground.master()).await?;
    tokio::spawn(read_all(replies));
    deed("asks a thousand times");
    for _ in 0..READIES {
        if master.send(&WorkRequest::Ready).await.is_err() {
            break;
        }
    }
    Ok(())
}

/// Until the connection ends.
async fn read_all<M: Message>(mut replies: Receiver<M>) {
    while let Ok(Some(_)) = replies.receive().await {}
}
