//! A node from its first command to its end: whom it talks to, and how long it waits for each. No socket, no thread, no
//! clock. What becomes of tiles is decided in `tiles`.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use bytes::BytesMut;

use super::corruption::Corruption;
use super::tiles::{self, Job, Tiles, Traced};
use crate::processes::driver::{self, ConnectionId, Loss, Machine};
use crate::protocol::control::{NodeCommand, NodeConfiguration, NodeReport, Packets};
use crate::protocol::frame::{self, CodecError};
use crate::protocol::hello::Role;
use crate::protocol::image::{ImageReply, TilePixels};
use crate::protocol::mac::Mac;
use crate::protocol::work::{WorkReply, WorkRequest};
use ground::ids::{Attempt, ClusterId, TileId};
use trace::picture::Pixels;

/// For the display to acknowledge a tile; for a new one to be there, when the last is not.
const ACKNOWLEDGE_DEADLINE: Duration = Duration::from_secs(30);
/// From being asked to go until it goes, whatever it holds: its tiles are done by others then.
const LEAVE_DEADLINE: Duration = Duration::from_secs(25);
const WAITING_MAX: usize = 64;

const MASTER: ConnectionId = ConnectionId::Dialled(0);

/// From the master or the display.
#[derive(Clone, PartialEq, Debug)]
pub enum Incoming {
    Work(WorkReply),
    Image(ImageReply),
}

/// To the master or the display.
#[derive(Clone, PartialEq, Debug)]
pub enum Outgoing {
    Work(WorkRequest),
    Pixels { tile: TileId, attempt: Attempt, permit: Mac, pixels: Arc<Pixels> },
}

/// The tracer's.
#[derive(Clone, PartialEq, Debug)]
pub enum Task {
    /// Comes first, once.
    Start(Box<NodeConfiguration>),
    /// At most [`jobs_per_node`](crate::protocol::work::jobs_per_node) wait.
    Trace(Job),
}

#[derive(Clone, PartialEq, Debug)]
pub enum Answer {
    /// It has what it needs. `Some`: it traces packets.
    Ready(Option<Packets>),
    Traced(Traced),
    /// It has ended.
    Failed(String),
}

type Event = driver::Event<State>;
type Action = driver::Action<State>;
type End = driver::End<State>;

#[derive(Debug, thiserror::Error)]
pub enum NodeError {
    #[error("the {0} closed the connection")]
    Left(Role),
    #[error("tracer: {0}")]
    Tracer(String),
    #[error("the display refused a tile: {0}")]
    PixelsRefused(String),
    #[error("the display acknowledged nothing for {} s", ACKNOWLEDGE_DEADLINE.as_secs())]
    Unacknowledged,
    #[error("no display for {} s: {why}", ACKNOWLEDGE_DEADLINE.as_secs())]
    NoDisplay { why: String },
}

/// It was asked to go, and holds no tile any more.
const LEFT: End = End::Done(NodeReport::Leaving);

#[derive(Debug)]
pub struct State {
    /// Its own.
    role: Role,
    phase: Phase,
    /// Its pixels are to be wrong.
    is_corrupt: bool,
}

#[derive(Debug)]
enum Phase {
    Unconfigured,
    Working(Box<Work>),
    Over,
}

#[derive(Debug)]
struct Work {
    cluster: ClusterId,
    tiles: Tiles,
    master_reached: bool,
    /// The tracer was ready before the master answered.
    ready: Option<Option<Packets>>,
    display: DisplayLink,
    /// When what the display owes is overdue.
    late: Duration,
    /// Once it was asked to go.
    leave_by: Option<Duration>,
}

#[derive(Debug)]
struct DisplayLink {
    /// How often it was dialled, which is the number of the last connection.
    dialled: u32,
    /// Why there is none; `None` while there is one.
    loss: Option<String>,
}

impl State {
    /// Of a node that is about to be configured.
    pub fn new(role: Role) -> Self {
        Self { role, phase: Phase::Unconfigured, is_corrupt: false }
    }

    /// Tiles that it has.
    pub fn tiles(&self) -> usize {
        match &self.phase {
            Phase::Working(work) => work.tiles.held(),
            _ => 0,
        }
    }
}

impl Machine for State {
    type Command = NodeCommand;
    type Report = NodeReport;
    type Incoming = Incoming;
    type Outgoing = Outgoing;
    type Task = Task;
    type Answer = Answer;

