//! The master: owns its cluster's job queue, hands tiles to the nodes that ask, tells what became of them.
//!
//! `state` decides; this shell moves messages: commands of the manager, requests of nodes, and the modelled
//! jobs to the bus.

pub(in crate::processes) mod seat;
pub(in crate::processes) mod state;

use std::collections::HashMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::sync::mpsc;
use tokio::task::AbortHandle;
use tokio::time::{MissedTickBehavior, interval};

use self::seat::NodeProcess;
use self::state::{Action, Event, State};
use crate::ids::NodeId;
use crate::machine::totals::MasterTotals;
use crate::processes::bootstrap::live;
use crate::processes::{Child, ControlLink, StartError};
use crate::protocol::connection::{
    Connection, ConnectionError, Fault, Listener, Peer, QueuedSender, Receiver, Sender, connect,
};
use crate::protocol::control::{MasterCommand, MasterConfiguration, MasterReport};
use crate::protocol::hello::Role;
use crate::protocol::memory::{MemoryReply, MemoryRequest};
use crate::protocol::work::{WorkReply, WorkRequest};

/// For the bus to answer the hello.
const BUS_DEADLINE: Duration = Duration::from_secs(5);
/// How often tiles are looked at that may be late.
const TICK: Duration = Duration::from_millis(100);
/// Requests of nodes that were not looked at yet.
const EVENTS_MAX: usize = 1024;
/// Jobs that a node has not read yet. An honest node is handed fewer at a time.
const JOBS_MAX: usize = 64;

