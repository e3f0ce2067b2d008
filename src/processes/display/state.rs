//! Which tiles are in the frame buffer. No socket, no file: the shell moves bytes and writes what comes out.

use crate::ids::TileId;
use crate::image_file::{FrameBuffer, FrameBufferError};
use crate::protocol::control::{DisplayConfiguration, DisplayReport};
use crate::protocol::image::{ImageReply, TilePixels};
use crate::tracer::{Pixels, Rect, Tiling};

/// A connection of a node, numbered as they come.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(super) struct ConnectionId(pub(super) u64);

#[derive(Debug)]
pub(super) enum Event<'a> {
    Tile {
        from: ConnectionId,
        tile: TilePixels,
        bytes: &'a [u8],
    },
    /// Somebody was not let in, or spoke nonsense.
    Refused(String),
}

#[derive(Clone, PartialEq, Debug)]
pub(super) enum Action {
    Reply(ConnectionId, ImageReply),
    /// End the connection, after what was replied.
    Dismiss(ConnectionId),
    Report(DisplayReport),
}

#[derive(Debug)]
pub(super) struct State {
    tiling: Tiling,
    frame: FrameBuffer,
    /// By tile id.
    done: Vec<bool>,
    tiles_done: u32,
    tiles_stale: u64,
}

impl State {
    /// # Errors
    /// The image is larger than allowed, or than the memory.
    pub(super) fn new(configuration: &DisplayConfiguration) -> Result<Self, FrameBufferError> {
        let DisplayConfiguration { tiling, aov, .. } = *configuration;
        let frame = FrameBuffer::new(tiling.width, tiling.height, aov)?;
        Ok(Self { tiling, frame, done: vec![false; tiling.tile_count() as usize], tiles_done: 0, tiles_stale: 0 })
    }

    /// Bulk bytes of a whole tile: no frame may carry more.
    pub(super) fn tile_bytes_max(&self) -> usize {
        let pixels = self.tiling.rect(TileId(0)).map_or(0, Rect::pixel_count);
        Pixels::byte_len(pixels, self.frame.aov())
    }

    /// What is to be done about an event, in order.
    pub(super) fn handle(&mut self, event: Event) -> Vec<Action> {
        match event {
            Event::Tile { from, tile: pixels, bytes } => match self.composite(&pixels, bytes) {
                Ok(()) => {
                    let TilePixels { tile, attempt, .. } = pixels;
                    vec![Action::Reply(from, ImageReply::Acknowledged { tile, attempt })]
                }
                Err(why) => {
                    let why = format!("{}, {}: {why}", pixels.tile, pixels.attempt);
                    let incident = Action::Report(DisplayReport::Incident(format!("refused {why}")));
                    vec![Action::Reply(from, ImageReply::Refused(why)), Action::Dismiss(from), incident]
                }
            },
            Event::Refused(who) => vec![Action::Report(DisplayReport::Incident(who))],
        }
    }

    /// Takes a tile once; later results are counted and dropped. Says what is wrong with anything else.
    fn composite(&mut self, pixels: &TilePixels, bytes: &[u8]) -> Result<(), String> {
        let (rect, done) = match (self.tiling.rect(pixels.tile), self.done.get_mut(pixels.tile.0 as usize)) {
            (Some(rect), Some(done)) => (rect, done),
            _ => return Err(format!("the image has {} tiles", self.tiling.tile_count())),
        };
        let found = crc32c::crc32c(bytes);
        if found != pixels.crc32c {
            return Err(format!("its pixels have crc32c {found:08x}, expected {:08x}", pixels.crc32c));
        }
        if *done {
            self.tiles_stale += 1;
            return Ok(());
        }
        self.frame.blit_bytes(rect, bytes).map_err(|error| error.to_string())?;
        *done = true;
        self.tiles_done += 1;
        Ok(())
    }

    /// What there is, whole or partial.
    pub(super) fn finish(self) -> Finished {
        Finished { frame: self.frame, tiles_done: self.tiles_done, tiles_stale: self.tiles_stale }
    }
}

