//! Which tiles a node holds, and how far each has come. Pure.
//!
//! A tile is held from the request for it until the display has acknowledged it:
//!
//! ```text
//! asked for → tracing (or waiting for the tracer) → sent to the display → done
//! ```
//!
//! Its pixels are kept as long: a display that dies takes what it did not acknowledge with it, and its successor gets it.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use crate::protocol::control::Packets;
use crate::protocol::mac::Mac;
use crate::protocol::work::{TileDone, jobs_per_node};
use ground::ids::{Attempt, TileId};
use trace::picture::{Pixels, Rect, Tiling};

/// Until a display that was lost, or could not be reached, is dialled again: the network may have been at fault.
pub const REDIAL_PAUSE: Duration = Duration::from_millis(250);

/// A tile to trace.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Job {
    pub tile: TileId,
    pub attempt: Attempt,
    pub rect: Rect,
    pub permit: Mac,
}

/// A traced tile: its completion, and its pixels.
#[derive(Clone, PartialEq, Debug)]
pub struct Traced {
    pub done: Box<TileDone>,
    pub pixels: Arc<Pixels>,
    /// Of its job.
    pub permit: Mac,
}

#[derive(Clone, PartialEq, Debug)]
pub enum Event {
    /// The tracer has what it needs; `Some` when it traces packets.
    TracerReady(Option<Packets>),
    /// The master hands out a tile.
    Job {
        tile: TileId,
        attempt: Attempt,
        permit: Mac,
    },
    Traced(Traced),
    /// The display has the tile.
    Acknowledged {
        tile: TileId,
        attempt: Attempt,
        receipt: Mac,
    },
    /// The connection that was dialled last is there.
    DisplayReached,
    /// It has ended, or could not be made.
    DisplayLost,
    /// The manager's: there is a new display.
    NewDisplay(SocketAddr),
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
    /// Instead of whatever connection to a display there is.
    DialDisplay {
        address: SocketAddr,
        pause: Duration,
    },
    SendPixels {
        tile: TileId,
        attempt: Attempt,
        permit: Mac,
        pixels: Arc<Pixels>,
    },
    TellDone {
        done: Box<TileDone>,
        /// The display's.
        receipt: Mac,
    },
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

/// At most [`jobs_per_node`] tiles, in whatever stage.
#[derive(Debug)]
pub struct Tiles {
    tiling: Tiling,
    /// Of the tracer.
    threads: u16,
    asked: usize,
    /// With the tracer.
    tracing: usize,
    leaving: bool,
    /// The display's.
    address: SocketAddr,
    /// Whether a connection to the display is there.
    reached: bool,
    /// Traced, and not acknowledged: sent where the display was reached, in this order.
    traced: Vec<Traced>,
}

impl Tiles {
    /// The display is to be dialled.
    pub fn new(tiling: Tiling, threads: u16, display: SocketAddr) -> Self {
        Self {
            tiling,
            threads,
            asked: 0,
            tracing: 0,
            leaving: false,
            address: display,
            reached: false,
            traced: Vec::new(),
        }
    }

    /// Whether the display owes something: its presence, or an acknowledgement.
    pub fn awaits_display(&self) -> bool {
        !self.reached || !self.traced.is_empty()
    }

    /// Tiles that it has.
    pub fn held(&self) -> usize {
        self.tracing + self.traced.len()
    }