    const WAITING_MAX: usize = WAITING_MAX;
    const LEAVES: bool = true;
    const FAILED: fn(String) -> NodeReport = NodeReport::Failed;

    fn step(&mut self, now: Duration, event: Event, actions: &mut Vec<Action>) -> Result<(), End> {
        if let Event::Command(NodeCommand::Corrupt) = event {
            self.is_corrupt = true;
            return Ok(());
        }
        match (&mut self.phase, event) {
            (Phase::Over, _) => Ok(()),
            (_, Event::Command(NodeCommand::Finish)) => Err(End::Done(NodeReport::Finished)),
            (Phase::Unconfigured, Event::Command(NodeCommand::Configure(configuration))) => {
                self.phase = Phase::Working(Box::new(Work::begin(now, configuration, actions)));
                Ok(())
            }
            (Phase::Unconfigured, Event::Terminate) => Err(LEFT),
            (Phase::Working(work), Event::Answer(Answer::Traced(mut traced))) => {
                if self.is_corrupt {
                    let tile = traced.done.tile;
                    Corruption::of(self.role).flip_a_bit(Arc::make_mut(&mut traced.pixels), tile);
                }
                work.handle(now, tiles::Event::Traced(traced), actions)
            }
            (Phase::Working(work), event) => work.step(now, event, actions),
            // The configuration will say which display there is.
            (Phase::Unconfigured, _) => Ok(()),
        }
    }

    fn be_over(&mut self) {
        self.phase = Phase::Over;
    }

    fn next_deadline(&self) -> Option<Duration> {
        let Phase::Working(work) = &self.phase else { return None };
        let late = work.tiles.awaits_display().then_some(work.late);
        late.into_iter().chain(work.leave_by).min()
    }

    fn frame_bytes_max(&self, peer: Role) -> usize {
        match peer {
            Role::Display => frame::frame_bytes_max::<ImageReply>(),
            _ => frame::frame_bytes_max::<WorkReply>(),
        }
    }
}

impl Work {
    fn begin(now: Duration, configuration: Box<NodeConfiguration>, actions: &mut Vec<Action>) -> Self {
        let NodeConfiguration { cluster, master, display, tiling, threads, .. } = *configuration;
        let role = Role::Master(cluster);
        actions.push(Action::Dial { id: MASTER, role, address: master, pause: Duration::ZERO });
        let mut work = Self {
            cluster,
            tiles: Tiles::new(tiling, threads, display),
            master_reached: false,
            ready: None,
            display: DisplayLink { dialled: 0, loss: None },
            late: now + ACKNOWLEDGE_DEADLINE,
            leave_by: None,
        };
        work.dial(display, Duration::ZERO, actions);
        actions.push(Action::Task(Task::Start(configuration)));
        work
    }

    fn step(&mut self, now: Duration, event: Event, actions: &mut Vec<Action>) -> Result<(), End> {
        let display = ConnectionId::Dialled(self.display.dialled);
        match event {
            Event::Command(NodeCommand::Display(address)) => {
                self.handle(now, tiles::Event::NewDisplay(address), actions)
            }
            Event::Command(NodeCommand::Configure(_)) => {
                tracing::warn!("configured twice: the second is not heeded");
                Ok(())
            }
            Event::Terminate => {
                self.leave_by.get_or_insert(now + LEAVE_DEADLINE);
                self.handle(now, tiles::Event::Leave, actions)
            }
            Event::Dialled(MASTER) => {
                self.master_reached = true;
                match self.ready.take() {
                    Some(packets) => self.handle(now, tiles::Event::TracerReady(packets), actions),
                    None => Ok(()),
                }
            }
            Event::Answer(Answer::Ready(packets)) if self.master_reached => {
                self.handle(now, tiles::Event::TracerReady(packets), actions)
            }
            Event::Answer(Answer::Ready(packets)) => {
                self.ready = Some(packets);
                Ok(())
            }
            Event::Answer(Answer::Failed(why)) | Event::Failed(why) => Err(NodeError::Tracer(why).into()),
            Event::Received(MASTER, Incoming::Work(WorkReply::Job { tile, attempt, permit })) => {
                self.handle(now, tiles::Event::Job { tile, attempt, permit }, actions)
            }
            Event::Closed(MASTER, None) => Err(NodeError::Left(Role::Master(self.cluster)).into()),
            Event::Closed(MASTER, Some(Loss { why, .. })) => Err(End::Failed(why)),
            Event::Dialled(id) if id == display => {
                self.display.loss = None;
                self.handle(now, tiles::Event::DisplayReached, actions)
            }
            Event::Received(id, Incoming::Image(reply)) if id == display => match reply {
                ImageReply::Acknowledged { tile, attempt, receipt } => {
                    self.handle(now, tiles::Event::Acknowledged { tile, attempt, receipt }, actions)
                }
                ImageReply::Refused(why) => Err(NodeError::PixelsRefused(why).into()),
            },
            Event::Closed(id, loss) if id == display => {
                let why = loss.map_or_else(|| "the display closed the connection".to_owned(), |loss| loss.why);
                tracing::warn!("no display: {why}");
                self.display.loss = Some(why);
                self.handle(now, tiles::Event::DisplayLost, actions)
            }
            Event::Deadline => self.look(now),
            _ => Ok(()),
        }
    }

