//! The manager's port: one control connection a process, each with a task that writes and one that reads.

use std::collections::{HashMap, HashSet};
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::mpsc;
use tokio::time::timeout;

use super::event::Event;
use super::launch::slots::JoinSlots;
use super::process::{Command, ProcessId, Report};
use crate::protocol::connection::{Connection, ConnectionError, Credentials, Fault, Listener, Peer, Receiver, Sender};
use crate::protocol::control::{self, BusCommand, DisplayCommand, MasterCommand, NodeCommand};
use crate::protocol::frame::Message;
use crate::protocol::hello::Role;
use crate::topology::Placement;
use ground::ids::Epoch;

/// Commands that were not written yet. A process that reads has a few at most.
const COMMANDS_MAX: usize = 256;

pub(super) struct ControlPort {
    listener: Listener,
    connections: Connections,
    slots: JoinSlots,
    /// Between two signs of life.
    heartbeat: Duration,
    events: mpsc::Sender<Event>,
}

/// Who may connect, and who has. Cheap to clone; all clones are one.
#[derive(Clone, Default)]
pub(super) struct Connections(Arc<Mutex<Known>>);

#[derive(Default)]
struct Known {
    /// Spawned and not connected yet: each has one connection.
    expected: HashSet<ProcessId>,
    queues: HashMap<ProcessId, (Queue, IpAddr)>,
}

/// Commands on their way to a writing task; the connection ends with it.
enum Queue {
    Bus(mpsc::Sender<BusCommand>),
    Master(mpsc::Sender<MasterCommand>),
    Node(mpsc::Sender<NodeCommand>),
    Display(mpsc::Sender<DisplayCommand>),
}

impl ControlPort {
    /// What processes report goes to `events`; who joins, where that is allowed, is led to the `slots`.
    ///
    /// # Errors
    /// The address cannot be bound.
    pub(super) async fn bind(
        address: SocketAddr,
        credentials: Credentials,
        placement: &Placement,
        heartbeat: Duration,
        events: mpsc::Sender<Event>,
    ) -> io::Result<Self> {
        let (connections, joinable) = (Connections::default(), placement.has_joiners());
        let known = connections.clone();
        let admits = move |role, epoch| match epoch {
            Epoch::JOINING if joinable && role != Role::Manager => Ok(()),
            _ if known.lock().expected.remove(&ProcessId { role, epoch }) => Ok(()),
            _ => Err("a process of this run that has just been started".to_owned()),
        };
        let listener = Listener::bind_to(address, credentials, admits).await?;
        Ok(Self { listener, connections, slots: JoinSlots::new(), heartbeat, events })
    }

    pub(super) fn connections(&self) -> Connections {
        self.connections.clone()
    }

    pub(super) fn slots(&self) -> JoinSlots {
        self.slots.clone()
    }

    pub(super) fn address(&self) -> SocketAddr {
        self.listener.address()
    }

    /// From now on this process may connect, once.
    pub(super) fn expect(&self, id: ProcessId) {
        self.connections.lock().expected.insert(id);
    }

    /// The next process that connected, or the next peer that was refused. May be cancelled.
    pub(super) async fn arrival(&mut self) -> Event {
        loop {
            match self.listener.arrival().await {
                Ok((peer, connection)) if peer.epoch == Epoch::JOINING => self.slots.welcome(peer.role, connection),
                Ok((peer, connection)) => return self.admit(peer, connection),
                Err(refused) => return Event::Refused(refused.to_string()),
            }
        }
    }

    fn admit(&self, peer: Peer, connection: Connection) -> Event {
        let id = ProcessId { role: peer.role, epoch: peer.epoch };
        let (events, beat) = (self.events.clone(), self.heartbeat);
        let queue = match peer.role {
            Role::Bus(_) => Queue::Bus(converse(id, connection, beat, events, Report::Bus)),
            Role::Master(_) => Queue::Master(converse(id, connection, beat, events, Report::Master)),
            Role::Node(_) => Queue::Node(converse(id, connection, beat, events, Report::Node)),
            Role::Display => Queue::Display(converse(id, connection, beat, events, Report::Display)),
            Role::Manager => return Event::Refused(format!("{peer} is no child of this manager")),
        };
        self.connections.lock().queues.insert(id, (queue, peer.address.ip()));
        Event::Connected(id)
    }

    /// Whether the command is on its way; if not, the process is gone or does not read.
    pub(super) fn tell(&self, id: ProcessId, command: Command) -> bool {
        match (self.connections.lock().queues.get(&id), command) {
            (Some((Queue::Bus(queue), _)), Command::Bus(command)) => queue.try_send(command).is_ok(),
            (Some((Queue::Master(queue), _)), Command::Master(command)) => queue.try_send(command).is_ok(),
            (Some((Queue::Node(queue), _)), Command::Node(command)) => queue.try_send(command).is_ok(),
            (Some((Queue::Display(queue), _)), Command::Display(command)) => queue.try_send(command).is_ok(),
            _ => false,
        }
    }

    /// From where the process has dialled.
    pub(super) fn origin(&self, id: ProcessId) -> Option<IpAddr> {
        self.connections.lock().queues.get(&id).map(|(_, origin)| *origin)
    }

    /// Ends our direction of the connection, after what was told.
    pub(super) fn hang_up(&self, id: ProcessId) {
        self.connections.hang_up(id);
    }
}

impl Connections {
    /// [`ControlPort::hang_up`], or takes the permission to connect.
    pub(super) fn hang_up(&self, id: ProcessId) {
        let mut known = self.lock();
        known.expected.remove(&id);
        known.queues.remove(&id);
    }

    /// A panic of another thread leaves these sets as good as they were.
    fn lock(&self) -> MutexGuard<'_, Known> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn converse<C: control::Command + Sync, R: Message>(
    id: ProcessId,
    connection: Connection,
    heartbeat: Duration,
    events: mpsc::Sender<Event>,
    report: fn(R) -> Report,
) -> mpsc::Sender<C> {
    let (sender, receiver) = connection.split::<C, R>();
    let (queue, commands) = mpsc::channel(COMMANDS_MAX);
    tokio::spawn(write(sender, commands, heartbeat));
    tokio::spawn(read(id, receiver, events, report));
    queue
}

/// Commands, and signs of life in between.
async fn write<C: control::Command + Sync>(
    mut sender: Sender<C>,
    mut commands: mpsc::Receiver<C>,
    heartbeat: Duration,
) {
    loop {
        let command = match timeout(heartbeat, commands.recv()).await {
            Ok(Some(command)) => command,
            Ok(None) => return,
            Err(_) => C::HEARTBEAT,
        };
        if let Err(error) = sender.send(&command).await {
            // The reading task reports that the connection has ended.
            tracing::warn!("{error}");
            return;
        }
    }
}

/// Reports until the connection ends. Errors of sending mean that the manager has ended.
async fn read<R: Message>(
    id: ProcessId,
    mut receiver: Receiver<R>,
    events: mpsc::Sender<Event>,
    report: fn(R) -> Report,
) {
    let nonsense = loop {
        match receiver.receive().await {
            Ok(Some(told)) => {
                if events.send(Event::Report(id, report(told))).await.is_err() {
                    return;
                }
            }
            Ok(None) => break None,
            Err(ConnectionError { fault: Fault::Frame(error), .. }) => break Some(error.to_string()),
            Err(error) => {
                tracing::warn!("{error}");
                break None;
            }
        }
    };
    let _ = events.send(Event::Disconnected(id, nonsense)).await;
}