    /// Whether it was asked to leave, and has nothing any more.
    pub fn has_left(&self) -> bool {
        self.leaving && self.tracing == 0 && self.traced.is_empty()
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
                self.asked = jobs_per_node(self.threads);
                let ask = std::iter::repeat_n(Action::AskForTile, self.asked);
                Ok(packets.map(Action::TellPackets).into_iter().chain(ask).collect())
            }
            Event::Job { tile, attempt, permit } => {
                let tiles = self.tiling.tile_count();
                let rect = self.tiling.rect(tile).ok_or(Violation::NoSuchTile { tile, tiles })?;
                self.asked = self.asked.checked_sub(1).ok_or(Violation::Unasked { tile })?;
                if self.leaving {
                    // Somebody else gets it when this process has ended.
                    return Ok(Vec::new());
                }
                self.tracing += 1;
                Ok(vec![Action::Trace(Job { tile, attempt, rect, permit })])
            }
            Event::Traced(traced) => {
                self.tracing = self.tracing.saturating_sub(1);
                let send = self.reached.then(|| traced.send());
                self.traced.push(traced);
                Ok(send.into_iter().collect())
            }
            Event::Acknowledged { tile, attempt, receipt } => {
                let is_it = |traced: &Traced| (traced.done.tile, traced.done.attempt) == (tile, attempt);
                let traced = self.traced.iter().position(is_it).filter(|_| self.reached);
                let Traced { done, .. } = self.traced.remove(traced.ok_or(Violation::NotSent { tile, attempt })?);
                if self.leaving {
                    return Ok(vec![Action::TellDone { done, receipt }]);
                }
                self.asked += 1;
                Ok(vec![Action::TellDone { done, receipt }, Action::AskForTile])
            }
            Event::DisplayReached => {
                self.reached = true;
                Ok(self.traced.iter().map(Traced::send).collect())
            }
            Event::DisplayLost => Ok(vec![self.dial(REDIAL_PAUSE)]),
            Event::NewDisplay(address) => {
                self.address = address;
                Ok(vec![self.dial(Duration::ZERO)])
            }
        }
    }

    fn dial(&mut self, pause: Duration) -> Action {
        self.reached = false;
        Action::DialDisplay { address: self.address, pause }
    }
}

