//! A processing node: asks the master for tiles, traces them through its local memory, sends the pixels to
//! the display, and tells the master when they have arrived.

pub mod bus_lines;
mod corruption;
pub mod display_link;
pub mod memory;
mod simulated_memory;
pub mod state;
pub mod tile_memory;
pub mod tracer_thread;
pub mod whole_database;

use std::sync::Arc;
use std::time::Duration;

use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::mpsc;
use tokio::time::{Instant, sleep_until};

pub use bus_lines::BusLines;

use self::corruption::Corruption;
use self::display_link::DisplayLink;
use self::state::{Action, Event, State, Violation};
use self::tracer_thread::{FromTracer, Tracer};
use super::bootstrap::{StartError, live};
use super::{Child, ControlLink};
use crate::ids::ClusterId;
use crate::protocol::connection::{ConnectionError, Receiver, Sender, connect};
use crate::protocol::control::{NodeCommand, NodeConfiguration, NodeReport};
use crate::protocol::hello::Role;
use crate::protocol::work::{WorkReply, WorkRequest};

/// For the master to answer the hello.
const CONNECT_DEADLINE: Duration = Duration::from_secs(5);
/// For the display to acknowledge a tile; for a new one to be there, when the last is not.
const ACKNOWLEDGE_DEADLINE: Duration = Duration::from_secs(30);

/// From being asked to go until it goes, whatever it holds: its tiles are done by others then.
const LEAVE_DEADLINE: Duration = Duration::from_secs(25);

