//! The display: puts tiles together, acknowledges them, writes the image.
//!
//! `state` decides; this shell moves pixels from the nodes to it and to the journal, and the frame to files.

pub mod state;

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use bytes::BytesMut;
use tokio::sync::mpsc;
use tokio::task::AbortHandle;

use self::state::{Action, ConnectionId, Event, Finished, Source, State};
use crate::ids::RunId;
use crate::journal::{Journal, JournalError, Subject};
use crate::processes::bootstrap::live;
use crate::processes::event_queue::aside;
use crate::processes::{Child, ControlLink, StartError};
use crate::protocol::connection::{Connection, ConnectionError, Fault, Listener, Peer, QueuedSender, Receiver};
use crate::protocol::control::{DisplayCommand, DisplayConfiguration, DisplayReport, DisplayTotals};
use crate::protocol::hello::Role;
use crate::protocol::image::{ImageReply, TilePixels};
use crate::pulse::Pulse;

/// Tiles received and not composited yet, of all nodes.
const TILES_MAX: usize = 16;
/// Replies that a node has not read yet. An honest node has fewer tiles on their way.
const REPLIES_MAX: usize = 64;

#[derive(Debug, thiserror::Error)]
pub enum DisplayError {
    #[error(transparent)]
    Start(#[from] StartError),
    #[error("cannot listen: {0}")]
    Listen(#[from] std::io::Error),
    #[error(transparent)]
    Port(ConnectionError),
    #[error("the manager is gone")]
    ManagerGone,
    #[error("the manager sent something else than a configuration")]
    NotConfigured,
    #[error(transparent)]
    Journal(#[from] JournalError),
    /// The manager knows.
    #[error("{0}")]
    Failed(String),
}

type Link = ControlLink<DisplayCommand, DisplayReport>;

/// Serves until the manager asks for the image, and writes what there is.
///
/// # Errors
/// The manager is gone, there is no memory for the image, or image or journal cannot be written.
pub fn run(child: &Child) -> Result<(), DisplayError> {
    live(child, async {
        let mut link: Link = ControlLink::open(child)?;
        let served = serve(&mut link, child).await;
        let last = match &served {
            Ok(totals) => DisplayReport::Finished(totals.clone()),
            Err(error) => DisplayReport::Failed(error.to_string()),
        };
        // Where the manager is gone nobody is left to be told.
        let _ = report(&link, last).await;
        link.close();
        served.map(drop)
    })
}

async fn serve(link: &mut Link, child: &Child) -> Result<DisplayTotals, DisplayError> {
    let configuration = match link.commands.recv().await {
        Some(DisplayCommand::Configure(configuration)) => configuration,
        Some(_) => return Err(DisplayError::NotConfigured),
        None => return Err(DisplayError::ManagerGone),
    };
    let (state, journal) = restore(link, &configuration, child.bootstrap.token.run_id()).await?;
    let listener = Listener::bind(child.interface(link.interface), child.credentials(), |role, _| match role {
        Role::Node(_) => Ok(()),
        _ => Err("a node".to_owned()),
    })
    .await?;
    let address = child.advertised(listener.address(), link.interface).await?;
    report(link, DisplayReport::Listening(address)).await?;
    Shell::new(state, journal, child.pulse.clone()).serve(link, listener, configuration).await
}

/// Begins where the journal ends, and says so. Blocks: nobody is served yet.
async fn restore(
    link: &Link,
    configuration: &DisplayConfiguration,
    run: RunId,
) -> Result<(State, Journal), DisplayError> {
    let mut state = State::new(configuration, run).map_err(|error| DisplayError::Failed(error.to_string()))?;
    let DisplayConfiguration { tiling, aov, fingerprint, ref journal, resume, .. } = *configuration;
    let subject = Subject { tiling, aov, fingerprint };
    let (journal, dropped) = Journal::open(journal, &subject, resume, |record| state.restore(record))?;
    if let Some(dropped) = dropped {
        tracing::warn!("{dropped}");
        report(link, DisplayReport::Incident(dropped)).await?;
    }
    report(link, DisplayReport::Restored(state.holdings())).await?;
    Ok((state, journal))
}

async fn report(link: &Link, report: DisplayReport) -> Result<(), DisplayError> {
    link.reports.send(report).await.map_err(|_| DisplayError::ManagerGone)
}

/// The state and the connections it acts through.
struct Shell {
    state: State,
    journal: Journal,
    pulse: Pulse,
    nodes: HashMap<ConnectionId, NodeConnection>,
    connections: u64,
    arrived: mpsc::Receiver<Arrived>,
    /// For the readers of the nodes' connections.
    arrived_sender: mpsc::Sender<Arrived>,
    /// Both directions, since the handshakes.
    wire_bytes: Arc<AtomicU64>,
}

struct NodeConnection {
    source: Source,
    sender: QueuedSender<ImageReply>,
    reader: AbortHandle,
}

impl Drop for NodeConnection {
    fn drop(&mut self) {
        self.reader.abort();
    }
}

/// What a node's connection brought.
enum Arrived {
    Tile { from: ConnectionId, tile: TilePixels, bytes: BytesMut, wire_bytes: u64 },
    Nonsense(String),
    End(ConnectionId),
}

impl Shell {
    fn new(state: State, journal: Journal, pulse: Pulse) -> Self {
        let (arrived_sender, arrived) = mpsc::channel(TILES_MAX);
        Self {
            state,
            journal,
            pulse,
            nodes: HashMap::new(),
            connections: 0,
            arrived,
            arrived_sender,
            wire_bytes: Arc::default(),
        }
    }

    async fn serve(
        mut self,
        link: &mut Link,
        mut listener: Listener,
        configuration: DisplayConfiguration,
    ) -> Result<DisplayTotals, DisplayError> {
        loop {
            tokio::select! {
                biased;
                command = link.commands.recv() => match command {
                    Some(DisplayCommand::Finish) => return self.write(configuration).await,
                    Some(DisplayCommand::Condemn(producer)) => self.handle(link, Event::Condemn(producer)).await?,
                    Some(DisplayCommand::TellHoldings { question }) => {
                        self.handle(link, Event::TellHoldings { question }).await?;
                    }
                    Some(DisplayCommand::Configure(_)) => {
                        self.handle(link, Event::Refused("configured twice; the first one counts".to_owned())).await?;
                    }
                    Some(DisplayCommand::Heartbeat) => {}
                    None => return Err(DisplayError::ManagerGone),
                },
                Some(arrived) = self.arrived.recv() => match arrived {
                    Arrived::Tile { from, tile, bytes, wire_bytes } => {
                        self.wire_bytes.fetch_add(wire_bytes, Ordering::Relaxed);
                        // Nobody is there any more who was dismissed.
                        if let Some(&NodeConnection { source, .. }) = self.nodes.get(&from) {
                            self.handle(link, Event::Tile { from, source, tile, bytes: &bytes }).await?;
                        }
                    }
                    Arrived::Nonsense(what) => self.handle(link, Event::Refused(what)).await?,
                    Arrived::End(node) => drop(self.nodes.remove(&node)),
                },
                arrival = listener.arrival() => match arrival {
                    Ok((peer, connection)) => self.admit(&peer, connection),
                    Err(error) if error.is_of_this_process() => return Err(DisplayError::Port(error)),
                    Err(refused) => self.handle(link, Event::Refused(refused.to_string())).await?,
                },
            }
        }
    }

    fn admit(&mut self, peer: &Peer, connection: Connection) {
        // Nobody else is let in.
        let Role::Node(node) = peer.role else { return };
        let id = ConnectionId(self.connections);
        self.connections += 1;
        let (sender, receiver) = connection.split::<ImageReply, TilePixels>();
        let receiver = receiver.with_bulk_bytes_max(self.state.tile_bytes_max());
        let sender = sender.queued(REPLIES_MAX, Arc::clone(&self.wire_bytes));
        let reader = tokio::spawn(read(id, receiver, self.arrived_sender.clone())).abort_handle();
        self.nodes.insert(id, NodeConnection { source: (node, peer.epoch), sender, reader });
    }

    async fn handle(&mut self, link: &Link, event: Event<'_>) -> Result<(), DisplayError> {
        for action in self.state.handle(event) {
            match action {
                Action::Append(record) => self.journal.append(&record)?,
                Action::Reply(to, reply) => self.reply(link, to, reply).await?,
                Action::Dismiss(node) => drop(self.nodes.remove(&node)),
                Action::Report(told) => report(link, told).await?,
            }
        }
        Ok(())
    }

    /// Does not wait: a node that does not read its replies is dropped, and no other.
    async fn reply(&mut self, link: &Link, to: ConnectionId, reply: ImageReply) -> Result<(), DisplayError> {
        let Some(node) = self.nodes.get(&to) else { return Ok(()) };
        match node.sender.send(reply) {
            Ok(()) => Ok(()),
            Err(error) => {
                self.nodes.remove(&to);
                match error.fault {
                    // The node is gone: the manager knows how.
                    Fault::Closed => Ok(()),
                    _ => report(link, DisplayReport::Incident(error.to_string())).await,
                }
            }
        }
    }

    /// Writes whatever tiles there are, in a thread of its own: a large image takes seconds.
    async fn write(self, configuration: DisplayConfiguration) -> Result<DisplayTotals, DisplayError> {
        let Self { state, journal, pulse, wire_bytes, .. } = self;
        let wire_bytes = wire_bytes.load(Ordering::Relaxed);
        let written = aside(&pulse, "image", move || {
            // Locked until the image stands.
            let _journal = journal;
            let Finished { frame, tiles_done, tiles_stale } = state.finish();
            // Before the hash: when a run is interrupted, time is short.
            let written = frame.write(&configuration.image, configuration.exr)?;
            std::io::Result::Ok(DisplayTotals { sha256: frame.sha256(), tiles_done, tiles_stale, wire_bytes, written })
        });
        let failed = |error: &dyn std::fmt::Display| DisplayError::Failed(format!("cannot write the image: {error}"));
        written.await.flatten().map_err(|error| failed(&error))
    }
}

/// Tiles of a node until its connection ends.
async fn read(from: ConnectionId, mut receiver: Receiver<TilePixels>, arrived: mpsc::Sender<Arrived>) {
    loop {
        let before = receiver.wire_bytes();
        let received = match receiver.receive_with_bulk().await {
            Ok(Some((tile, bytes))) => Arrived::Tile { from, tile, bytes, wire_bytes: receiver.wire_bytes() - before },
            Ok(None) => break,
            // An error here means that the display has ended, as below.
            Err(error @ ConnectionError { fault: Fault::Frame(_), .. }) => {
                let _ = arrived.send(Arrived::Nonsense(error.to_string())).await;
                break;
            }
            Err(error) => {
                tracing::warn!("{error}");
                break;
            }
        };
        if arrived.send(received).await.is_err() {
            return;
        }
    }
    let _ = arrived.send(Arrived::End(from)).await;
}

#[cfg(test)]
mod state_tests;
#[cfg(test)]
mod tests;