impl Traced {
    fn send(&self) -> Action {
        let TileDone { tile, attempt, .. } = *self.done;
        Action::SendPixels { tile, attempt, permit: self.permit, pixels: Arc::clone(&self.pixels) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::mac::{Claim, MacKey};
    use ground::ids::{Epoch, NodeId};
    use trace::picture::Sides;
    use trace::tracer::TraceStats;
    use trace::tracer::simd::Simd;

    const CLAIM: Claim = Claim { tile: TileId(0), attempt: Attempt(0), node: NodeId(0), epoch: Epoch(0) };
    const KEY: MacKey = MacKey::new([1; 32]);
    const TILING: Tiling =
        Tiling::new(Sides { width: 10, height: 10, tile_width: 4, tile_height: 4 }).expect("possible");

    fn permit() -> Mac {
        KEY.permit(CLAIM)
    }

    fn receipt() -> Mac {
        KEY.receipt(CLAIM)
    }

    fn job(tile: u32) -> Event {
        Event::Job { tile: TileId(tile), attempt: Attempt(0), permit: permit() }
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

    fn tell_done(tile: u32) -> Action {
        Action::TellDone { done: done(tile), receipt: receipt() }
    }

    fn display(port: u16) -> SocketAddr {
        ([127, 0, 0, 1], port).into()
    }

    fn pixels(tile: u32) -> Arc<Pixels> {
        Arc::new(Pixels { primitive: vec![tile as i32], ..Pixels::default() })
    }

    fn send(tile: u32) -> Action {
        Action::SendPixels { tile: TileId(tile), attempt: Attempt(0), permit: permit(), pixels: pixels(tile) }
    }

    fn dial(port: u16, pause: Duration) -> Result<Vec<Action>, Violation> {
        Ok(vec![Action::DialDisplay { address: display(port), pause }])
    }

    fn traced(tile: u32) -> Event {
        Event::Traced(Traced { done: done(tile), pixels: pixels(tile), permit: permit() })
    }

    fn acknowledged(tile: u32) -> Event {
        Event::Acknowledged { tile: TileId(tile), attempt: Attempt(0), receipt: receipt() }
    }

    fn ready() -> Tiles {
        let mut state = Tiles::new(TILING, 1, display(1));
        assert_eq!(state.handle(Event::TracerReady(None)), Ok(vec![Action::AskForTile; jobs_per_node(1)]));
        assert!(state.awaits_display());
        assert_eq!(state.handle(Event::DisplayReached), Ok(vec![]));
        assert!(!state.awaits_display());
        state
    }

    /// Every one of the tiles that may be held has been traced.
    fn traced_all() -> Tiles {
        let mut state = ready();
        for tile in 0..jobs_per_node(1) as u32 {
            state.handle(job(tile)).expect("asked for");
            assert_eq!(state.handle(traced(tile)), Ok(vec![send(tile)]));
        }
        state
    }

    #[test]
    fn a_node_that_traces_packets_says_so_first() {
        let packets = Packets { simd: Simd::Scalar, derived_bytes: 1 };
        let actions = Tiles::new(TILING, 1, display(1)).handle(Event::TracerReady(Some(packets))).expect("ready once");
        assert_eq!(actions[..2], [Action::TellPackets(packets), Action::AskForTile]);
    }

    #[test]
    fn a_tile_goes_its_way() {
        let mut state = ready();
        let rect = Rect { x: 8, y: 8, width: 2, height: 2 };
        let (tile, attempt) = (TileId(8), Attempt(0));
        assert_eq!(state.handle(job(8)), Ok(vec![Action::Trace(Job { tile, attempt, rect, permit: permit() })]));
        assert!(!state.awaits_display());
        assert_eq!(state.handle(traced(8)), Ok(vec![send(8)]));
        assert!(state.awaits_display());
        assert_eq!(state.handle(acknowledged(8)), Ok(vec![tell_done(8), Action::AskForTile]));
        assert!(!state.awaits_display());
    }

    #[test]
    fn no_more_tiles_are_held_than_allowed_however_they_come() {
        let mut state = ready();
        let (mut asked, mut held) = (jobs_per_node(1), Vec::new());
        for tile in 0..9 {
            assert!(asked + held.len() <= jobs_per_node(1));
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
        assert_eq!(state.handle(acknowledged(0)), Ok(vec![tell_done(0)]));
        assert!(state.has_left());
    }

    #[test]
    fn a_new_display_gets_what_the_last_one_did_not_acknowledge() {
        let mut state = traced_all();
        state.handle(acknowledged(1)).expect("sent");
        assert_eq!(state.handle(Event::DisplayLost), dial(1, REDIAL_PAUSE));
        assert!(state.awaits_display());
        // Nobody is there to have acknowledged anything.
        assert!(state.handle(acknowledged(0)).is_err());
        assert_eq!(state.handle(Event::DisplayLost), dial(1, REDIAL_PAUSE), "it cannot be dialled");
        assert_eq!(state.handle(Event::NewDisplay(display(2))), dial(2, Duration::ZERO));
        // What is traced meanwhile waits.
        state.handle(job(4)).expect("asked for");
        assert_eq!(state.handle(traced(4)), Ok(vec![]));
        assert_eq!(state.handle(Event::DisplayLost), dial(2, REDIAL_PAUSE));
        assert_eq!(state.handle(Event::DisplayReached), Ok([0, 2, 3, 4].map(send).to_vec()));
        for tile in [0, 2, 3, 4] {
            let told = vec![tell_done(tile), Action::AskForTile];
            assert_eq!(state.handle(acknowledged(tile)), Ok(told));
        }
        assert!(!state.awaits_display());
    }

    #[test]
    fn a_display_that_is_replaced_while_it_is_there_is_left() {
        let mut state = traced_all();
        assert_eq!(state.handle(Event::NewDisplay(display(2))), dial(2, Duration::ZERO));
        assert_eq!(state.handle(Event::DisplayReached), Ok([0, 1, 2, 3].map(send).to_vec()));
    }

    #[test]
    fn a_display_that_dies_before_it_is_dialled_holds_nothing_up() {
        let mut state = Tiles::new(TILING, 1, display(1));
        assert_eq!(state.handle(Event::DisplayLost), dial(1, REDIAL_PAUSE));
        state.handle(Event::TracerReady(None)).expect("once");
        state.handle(job(0)).expect("asked for");
        assert_eq!(state.handle(traced(0)), Ok(vec![]));
        assert_eq!(state.handle(Event::NewDisplay(display(2))), dial(2, Duration::ZERO));
        assert_eq!(state.handle(Event::DisplayReached), Ok(vec![send(0)]));
    }

    #[test]
    fn what_cannot_be_is_named() {
        let mut state = ready();
        assert_eq!(state.handle(job(9)), Err(Violation::NoSuchTile { tile: TileId(9), tiles: 9 }));
        for tile in 0..jobs_per_node(1) as u32 {
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