#[derive(Debug, thiserror::Error)]
pub enum NodeError {
    #[error(transparent)]
    Start(#[from] StartError),
    #[error("{0}")]
    System(#[from] std::io::Error),
    #[error(transparent)]
    Connection(#[from] ConnectionError),
    #[error(transparent)]
    Violation(#[from] Violation),
    #[error("tracer: {0}")]
    Tracer(String),
    #[error("the {0} closed the connection")]
    Left(Role),
    #[error("the display refused a tile: {0}")]
    PixelsRefused(String),
    #[error("the display acknowledged nothing for {} s", ACKNOWLEDGE_DEADLINE.as_secs())]
    Unacknowledged,
    #[error("no display for {} s: {why}", ACKNOWLEDGE_DEADLINE.as_secs())]
    NoDisplay { why: String },
    #[error("the manager is gone")]
    Orphaned,
}

/// Works until the manager says that it is over, or SIGTERM that it is to go.
///
/// # Errors
/// Anything that keeps this node from going on; the manager was told.
pub fn run(child: &Child) -> Result<(), NodeError> {
    live(child, async {
        let mut link = ControlLink::open(child)?;
        let outcome = work(child, &mut link).await;
        let report = match &outcome {
            Ok(End::Finished) => NodeReport::Finished,
            Ok(End::Left) => NodeReport::Leaving,
            Err(error) => NodeReport::Failed(error.to_string()),
        };
        // An error means that the manager is gone: the log has the outcome.
        let _ = link.reports.send(report).await;
        link.close();
        outcome.map(drop)
    })
}

/// How a node's work ends well.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum End {
    Finished,
    /// It was asked to go, and holds no tile any more.
    Left,
}

/// Until the manager says that it is over, or a signal that this node is to go.
async fn work(child: &Child, link: &mut ControlLink<NodeCommand, NodeReport>) -> Result<End, NodeError> {
    let mut terminate = signal(SignalKind::terminate())?;
    let configuration = loop {
        tokio::select! {
            command = link.commands.recv() => match command {
                Some(NodeCommand::Configure(configuration)) => break *configuration,
                // The configuration will say which display there is.
                Some(NodeCommand::Heartbeat | NodeCommand::Display(_)) => {}
                // Only a node that works can err.
                Some(NodeCommand::Corrupt) => {}
                Some(NodeCommand::Finish) => return Ok(End::Finished),
                None => return Err(NodeError::Orphaned),
            },
            _ = terminate.recv() => return Ok(End::Left),
        }
    };
    let mut shell = Shell::start(configuration, child, link.reports.clone()).await?;
    let mut leave_by = None;
    loop {
        let event = tokio::select! {
            command = link.commands.recv() => match command {
                Some(NodeCommand::Finish) => return Ok(End::Finished),
                Some(NodeCommand::Heartbeat) => continue,
                Some(NodeCommand::Display(address)) => Event::NewDisplay(address),
                Some(NodeCommand::Corrupt) => {
                    shell.corruption = Some(Corruption::of(child.bootstrap.role));
                    continue;
                }
                Some(NodeCommand::Configure(_)) => {
                    tracing::warn!("configured twice: the second is not heeded");
                    continue;
                }
                None => return Err(NodeError::Orphaned),
            },
            event = shell.event() => event?,
            _ = terminate.recv() => {
                leave_by.get_or_insert_with(|| Instant::now() + LEAVE_DEADLINE);
                Event::Leave
            }
            () = passed(leave_by) => return Ok(End::Left),
        };
        shell.handle(event).await?;
        if shell.state.has_left() {
            return Ok(End::Left);
        }
    }
}

/// Never where there is no such time.
async fn passed(time: Option<Instant>) {
    match time {
        Some(time) => sleep_until(time).await,
        None => std::future::pending().await,
    }
}

/// The sources of events, and what is done about them.
struct Shell {
    cluster: ClusterId,
    state: State,
    tracer: Tracer,
    to_master: Sender<WorkRequest>,
    from_master: Receiver<WorkReply>,
    display: DisplayLink,
    /// To the manager.
    reports: mpsc::Sender<NodeReport>,
    /// When what the display owes is overdue.
    late: Instant,
    /// `Some`: it was told to err.
    corruption: Option<Corruption>,
}

impl Shell {
    async fn start(
        configuration: NodeConfiguration,
        child: &Child,
        reports: mpsc::Sender<NodeReport>,
    ) -> Result<Self, NodeError> {
        let introduction = child.introduction();
        let master =
            connect(Role::Master(configuration.cluster), configuration.master, &introduction, CONNECT_DEADLINE).await?;
        let (to_master, from_master) = master.split();
        let cluster = configuration.cluster;
        let state = State::new(configuration.tiling, configuration.display);
        let display = DisplayLink::dial(configuration.display, introduction.clone());
        let tracer = Tracer::start(configuration, introduction, child.pulse.clone())?;
        let late = Instant::now() + ACKNOWLEDGE_DEADLINE;
        Ok(Self { cluster, state, tracer, to_master, from_master, display, reports, late, corruption: None })
    }

    /// The next thing that happens. May be cancelled without losing one.
    async fn event(&mut self) -> Result<Event, NodeError> {
        let awaits_display = self.state.awaits_display();
        tokio::select! {
            said = self.tracer.said.recv() => match said {
                Some(FromTracer::Ready(packets)) => Ok(Event::TracerReady(packets)),
                Some(FromTracer::Traced(mut traced)) => {
                    if let Some(corruption) = self.corruption {
                        corruption.flip_a_bit(Arc::make_mut(&mut traced.pixels), traced.done.tile);
                    }
                    Ok(Event::Traced(traced))
                }
                Some(FromTracer::Failed(why)) => Err(NodeError::Tracer(why)),
                None => Err(NodeError::Tracer("its thread ended".to_owned())),
            },
            reply = self.from_master.receive() => match reply? {
                Some(WorkReply::Job { tile, attempt, permit }) => Ok(Event::Job { tile, attempt, permit }),
                None => Err(NodeError::Left(Role::Master(self.cluster))),
            },
            event = self.display.event() => event,
            () = sleep_until(self.late), if awaits_display => match self.display.loss() {
                Some(why) => Err(NodeError::NoDisplay { why: why.to_owned() }),
                None => Err(NodeError::Unacknowledged),
            },
        }
    }

    async fn handle(&mut self, event: Event) -> Result<(), NodeError> {
        let progress = matches!(event, Event::Traced(_) | Event::Acknowledged { .. } | Event::NewDisplay(_));
        if progress || !self.state.awaits_display() {
            self.late = Instant::now() + ACKNOWLEDGE_DEADLINE;
        }
        for action in self.state.handle(event)? {
            match action {
                // An error means that the manager is gone: its commands end too.
                Action::TellPackets(packets) => drop(self.reports.send(NodeReport::Packets(packets)).await),
                Action::AskForTile => self.to_master.send(&WorkRequest::Ready).await?,
                Action::TellDone { done, receipt } => {
                    self.to_master.send(&WorkRequest::Done { done, receipt }).await?;
                }
                // There is room: no more tiles are asked for than the queue takes.
                Action::Trace(job) => self.tracer.jobs.try_send(job).map_err(|e| NodeError::Tracer(e.to_string()))?,
                Action::DialDisplay { address, pause } => self.display.redial(address, pause),
                Action::SendPixels { tile, attempt, permit, pixels } => {
                    self.display.send(tile, attempt, permit, &pixels).await;
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
