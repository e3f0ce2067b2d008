//! Which tiles are in the frame buffer, and whose. No socket, no file.

use std::collections::{BTreeMap, BTreeSet};

use sha2::{Digest, Sha256};

use crate::journal::Record;
use crate::processes::driver::ConnectionId;
use crate::protocol::control::{
    Comparison, DisplayConfiguration, DisplayReport, Holdings, PRODUCERS_MAX, Share, TileResult, TileSet,
};
use crate::protocol::image::{ImageReply, TilePixels};
use crate::protocol::mac::{Claim, MacKey};
use ground::ids::{Attempt, Epoch, NodeId, Producer, RunId, TileId};
use trace::image_file::{FrameBuffer, FrameBufferError};
use trace::picture::{Pixels, Rect, Tiling};

/// Which process of this run traced.
pub type Source = (NodeId, Epoch);

#[derive(Debug)]
pub enum Event<'a> {
    Tile {
        from: ConnectionId,
        source: Source,
        tile: TilePixels,
        bytes: &'a [u8],
    },
    /// The manager's: all tiles of this process are wrong.
    Condemn(Producer),
    /// The manager asks what is in the frame.
    TellHoldings {
        question: u32,
    },
    /// A peer was refused, sent what is no message, or did not read.
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
    producer: Producer,
    attempt: Attempt,
}

#[derive(Debug)]
pub struct Composition {
    run: RunId,
    key: MacKey,
    tiling: Tiling,
    frame: FrameBuffer,
    /// By tile id.
    kept: Vec<Option<Kept>>,
    shares: BTreeMap<Producer, Share>,
    condemned: BTreeSet<Producer>,
    tiles_stale: u64,
}

/// Why a tile is not taken.
enum Refusal {
    /// Bytes went wrong on the way.
    Damaged(String),
    /// No honest process sends this.
    Forged(String),
    /// Its process is known to be wrong.
    Condemned,
}

impl Composition {
    /// # Errors
    /// The image is larger than allowed, or than the memory.
    pub fn new(configuration: &DisplayConfiguration, run: RunId) -> Result<Self, FrameBufferError> {
        let DisplayConfiguration { tiling, aov, key, .. } = *configuration;
        let frame = FrameBuffer::new(tiling.sides().width, tiling.sides().height, aov)?;
        Ok(Self {
            run,
            key,
            tiling,
            frame,
            kept: vec![None; tiling.tile_count() as usize],
            shares: BTreeMap::new(),
            condemned: BTreeSet::new(),
            tiles_stale: 0,
        })
    }

    /// Takes over what an earlier display appended, in the order in which it did.
    pub fn restore(&mut self, record: &Record) {
        match *record {
            Record::Pixels { tile, attempt, producer, planes } => {
                let is_listed = self.shares.len() < PRODUCERS_MAX || self.shares.contains_key(&producer);
                if is_listed && !self.condemned.contains(&producer) {
                    // Cannot fail: a journal is of this image, and its tiles are whole.
                    let _ = self.keep(tile, Kept { producer, attempt }, planes);
                }
            }
            Record::Condemned(producer) => {
                self.condemn(producer);
            }
        }
    }

    pub fn holdings(&self) -> Holdings {
        Holdings {
            tiles: self.kept.iter().map(Option::is_some).collect(),
            shares: self.shares.values().copied().take(PRODUCERS_MAX).collect(),
        }
    }

    /// Processes whose tiles are in the frame, and condemned ones.
    pub fn sizes(&self) -> [usize; 2] {
        [self.shares.len(), self.condemned.len()]
    }

    /// Bulk bytes of a whole tile: no frame may carry more.
    pub fn tile_bytes_max(&self) -> usize {
        let pixels = self.tiling.rect(TileId(0)).map_or(0, Rect::pixel_count);
        Pixels::byte_len(pixels, self.frame.aov())
    }

