//! The manager's port: one control connection a process, each with a task that writes and one that reads.

use std::collections::{HashMap, HashSet};
use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::{Arc, Mutex, PoisonError};

use tokio::sync::mpsc;

use super::process::{Command, ProcessId, Report};
use super::state::Event;
use crate::codec::Message;
use crate::protocol::connection::{Connection, ConnectionError, Credentials, Fault, Listener, Peer, Receiver, Sender};
use crate::protocol::control::{BusCommand, DisplayCommand, MasterCommand, NodeCommand};
use crate::protocol::hello::Role;

/// Commands that were not written yet. A process that reads has a few at most.
const COMMANDS_MAX: usize = 256;

pub(super) struct ControlPort {
    listener: Listener,
    /// Spawned and not connected yet: each has one connection.
    expected: Arc<Mutex<HashSet<ProcessId>>>,
    queues: HashMap<ProcessId, Queue>,
    events: mpsc::Sender<Event>,
}

/// Commands on their way to a writing task; the connection ends with it.
enum Queue {
    Bus(mpsc::Sender<BusCommand>),
    Master(mpsc::Sender<MasterCommand>),
    Node(mpsc::Sender<NodeCommand>),
    Display(mpsc::Sender<DisplayCommand>),
}

impl ControlPort {
    /// Listens on the loopback interface. What processes tell goes to `events`.
    ///
    /// # Errors
    /// No port is free.
    pub(super) async fn bind(credentials: Credentials, events: mpsc::Sender<Event>) -> io::Result<Self> {
        let expected = Arc::new(Mutex::new(HashSet::new()));
        let places = Arc::clone(&expected);
        let admits = move |role, epoch| {
            let taken = lock(&places).remove(&ProcessId { role, epoch });
            if taken { Ok(()) } else { Err("a process of this run that has just been started".to_owned()) }
        };
        let listener = Listener::bind(Ipv4Addr::LOCALHOST.into(), credentials, admits).await?;
        Ok(Self { listener, expected, queues: HashMap::new(), events })
    }

    pub(super) fn address(&self) -> SocketAddr {
        self.listener.address()
    }

    /// From now on this process may connect, once.
    pub(super) fn expect(&self, id: ProcessId) {
        lock(&self.expected).insert(id);
    }

    /// The next process that connected, or the next peer that was refused. May be cancelled.
    pub(super) async fn arrival(&mut self) -> Event {
        match self.listener.arrival().await {
            Ok((peer, connection)) => self.admit(peer, connection),
            Err(refused) => Event::Refused(refused.to_string()),
        }
    }

    fn admit(&mut self, peer: Peer, connection: Connection) -> Event {
        let id = ProcessId { role: peer.role, epoch: peer.epoch };
        let events = self.events.clone();
        let queue = match peer.role {
            Role::Bus(_) => Queue::Bus(converse(id, connection, events, Report::Bus)),
            Role::Master(_) => Queue::Master(converse(id, connection, events, Report::Master)),
            Role::Node(_) => Queue::Node(converse(id, connection, events, Report::Node)),
            Role::Display => Queue::Display(converse(id, connection, events, Report::Display)),
            Role::Manager => return Event::Refused(format!("{peer} is no child of this manager")),
        };
        self.queues.insert(id, queue);
        Event::Connected(id)
    }

    /// Whether the command is on its way; if not, the process is gone or does not read.
    pub(super) fn tell(&self, id: ProcessId, command: Command) -> bool {
        match (self.queues.get(&id), command) {
            (Some(Queue::Bus(queue)), Command::Bus(command)) => queue.try_send(command).is_ok(),
            (Some(Queue::Master(queue)), Command::Master(command)) => queue.try_send(command).is_ok(),
            (Some(Queue::Node(queue)), Command::Node(command)) => queue.try_send(command).is_ok(),
            (Some(Queue::Display(queue)), Command::Display(command)) => queue.try_send(command).is_ok(),
            _ => false,
        }
    }

    /// Ends our direction of the connection, after what was told.
    pub(super) fn hang_up(&mut self, id: ProcessId) {
        lock(&self.expected).remove(&id);
        self.queues.remove(&id);
    }
}

/// A panic of another thread leaves a set of ids as good as it was.
fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn converse<C: Message + Sync, R: Message>(
    id: ProcessId,
    connection: Connection,
    events: mpsc::Sender<Event>,
    report: fn(R) -> Report,
) -> mpsc::Sender<C> {
    let (sender, receiver) = connection.split::<C, R>();
    let (queue, commands) = mpsc::channel(COMMANDS_MAX);
    tokio::spawn(write(sender, commands));
    tokio::spawn(read(id, receiver, events, report));
    queue
}

async fn write<C: Message + Sync>(mut sender: Sender<C>, mut commands: mpsc::Receiver<C>) {
    while let Some(command) = commands.recv().await {
        if let Err(error) = sender.send(&command).await {
            // The reading task tells that the connection has ended.
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
