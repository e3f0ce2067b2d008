//! Which tiles are in the frame buffer, and whose. No socket, no file: the shell moves bytes and writes what comes out.

use std::collections::HashMap;

use sha2::{Digest, Sha256};

use crate::ids::{Attempt, Epoch, NodeId, TileId};
use crate::image_file::{FrameBuffer, FrameBufferError};
use crate::journal::{Record, RunId};
use crate::protocol::control::{Comparison, DisplayConfiguration, DisplayReport, Revocation, TileResult};
use crate::protocol::image::{ImageReply, TilePixels};
use crate::tracer::{Pixels, Rect, Tiling};

/// A connection of a node, numbered as they come.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub struct ConnectionId(pub u64);

/// Which process traced.
pub type Source = (NodeId, Epoch);

#[derive(Debug)]
pub enum Event<'a> {
    Tile {
        from: ConnectionId,
        source: Source,
        tile: TilePixels,
        bytes: &'a [u8],
    },
    /// The manager's: these attempts are wrong.
    Revoke(Vec<Revocation>),
    /// The manager asks which tiles are this process'.
    TilesOf(Source),
    /// Somebody was not let in, or spoke nonsense.
    Refused(String),
}

#[derive(Clone, PartialEq, Debug)]
pub enum Action<'a> {
    /// To be done before what comes after it.
    Append(Record<'a>),
    Reply(ConnectionId, ImageReply),
    /// End the connection, after what was replied.
    Dismiss(ConnectionId),
    Report(DisplayReport),
}

/// Whose pixels are in the frame.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
struct Kept {
    run: RunId,
    attempt: Attempt,
    source: Source,
}

#[derive(Debug)]
pub struct State {
    run: RunId,
    tiling: Tiling,
    frame: FrameBuffer,
    /// By tile id.
    kept: Vec<Option<Kept>>,
    /// Results of this run up to this attempt are dropped.
    revoked: HashMap<TileId, Attempt>,
    tiles_done: u32,
    tiles_stale: u64,
}

impl State {
    /// # Errors
    /// The image is larger than allowed, or than the memory.
    pub fn new(configuration: &DisplayConfiguration, run: RunId) -> Result<Self, FrameBufferError> {
        let DisplayConfiguration { tiling, aov, .. } = *configuration;
        let frame = FrameBuffer::new(tiling.width, tiling.height, aov)?;
        let kept = vec![None; tiling.tile_count() as usize];
        Ok(Self { run, tiling, frame, kept, revoked: HashMap::new(), tiles_done: 0, tiles_stale: 0 })
    }

    /// Takes over what an earlier display appended, in the order in which it did.
    pub fn restore(&mut self, run: RunId, record: &Record) {
        match *record {
            Record::Pixels { tile, attempt, source, planes } => {
                // Cannot fail: a journal is of this image, and its tiles are whole.
                let _ = self.keep(tile, Kept { run, attempt, source }, planes);
            }
            Record::Revoked { tile, attempt } => drop(self.revoke(run, Revocation { tile, attempt })),
        }
    }

    /// A bit a tile that is in the frame: bit i mod 8 of byte i / 8.
    pub fn restored(&self) -> Vec<u8> {
        self.bits(|_| true)
    }

    fn bits(&self, chosen: impl Fn(&Kept) -> bool) -> Vec<u8> {
        let is_set = |kept: &Option<Kept>| u8::from(kept.as_ref().is_some_and(&chosen));
        let bits =
            |tiles: &[Option<Kept>]| tiles.iter().enumerate().fold(0, |bits, (i, kept)| bits | is_set(kept) << i);
        self.kept.chunks(8).map(bits).collect()
    }

    /// Bulk bytes of a whole tile: no frame may carry more.
    pub fn tile_bytes_max(&self) -> usize {
        let pixels = self.tiling.rect(TileId(0)).map_or(0, Rect::pixel_count);
        Pixels::byte_len(pixels, self.frame.aov())
    }