#[derive(Debug)]
pub(super) struct Finished {
    pub(super) frame: FrameBuffer,
    pub(super) tiles_done: u32,
    /// Results for tiles that were done already.
    pub(super) tiles_stale: u64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ids::Attempt;
    use crate::tracer::AovSet;

    const NODE: ConnectionId = ConnectionId(3);

    fn state() -> State {
        State::new(&DisplayConfiguration {
            tiling: Tiling { width: 5, height: 4, tile_width: 3, tile_height: 2 },
            aov: AovSet { depth: true, ..AovSet::default() },
            journal: "tiles".into(),
            resume: false,
            fingerprint: [0; 32],
            image: "image.png".into(),
            exr: false,
        })
        .expect("a small image")
    }

    /// A tile of one colour; the upper left one is 3x2.
    fn tile(pixels: usize, grey: f32) -> Vec<u8> {
        let mut bytes = Vec::new();
        Pixels { colour: vec![[grey; 3]; pixels], depth: vec![1.0; pixels], ..Pixels::default() }
            .write_bytes(&mut bytes);
        bytes
    }

    fn send(state: &mut State, tile: u32, attempt: u32, bytes: &[u8]) -> Vec<Action> {
        let tile = TilePixels { tile: TileId(tile), attempt: Attempt(attempt), crc32c: crc32c::crc32c(bytes) };
        state.handle(Event::Tile { from: NODE, tile, bytes })
    }

    fn acknowledged(tile: u32, attempt: u32) -> Vec<Action> {
        let (tile, attempt) = (TileId(tile), Attempt(attempt));
        vec![Action::Reply(NODE, ImageReply::Acknowledged { tile, attempt })]
    }

    fn refusal(actions: &[Action]) -> &str {
        match actions {
            [Action::Reply(NODE, ImageReply::Refused(why)), Action::Dismiss(NODE), Action::Report(_)] => why,
            other => panic!("no refusal: {other:?}"),
        }
    }

    #[test]
    fn a_tile_is_composited_once_and_acknowledged_always() {
        let mut state = state();
        assert_eq!(send(&mut state, 0, 0, &tile(6, 0.25)), acknowledged(0, 0));
        // Not even looked at: another colour would show.
        assert_eq!(send(&mut state, 0, 1, &tile(6, 0.75)), acknowledged(0, 1));
        let Finished { frame, tiles_done, tiles_stale } = state.finish();
        assert_eq!((tiles_done, tiles_stale), (1, 1));
        assert_eq!(frame.pixels().colour[0], [0.25; 3]);
        assert_eq!(frame.pixels().colour[3], [0.0; 3]);
    }

    #[test]
    fn the_order_of_tiles_does_not_change_the_hash() {
        let sizes = [6, 4, 6, 4];
        let hash = |order: [u32; 4]| {
            let mut state = state();
            for id in order {
                assert_eq!(send(&mut state, id, 0, &tile(sizes[id as usize], id as f32)), acknowledged(id, 0));
            }
            state.finish().frame.sha256()
        };
        assert_eq!(hash([0, 1, 2, 3]), hash([3, 1, 0, 2]));
        assert_eq!(hash([0, 1, 2, 3]).len(), 64);
    }

    #[test]
    fn what_is_not_a_tiles_pixels_is_refused() {
        let mut state = state();
        assert!(refusal(&send(&mut state, 4, 0, &tile(6, 0.0))).contains("the image has 4 tiles"));
        // The right column's tiles are 2 pixels wide.
        assert!(refusal(&send(&mut state, 1, 0, &tile(6, 0.0))).contains("do not fill"));
        let torn = TilePixels { tile: TileId(0), attempt: Attempt(2), crc32c: 1 };
        let actions = state.handle(Event::Tile { from: NODE, tile: torn, bytes: &tile(6, 0.0) });
        assert!(refusal(&actions).starts_with("tile 0, attempt 2: its pixels have crc32c"));
        assert_eq!(state.finish().tiles_done, 0);
    }
}
