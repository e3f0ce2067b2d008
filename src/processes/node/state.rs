//! What a node decides: which tiles it holds, and how far each has come. Pure.
//!
//! A tile is held from the request for it until the display has acknowledged it:
//!
//! ```text
//! asked for → tracing (or waiting for the tracer) → sent to the display → done
//! ```

use crate::ids::{Attempt, TileId};
use crate::protocol::control::Packets;
use crate::protocol::work::{JOBS_PER_NODE, TileDone};
use crate::tracer::{Pixels, Rect, Tiling};

/// A tile to trace.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Job {
    pub tile: TileId,
    pub attempt: Attempt,
    pub rect: Rect,
}

/// A traced tile: its completion, and its pixels.
#[derive(Clone, PartialEq, Debug)]
pub struct Traced {
    pub done: Box<TileDone>,
    pub pixels: Pixels,
}

#[derive(Clone, PartialEq, Debug)]
pub enum Event {
    /// The tracer has what it needs; `Some` when it traces packets.
    TracerReady(Option<Packets>),
    /// The master hands out a tile.
    Job {
        tile: TileId,
        attempt: Attempt,
    },
    Traced(Traced),
    /// The display has the tile.
    Acknowledged {
        tile: TileId,
        attempt: Attempt,
    },
    /// This node is to go: it brings what it holds to its end, and takes nothing more.
    Leave,
}

#[derive(Clone, PartialEq, Debug)]
pub enum Action {
    /// Tell the manager what traces.
    TellPackets(Packets),
    /// Ask the master for one more tile.
    AskForTile,
    Trace(Job),
    SendPixels {
        tile: TileId,
        attempt: Attempt,
        pixels: Pixels,
    },
    TellDone(Box<TileDone>),
}

/// Another process says what has no place in the conversation.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum Violation {
    #[error("the master handed out {tile}, but the image has {tiles} tiles only")]
    NoSuchTile { tile: TileId, tiles: u32 },
    #[error("the master handed out {tile} unasked")]
    Unasked { tile: TileId },
    #[error("the display acknowledged {tile} ({attempt}), which was not sent")]
    NotSent { tile: TileId, attempt: Attempt },
}

/// At most [`JOBS_PER_NODE`] tiles, in whatever stage.
#[derive(Debug)]
pub struct State {
    tiling: Tiling,
    asked: usize,
    /// With the tracer.
    tracing: usize,
    leaving: bool,
    /// Sent to the display, not acknowledged.
    sent: Vec<TileDone>,
}

impl State {
    pub fn new(tiling: Tiling) -> Self {
        Self { tiling, asked: 0, tracing: 0, leaving: false, sent: Vec::new() }
    }

    /// Whether the display owes an acknowledgement.
    pub fn awaits_display(&self) -> bool {
        !self.sent.is_empty()
    }

    /// Whether it was told to go, and holds nothing any more.
    pub fn has_left(&self) -> bool {
        self.leaving && self.tracing == 0 && self.sent.is_empty()
    }