    /// What is to be done about an event, in order.
    pub fn handle<'a>(&mut self, event: Event<'a>) -> Vec<Action<'a>> {
        match event {
            Event::Tile { from, source, tile: pixels, bytes } => match self.take(source, &pixels, bytes) {
                Ok(first) => {
                    let TilePixels { tile, attempt, .. } = pixels;
                    let acknowledge = Action::Reply(from, ImageReply::Acknowledged { tile, attempt });
                    first.into_iter().chain([acknowledge]).collect()
                }
                Err(why) => {
                    let why = format!("{}, {}: {why}", pixels.tile, pixels.attempt);
                    let incident = Action::Report(DisplayReport::Incident(format!("refused {why}")));
                    vec![Action::Reply(from, ImageReply::Refused(why)), Action::Dismiss(from), incident]
                }
            },
            Event::Revoke(revocations) => {
                let revoke = |revocation: &Revocation| self.revoke(self.run, *revocation).then_some(*revocation);
                let news: Vec<Revocation> = revocations.iter().filter_map(revoke).collect();
                let append = |Revocation { tile, attempt }| Action::Append(Record::Revoked { tile, attempt });
                let told = Action::Report(DisplayReport::Revoked(revocations));
                news.into_iter().map(append).chain([told]).collect()
            }
            Event::TilesOf((node, epoch)) => {
                let tiles = self.bits(|kept| (kept.run, kept.source) == (self.run, (node, epoch)));
                vec![Action::Report(DisplayReport::TilesOf(node, epoch, tiles))]
            }
            Event::Refused(who) => vec![Action::Report(DisplayReport::Incident(who))],
        }
    }

    /// What is to be done before a result is acknowledged: the first one of a tile is kept, later ones are held against
    /// it. Says what is wrong with anything else.
    fn take<'a>(&mut self, source: Source, pixels: &TilePixels, bytes: &'a [u8]) -> Result<Option<Action<'a>>, String> {
        let TilePixels { tile, attempt, crc32c } = *pixels;
        let rect = self.tiling.rect(tile).ok_or_else(|| format!("the image has {} tiles", self.tiling.tile_count()))?;
        let found = crc32c::crc32c(bytes);
        if found != crc32c {
            return Err(format!("its pixels have crc32c {found:08x}, expected {crc32c:08x}"));
        }
        let expected = Pixels::byte_len(rect.pixel_count(), self.frame.aov());
        if bytes.len() != expected {
            return Err(format!("its pixels have {} bytes, expected {expected}", bytes.len()));
        }
        if self.revoked.get(&tile).is_some_and(|revoked| attempt <= *revoked) {
            self.tiles_stale += 1;
            return Ok(None);
        }
        let this = Kept { run: self.run, attempt, source };
        match self.kept[tile.0 as usize] {
            None => {
                self.keep(tile, this, bytes).map_err(|error| error.to_string())?;
                Ok(Some(Action::Append(Record::Pixels { tile, attempt, source, planes: bytes })))
            }
            // Sent again, as its acknowledgement was lost.
            Some(kept) if kept == this => Ok(None),
            Some(kept) => {
                self.tiles_stale += 1;
                let kept = self.result(rect, kept);
                let other = TileResult { attempt, source: Some(source), digest: Sha256::digest(bytes).into() };
                Ok(Some(Action::Report(DisplayReport::Compared(Comparison { tile, kept, other }))))
            }
        }
    }

    /// The first result of a tile goes into the frame; a later one changes nothing.
    fn keep(&mut self, tile: TileId, from: Kept, planes: &[u8]) -> Result<(), FrameBufferError> {
        let (Some(rect), Some(kept @ None)) = (self.tiling.rect(tile), self.kept.get_mut(tile.0 as usize)) else {
            return Ok(());
        };
        self.frame.blit_bytes(rect, planes)?;
        *kept = Some(from);
        self.tiles_done += 1;
        Ok(())
    }

    /// What is in the frame of a tile, taken from there: nothing is kept twice.
    fn result(&self, rect: Rect, kept: Kept) -> TileResult {
        let mut digest = Sha256::new();
        self.frame.rows(rect).for_each(|row| digest.update(row));
        TileResult {
            attempt: kept.attempt,
            source: (kept.run == self.run).then_some(kept.source),
            digest: digest.finalize().into(),
        }
    }

    /// Whether it makes a difference.
    fn revoke(&mut self, run: RunId, Revocation { tile, attempt }: Revocation) -> bool {
        let (Some(rect), Some(kept)) = (self.tiling.rect(tile), self.kept.get_mut(tile.0 as usize)) else {
            return false;
        };
        // Attempts of an earlier run come before all of a later one.
        let undone = kept.take_if(|kept| kept.run != run || kept.attempt <= attempt).is_some();
        if undone {
            self.frame.clear(rect);
            self.tiles_done -= 1;
        }
        let raised = run == self.run && self.revoked.get(&tile).is_none_or(|before| *before < attempt);
        if raised {
            self.revoked.insert(tile, attempt);
        }
        undone || raised
    }

    /// What there is, whole or partial.
    pub fn finish(self) -> Finished {
        Finished { frame: self.frame, tiles_done: self.tiles_done, tiles_stale: self.tiles_stale }
    }
}

#[derive(Debug)]
pub struct Finished {
    pub frame: FrameBuffer,
    pub tiles_done: u32,
    /// Results for tiles that were done already, and of attempts that were revoked.
    pub tiles_stale: u64,
}