    fn look(&self, now: Duration) -> Result<(), End> {
        if self.leave_by.is_some_and(|by| now >= by) {
            return Err(LEFT);
        }
        if !self.tiles.awaits_display() || now < self.late {
            return Ok(());
        }
        Err(match &self.display.loss {
            Some(why) => NodeError::NoDisplay { why: why.clone() },
            None => NodeError::Unacknowledged,
        }
        .into())
    }

    fn handle(&mut self, now: Duration, event: tiles::Event, actions: &mut Vec<Action>) -> Result<(), End> {
        use tiles::Event::{Acknowledged, NewDisplay, Traced};
        if matches!(event, Traced(_) | Acknowledged { .. } | NewDisplay(_)) || !self.tiles.awaits_display() {
            self.late = now + ACKNOWLEDGE_DEADLINE;
        }
        for action in self.tiles.handle(event)? {
            match action {
                tiles::Action::TellPackets(packets) => actions.push(Action::Report(NodeReport::Packets(packets))),
                tiles::Action::AskForTile => {
                    actions.push(Action::Send(MASTER, Outgoing::Work(WorkRequest::Ready)));
                }
                tiles::Action::TellDone { done, receipt } => {
                    actions.push(Action::Send(MASTER, Outgoing::Work(WorkRequest::Done { done, receipt })));
                }
                tiles::Action::Trace(job) => actions.push(Action::Task(Task::Trace(job))),
                tiles::Action::DialDisplay { address, pause } => self.dial(address, pause, actions),
                tiles::Action::SendPixels { tile, attempt, permit, pixels } => {
                    let display = ConnectionId::Dialled(self.display.dialled);
                    actions.push(Action::Send(display, Outgoing::Pixels { tile, attempt, permit, pixels }));
                }
            }
        }
        if self.tiles.has_left() { Err(LEFT) } else { Ok(()) }
    }

    /// Leaves whatever connection to a display there is, and makes another after a pause.
    fn dial(&mut self, address: SocketAddr, pause: Duration, actions: &mut Vec<Action>) {
        self.display.loss.get_or_insert_with(|| format!("{address} does not answer"));
        if self.display.dialled > 0 {
            actions.push(Action::Close(ConnectionId::Dialled(self.display.dialled)));
        }
        self.display.dialled += 1;
        let id = ConnectionId::Dialled(self.display.dialled);
        actions.push(Action::Dial { id, role: Role::Display, address, pause });
    }
}

impl driver::Incoming for Incoming {
    fn decode(peer: Role, frame: BytesMut) -> Result<Self, CodecError> {
        match peer {
            Role::Display => Ok(Self::Image(frame::decode_whole(&frame)?)),
            _ => Ok(Self::Work(frame::decode_whole(&frame)?)),
        }
    }
}

impl driver::Outgoing for Outgoing {
    fn frame(&self, head: &mut Vec<u8>) -> Result<[&[u8]; 4], CodecError> {
        match self {
            Self::Work(request) => {
                frame::encode_head(request, 0, head)?;
                Ok([&[]; 4])
            }
            Self::Pixels { tile, attempt, permit, pixels } => {
                let planes = pixels.planes();
                let crc32c = planes.iter().fold(0, |crc, plane| crc32c::crc32c_append(crc, plane));
                let pixels = TilePixels { tile: *tile, attempt: *attempt, permit: *permit, crc32c };
                frame::encode_head(&pixels, planes.iter().map(|plane| plane.len()).sum(), head)?;
                Ok(planes)
            }
        }
    }
}

#[cfg(test)]
#[path = "state_tests.rs"]
mod tests;