    /// What is to be done about an event, in order.
    pub fn handle<'a>(&mut self, event: Event<'a>) -> Vec<Action<'a>> {
        match event {
            Event::Tile { from, source, tile: pixels, bytes } => self.tile(from, source, &pixels, bytes),
            Event::Condemn(producer) => {
                let is_new = !self.condemned.contains(&producer);
                let tiles = self.condemn(producer);
                let append = is_new.then_some(Action::Append(Record::Condemned(producer)));
                append.into_iter().chain([Action::Report(DisplayReport::Condemned(producer, tiles))]).collect()
            }
            Event::TellHoldings { question } => {
                vec![Action::Report(DisplayReport::Holdings { question, holdings: self.holdings() })]
            }
            Event::Refused(who) => vec![Action::Report(DisplayReport::Incident(who))],
        }
    }

    fn tile<'a>(
        &mut self,
        from: ConnectionId,
        source: Source,
        pixels: &TilePixels,
        bytes: &'a [u8],
    ) -> Vec<Action<'a>> {
        let TilePixels { tile, attempt, .. } = *pixels;
        let (node, epoch) = source;
        match self.take(source, pixels, bytes) {
            Ok(first) => {
                let receipt = self.key.receipt(Claim { tile, attempt, node, epoch });
                let acknowledge = Action::Reply(from, ImageReply::Acknowledged { tile, attempt, receipt });
                first.into_iter().chain([acknowledge]).collect()
            }
            Err(Refusal::Damaged(why)) => {
                let why = format!("{tile}, {attempt}: {why}");
                let incident = DisplayReport::Incident(format!("refused {why}"));
                vec![Action::Reply(from, ImageReply::Refused(why)), Action::Dismiss(from), Action::Report(incident)]
            }
            Err(Refusal::Forged(why)) => {
                let why = format!("{tile}, {attempt}: {why}");
                vec![Action::Dismiss(from), Action::Report(DisplayReport::Forged { node, epoch, why })]
            }
            Err(Refusal::Condemned) => {
                self.tiles_stale += 1;
                vec![Action::Dismiss(from)]
            }
        }
    }

    /// What is to be done before a result is acknowledged: the first one of a tile is kept, later ones are compared with
    /// it.
    fn take<'a>(
        &mut self,
        (node, epoch): Source,
        pixels: &TilePixels,
        bytes: &'a [u8],
    ) -> Result<Option<Action<'a>>, Refusal> {
        let TilePixels { tile, attempt, permit, crc32c } = *pixels;
        let producer = Producer { run: self.run, node, epoch };
        if self.condemned.contains(&producer) {
            return Err(Refusal::Condemned);
        }
        if !self.key.is_permit(Claim { tile, attempt, node, epoch }, permit) {
            return Err(Refusal::Forged("the master did not hand it to this process".to_owned()));
        }
        let tiles = self.tiling.tile_count();
        let rect = self.tiling.rect(tile).ok_or_else(|| Refusal::Damaged(format!("the image has {tiles} tiles")))?;
        let found = crc32c::crc32c(bytes);
        if found != crc32c {
            return Err(Refusal::Damaged(format!("its pixels have crc32c {found:08x}, expected {crc32c:08x}")));
        }
        let expected = Pixels::byte_len(rect.pixel_count(), self.frame.aov());
        if bytes.len() != expected {
            let why = format!("its pixels have {} bytes, expected {expected}", bytes.len());
            return Err(Refusal::Damaged(why));
        }
        if !Pixels::have_finite_colours(rect.pixel_count(), bytes) {
            return Err(Refusal::Forged("its pixels are not finite, which no tracer sends".to_owned()));
        }
        let this = Kept { producer, attempt };
        match self.kept[tile.0 as usize] {
            None => {
                self.keep(tile, this, bytes).map_err(|error| Refusal::Damaged(error.to_string()))?;
                Ok(Some(Action::Append(Record::Pixels { tile, attempt, producer, planes: bytes })))
            }
            // Sent again, as its acknowledgement was lost.
            Some(kept) if kept == this && self.frame.rows(rect).flatten().eq(bytes) => Ok(None),
            Some(kept) if kept == this => Err(Refusal::Forged("it was sent twice, with different pixels".to_owned())),
            Some(kept) => {
                self.tiles_stale += 1;
                let kept = self.result(rect, kept);
                let other = TileResult { producer, digest: Sha256::digest(bytes).into() };
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
        let producer = from.producer;
        let share = self.shares.entry(producer).or_insert(Share { producer, tiles: 0, latest: tile });
        *share = Share { tiles: share.tiles + 1, latest: tile, producer };
        Ok(())
    }

    /// What is in the frame of a tile, taken from there: nothing is kept twice.
    fn result(&self, rect: Rect, kept: Kept) -> TileResult {
        let mut digest = Sha256::new();
        self.frame.rows(rect).for_each(|row| digest.update(row));
        TileResult { producer: kept.producer, digest: digest.finalize().into() }
    }

    /// Takes what a process did out of the frame, and nothing of it from now on. The tiles that were taken out.
    fn condemn(&mut self, producer: Producer) -> TileSet {
        self.condemned.insert(producer);
        if self.shares.remove(&producer).is_none() {
            return TileSet::default();
        }
        let (tiling, frame) = (self.tiling, &mut self.frame);
        let take_out = |(i, kept): (usize, &mut Option<Kept>)| {
            let is_taken_out = kept.take_if(|kept| kept.producer == producer).is_some();
            if let (true, Some(rect)) = (is_taken_out, tiling.rect(TileId(i as u32))) {
                frame.clear(rect);
            }
            is_taken_out
        };
        self.kept.iter_mut().enumerate().map(take_out).collect()
    }

    /// What there is, whole or partial.
    pub fn finish(self) -> Finished {
        let tiles_done = self.kept.iter().flatten().count() as u32;
        Finished { frame: self.frame, tiles_done, tiles_stale: self.tiles_stale }
    }
}

#[derive(Debug)]
pub struct Finished {
    pub frame: FrameBuffer,
    pub tiles_done: u32,
    /// Results for tiles that were done already, and of processes that are known to be wrong.
    pub tiles_stale: u64,
}
