//! What a node sends to the display of a tile that it has traced.

use std::time::Duration;

use cluster::processes::node::tiles::Traced;
use cluster::protocol::image::TilePixels;
use cluster::protocol::mac::Mac;
use ground::ids::{Attempt, TileId};
use tokio::time::{Instant, sleep_until};
use trace::picture::Pixels;

use super::ground::Ground;
use super::mode::Mode;
use super::node::Node;
use super::{Outcome, deed, messages};

const DUPLICATES: u32 = 200_000;
/// Sent before their answers are read.
const BATCH: u32 = 50;
/// More than the sockets' buffers take of answers.
const UNREAD: u32 = 1_000_000;
/// Less than the tests' deadline of a tile.
const SLUGGISHNESS: Duration = Duration::from_secs(3);

impl Node {
    /// A tile is traced.
    pub(crate) async fn hand_over(&mut self, ground: &mut Ground, traced: Traced) -> Outcome {
        self.count += 1;
        let (tile, attempt, permit) = (traced.done.tile, traced.done.attempt, traced.permit);
        let grey = messages::grey(ground.configuration.tiling, tile, ground.configuration.aov);
        let mut planes = Vec::new();
        traced.pixels.write_bytes(&mut planes);
        match ground.mode {
            Mode::NoPixels => {
                deed(format_args!("tells {tile} done without pixels"));
                self.tell_done(&traced.done, Mac::default()).await?;
                return self.ask().await;
            }
            Mode::EarlyDone => {
                deed(format_args!("tells {tile} done early"));
                self.send_tile(&traced).await?;
                self.tell_done(&traced.done, Mac::default()).await?;
                return self.ask().await;
            }
            Mode::OtherTile if self.count.is_multiple_of(2) => {
                self.withheld.push(traced);
                return Ok(());
            }
            Mode::MaxAttempt if self.count == 1 => {
                deed(format_args!("sends {tile} as another attempt"));
                self.send_planes(tile, Attempt(u32::MAX - 1), permit, &grey).await?;
            }
            Mode::NextAttempt => {
                deed(format_args!("sends {tile} as another attempt"));
                self.send_planes(tile, Attempt(attempt.0 + 1), permit, &grey).await?;
            }
            Mode::NoRead => return self.flood_unread(ground, &traced, &planes).await,
            Mode::Duplicates if self.count == 1 => self.send_again_and_again(&traced, &planes).await?,
            Mode::NoSuchTile if self.count == 1 => {
                deed("sends a tile that there is not");
                self.send_planes(TileId(u32::MAX), attempt, permit, &planes).await?;
            }
            Mode::Changed => {
                deed(format_args!("sends {tile} in grey first"));
                self.send_planes(tile, attempt, permit, &grey).await?;
            }
            Mode::Sluggard => {
                deed(format_args!("keeps {tile}"));
                sleep_until(self.since.remove(&tile).unwrap_or_else(Instant::now) + SLUGGISHNESS).await;
            }
            _ => {}
        }
        let pixels = match ground.mode {
            Mode::BadCrc => {
                deed(format_args!("sends a wrong checksum of {tile}"));
                TilePixels { crc32c: !crc32c::crc32c(&planes), ..messages::pixels(tile, attempt, permit, &planes) }
            }
            mode => {
                if let Some(wrong) = wrong(mode, ground, &traced, &planes, self.count) {
                    deed(format_args!("sends other pixels of {tile}"));
                    planes = wrong;
                }
                messages::pixels(tile, attempt, permit, &planes)
            }
        };
        self.traced.push(traced);
        self.send_with_crc(pixels, &planes).await
    }

    async fn send_again_and_again(&mut self, traced: &Traced, planes: &[u8]) -> Outcome {
        let (tile, attempt) = (traced.done.tile, traced.done.attempt);
        for batch in 0..DUPLICATES / BATCH {
            for _ in 0..BATCH {
                self.send_planes(tile, attempt, traced.permit, planes).await?;
            }
            for _ in 0..BATCH {
                self.await_reply().await?;
            }
            // On a slow host it is replaced before it has sent all.
            if batch == 0 {
                deed(format_args!("sends {tile} {DUPLICATES} times"));
            }
        }
        Ok(())
    }

    /// Whether the display has dropped the connection or does not get on, it stays and does not read.
    async fn flood_unread(&mut self, ground: &mut Ground, traced: &Traced, planes: &[u8]) -> Outcome {
        let (tile, attempt) = (traced.done.tile, traced.done.attempt);
        deed("reads nothing");
        for sent in 0..UNREAD {
            if let Err(error) = self.send_planes(tile, attempt, traced.permit, planes).await {
                deed(format_args!("sent {tile} {sent} times: {error}"));
                break;
            }
        }
        ground.idle().await
    }
}

/// What is sent instead of true planes, by modes that send something else.
fn wrong(mode: Mode, ground: &Ground, traced: &Traced, planes: &[u8], count: u32) -> Option<Vec<u8>> {
    let tiling = ground.configuration.tiling;
    let (tile, attempt) = (traced.done.tile, traced.done.attempt);
    let of = |number: f32| number.to_le_bytes().repeat(planes.len() / 4);
    let grey = || of(0.5);
    let pixel = Pixels::byte_len(1, ground.configuration.aov);
    match mode {
        Mode::Nan => Some(of(f32::NAN)),
        Mode::Infinite => Some(of(f32::INFINITY)),
        Mode::Grey | Mode::GreyHeld => Some(grey()),
        Mode::GreyLast if tile.0 >= tiling.tile_count() / 8 * 7 => Some(grey()),
        Mode::GreyLater if count > 1 && attempt == Attempt(0) => Some(grey()),
        Mode::FalseChecker if attempt > Attempt(0) => Some(grey()),
        Mode::Oversize => Some([planes, &planes[..pixel]].concat()),
        Mode::Undersize => Some(planes[pixel..].to_vec()),
        _ => None,
    }
}