#[derive(Debug, thiserror::Error)]
pub enum MasterError {
    #[error(transparent)]
    Start(#[from] StartError),
    #[error("cannot listen: {0}")]
    Listen(#[from] std::io::Error),
    #[error(transparent)]
    Connection(#[from] ConnectionError),
    #[error("the manager is gone")]
    ManagerGone,
    #[error("the manager sent something else than a configuration")]
    NotConfigured,
    #[error("the manager's configuration has {nodes} nodes from node {first} on, expected 1 or more, up to node 65535")]
    NoSuchNodes { first: u16, nodes: u16 },
}

type Link = ControlLink<MasterCommand, MasterReport>;

/// Serves until the manager says that all is done.
///
/// # Errors
/// The manager or the bus cannot be reached, or the manager is gone.
pub fn run(child: &Child) -> Result<(), MasterError> {
    live(child, async {
        let mut link: Link = ControlLink::open(child)?;
        let served = serve(child, &mut link).await;
        if let Err(error) = &served {
            // An error means that the manager is gone.
            let _ = report(&link, MasterReport::Incident(error.to_string())).await;
        }
        link.close();
        served
    })
}

async fn serve(child: &Child, link: &mut Link) -> Result<(), MasterError> {
    let configuration = match link.commands.recv().await {
        Some(MasterCommand::Configure(configuration)) => configuration,
        Some(_) => return Err(MasterError::NotConfigured),
        None => return Err(MasterError::ManagerGone),
    };
    let Role::Master(cluster) = child.bootstrap.role else { return Err(MasterError::NotConfigured) };
    let (NodeId(first), nodes) = (configuration.first_node, configuration.nodes);
    let Some(last) = nodes.checked_sub(1).and_then(|more| first.checked_add(more)) else {
        return Err(MasterError::NoSuchNodes { first, nodes });
    };
    let listener = Listener::bind(child.interface(link.interface), child.credentials(), move |role, _| match role {
        Role::Node(node) if (first..=last).contains(&node.0) => Ok(()),
        _ => Err(format!("one of nodes {first} to {last}")),
    })
    .await?;
    let bus = connect(Role::Bus(cluster), configuration.bus, &child.introduction(), BUS_DEADLINE).await?;
    let address = child.advertised(listener.address(), link.interface).await?;
    report(link, MasterReport::Listening(address)).await?;
    let totals = Shell::new(&configuration, bus).serve(link, listener).await?;
    // The connection to the bus is closed: all modelled messages have left before they are asked for.
    report(link, MasterReport::Finished(totals)).await
}

async fn report(link: &Link, report: MasterReport) -> Result<(), MasterError> {
    link.reports.send(report).await.map_err(|_| MasterError::ManagerGone)
}

/// The state and the connections it acts through.
struct Shell {
    state: State,
    start: Instant,
    /// `None` after a message could not be sent.
    bus: Option<Sender<MemoryRequest>>,
    nodes: HashMap<NodeProcess, NodeConnection>,
    events: mpsc::Receiver<Event>,
    /// For the readers of the nodes' connections.
    event_sender: mpsc::Sender<Event>,
}

struct NodeConnection {
    sender: QueuedSender<WorkReply>,
    reader: AbortHandle,
}

impl Drop for NodeConnection {
    fn drop(&mut self) {
        self.reader.abort();
    }
}

impl Shell {
    fn new(configuration: &MasterConfiguration, bus: Connection) -> Self {
        let (event_sender, events) = mpsc::channel(EVENTS_MAX);
        let (bus, _) = bus.split::<MemoryRequest, MemoryReply>();
        Self {
            state: State::new(configuration),
            start: Instant::now(),
            bus: Some(bus),
            nodes: HashMap::new(),
            events,
            event_sender,
        }
    }

    async fn serve(mut self, link: &mut Link, mut listener: Listener) -> Result<MasterTotals, MasterError> {
        let mut tick = interval(TICK);
        tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            let event = tokio::select! {
                biased;
                command = link.commands.recv() => Event::Command(command.ok_or(MasterError::ManagerGone)?),
                _ = tick.tick() => Event::Tick,
                Some(event) = self.events.recv() => event,
                arrival = listener.arrival() => match arrival {
                    Ok((peer, connection)) => self.admit(peer, connection),
                    Err(error) if error.is_of_this_process() => return Err(MasterError::Connection(error)),
                    Err(refused) => Event::Refused(refused.to_string()),
                },
            };
            if let Event::Disconnected(process) = event {
                self.nodes.remove(&process);
            }
            for action in self.state.handle(self.start.elapsed(), event) {
                match action {
                    Action::Report(told) => report(link, told).await?,
                    Action::Hand { to, tile, attempt, permit } => {
                        self.hand(link, to, WorkReply::Job { tile, attempt, permit }).await?;
                    }
                    Action::Bus(message) => self.tell_bus(link, &message).await?,
                    Action::Dismiss(process) => drop(self.nodes.remove(&process)),
                    Action::End(totals) => return Ok(totals),
                }
            }
        }
    }

    fn admit(&mut self, peer: Peer, connection: Connection) -> Event {
        let Role::Node(node) = peer.role else { return Event::Refused(format!("{peer} is no node")) };
        let process = NodeProcess { node, epoch: peer.epoch };
        let (sender, receiver) = connection.split::<WorkReply, WorkRequest>();
        let sender = sender.queued(JOBS_MAX, Arc::default());
        let reader = tokio::spawn(read(process, receiver, self.event_sender.clone())).abort_handle();
        self.nodes.insert(process, NodeConnection { sender, reader });
        Event::Connected(process)
    }

    /// Does not wait: a node that does not read its jobs is dropped, and no other.
    async fn hand(&mut self, link: &Link, to: NodeProcess, job: WorkReply) -> Result<(), MasterError> {
        let Some(node) = self.nodes.get(&to) else { return Ok(()) };
        match node.sender.send(job) {
            // The manager reports how it ended.
            Ok(()) | Err(ConnectionError { fault: Fault::Closed, .. }) => Ok(()),
            Err(error) => {
                self.nodes.remove(&to);
                report(link, MasterReport::Incident(error.to_string())).await
            }
        }
    }

    async fn tell_bus(&mut self, link: &Link, message: &MemoryRequest) -> Result<(), MasterError> {
        let Some(bus) = &mut self.bus else { return Ok(()) };
        if let Err(error) = bus.send(message).await {
            self.bus = None;
            report(link, MasterReport::Incident(error.to_string())).await?;
        }
        Ok(())
    }
}

/// Requests of a node until its connection ends.
async fn read(process: NodeProcess, mut receiver: Receiver<WorkRequest>, events: mpsc::Sender<Event>) {
    loop {
        let event = match receiver.receive().await {
            Ok(Some(request)) => Event::Request(process, request),
            Ok(None) => break,
            // An error here means that the master has ended, as below.
            Err(error @ ConnectionError { fault: Fault::Frame(_), .. }) => {
                let _ = events.send(Event::Refused(error.to_string())).await;
                break;
            }
            Err(error) => {
                tracing::warn!("{error}");
                break;
            }
        };
        if events.send(event).await.is_err() {
            return;
        }
    }
    let _ = events.send(Event::Disconnected(process)).await;
}