    /// # Errors
    /// The event cannot be: the process that caused it is at fault, and this one must not go on.
    pub fn handle(&mut self, event: Event) -> Result<Vec<Action>, Violation> {
        match event {
            Event::Leave => {
                self.leaving = true;
                Ok(Vec::new())
            }
            // It asks for nothing any more.
            Event::TracerReady(_) if self.leaving => Ok(Vec::new()),
            Event::TracerReady(packets) => {
                self.asked = JOBS_PER_NODE;
                let ask = std::iter::repeat_n(Action::AskForTile, JOBS_PER_NODE);
                Ok(packets.map(Action::TellPackets).into_iter().chain(ask).collect())
            }
            Event::Job { tile, attempt } => {
                let tiles = self.tiling.tile_count();
                let rect = self.tiling.rect(tile).ok_or(Violation::NoSuchTile { tile, tiles })?;
                self.asked = self.asked.checked_sub(1).ok_or(Violation::Unasked { tile })?;
                if self.leaving {
                    // Somebody else gets it when this process has ended.
                    return Ok(Vec::new());
                }
                self.tracing += 1;
                Ok(vec![Action::Trace(Job { tile, attempt, rect })])
            }
            Event::Traced(Traced { done, pixels }) => {
                let (tile, attempt) = (done.tile, done.attempt);
                self.tracing = self.tracing.saturating_sub(1);
                self.sent.push(*done);
                Ok(vec![Action::SendPixels { tile, attempt, pixels }])
            }
            Event::Acknowledged { tile, attempt } => {
                let sent = self.sent.iter().position(|done| (done.tile, done.attempt) == (tile, attempt));
                let done = self.sent.swap_remove(sent.ok_or(Violation::NotSent { tile, attempt })?);
                let done = Action::TellDone(Box::new(done));
                if self.leaving {
                    return Ok(vec![done]);
                }
                self.asked += 1;
                Ok(vec![done, Action::AskForTile])
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracer::TraceStats;
    use crate::tracer::simd::Simd;

    const TILING: Tiling = Tiling { width: 10, height: 10, tile_width: 4, tile_height: 4 };

    fn job(tile: u32) -> Event {
        Event::Job { tile: TileId(tile), attempt: Attempt(0) }
    }

    fn done(tile: u32) -> Box<TileDone> {
        Box::new(TileDone {
            tile: TileId(tile),
            attempt: Attempt(0),
            trace: TraceStats::default(),
            memory: None,
            render_cpu_nanoseconds: 1,
        })
    }

    fn pixels(tile: u32) -> Pixels {
        Pixels { primitive: vec![tile as i32], ..Pixels::default() }
    }

    fn traced(tile: u32) -> Event {
        Event::Traced(Traced { done: done(tile), pixels: pixels(tile) })
    }

    fn acknowledged(tile: u32) -> Event {
        Event::Acknowledged { tile: TileId(tile), attempt: Attempt(0) }
    }

    fn ready() -> State {
        let mut state = State::new(TILING);
        assert_eq!(state.handle(Event::TracerReady(None)), Ok(vec![Action::AskForTile; JOBS_PER_NODE]));
        state
    }

    #[test]
    fn a_node_that_traces_packets_says_so_first() {
        let packets = Packets { simd: Simd::Scalar, derived_bytes: 1 };
        let actions = State::new(TILING).handle(Event::TracerReady(Some(packets))).expect("ready once");
        assert_eq!(actions[..2], [Action::TellPackets(packets), Action::AskForTile]);
    }

    #[test]
    fn a_tile_goes_its_way() {
        let mut state = ready();
        let rect = Rect { x: 8, y: 8, width: 2, height: 2 };
        let (tile, attempt) = (TileId(8), Attempt(0));
        assert_eq!(state.handle(job(8)), Ok(vec![Action::Trace(Job { tile, attempt, rect })]));
        assert!(!state.awaits_display());
        assert_eq!(state.handle(traced(8)), Ok(vec![Action::SendPixels { tile, attempt, pixels: pixels(8) }]));
        assert!(state.awaits_display());
        assert_eq!(state.handle(acknowledged(8)), Ok(vec![Action::TellDone(done(8)), Action::AskForTile]));
        assert!(!state.awaits_display());
    }

    #[test]
    fn no_more_tiles_are_held_than_allowed_however_they_come() {
        let mut state = ready();
        let (mut asked, mut held) = (JOBS_PER_NODE, Vec::new());
        for tile in 0..9 {
            assert!(asked + held.len() <= JOBS_PER_NODE);
            asked -= 1;
            held.push(tile);
            state.handle(job(tile)).expect("asked for");
            // Every third tile overtakes the one before it.
            if asked == 0 {
                let next = held.remove(if tile % 3 == 0 { held.len() - 1 } else { 0 });
                state.handle(traced(next)).expect("held");
                let actions = state.handle(acknowledged(next)).expect("sent");
                asked += actions.iter().filter(|action| **action == Action::AskForTile).count();
            }
        }
    }

    #[test]
    fn a_node_that_goes_brings_its_tiles_to_their_end_and_takes_no_more() {
        let mut state = ready();
        state.handle(job(0)).expect("asked for");
        assert_eq!(state.handle(Event::Leave), Ok(Vec::new()));
        assert_eq!(state.handle(job(1)), Ok(Vec::new()), "it comes too late");
        assert!(!state.has_left());
        state.handle(traced(0)).expect("held");
        assert!(!state.has_left());
        assert_eq!(state.handle(acknowledged(0)), Ok(vec![Action::TellDone(done(0))]));
        assert!(state.has_left());
    }

    #[test]
    fn what_cannot_be_is_named() {
        let mut state = ready();
        assert_eq!(state.handle(job(9)), Err(Violation::NoSuchTile { tile: TileId(9), tiles: 9 }));
        for tile in 0..JOBS_PER_NODE as u32 {
            state.handle(job(tile)).expect("asked for");
        }
        assert_eq!(state.handle(job(3)), Err(Violation::Unasked { tile: TileId(3) }));
        let early = state.handle(acknowledged(0));
        assert_eq!(early, Err(Violation::NotSent { tile: TileId(0), attempt: Attempt(0) }));
        state.handle(traced(0)).expect("held");
        state.handle(acknowledged(0)).expect("sent");
        assert!(state.handle(acknowledged(0)).is_err(), "a tile is acknowledged once");
    }
}
