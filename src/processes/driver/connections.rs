//! The connections of a live process: a task that reads and one that writes for each, so that no peer holds up another.

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use bytes::Buf;
use tokio::sync::mpsc::{self, error::TrySendError};
use tokio::task::AbortHandle;
use tokio::time::sleep;

use super::{CONNECT_DEADLINE, ConnectionId, Event, Incoming, Loss, Machine, Outgoing, UNREAD_MAX};
use crate::protocol::connection::{
    Connection, ConnectionError, Fault, FrameReceiver, FrameSender, Introduction, connect,
};
use crate::protocol::hello::Role;

/// What comes of connections.
pub(super) enum Happening<M: Machine> {
    Event(Event<M>),
    Dialled(ConnectionId, Role, Result<Connection, ConnectionError>),
    /// All that was sent before the connection was closed has left.
    Flushed(ConnectionId),
}

pub(super) struct Connections<M: Machine> {
    introduction: Introduction,
    stages: HashMap<ConnectionId, Stage<M>>,
    happenings: mpsc::Sender<Happening<M>>,
    /// Both directions of all, since the handshakes.
    wire_bytes: Arc<AtomicU64>,
}

enum Stage<M: Machine> {
    Dialling(AbortHandle),
    Open { peer: Arc<str>, queue: mpsc::Sender<M::Outgoing>, reader: AbortHandle },
}

impl<M: Machine + 'static> Connections<M>
where
    M::Command: Send,
    M::Answer: Send,
{
    pub(super) fn new(introduction: Introduction, wire_bytes: Arc<AtomicU64>) -> (Self, mpsc::Receiver<Happening<M>>) {
        let (happenings, receiver) = mpsc::channel(M::WAITING_MAX);
        (Self { introduction, stages: HashMap::new(), happenings, wire_bytes }, receiver)
    }

    /// The event that a happening is to the state; `None` if it concerns a connection that the state has closed.
    pub(super) fn event(&mut self, state: &M, happening: Happening<M>) -> Option<Event<M>> {
        match happening {
            Happening::Event(Event::Received(id, _)) if !self.stages.contains_key(&id) => None,
            Happening::Event(Event::Closed(id, loss)) => {
                self.stages.remove(&id)?;
                Some(Event::Closed(id, loss))
            }
            Happening::Event(event) => Some(event),
            Happening::Flushed(id) => Some(Event::Closed(id, None)),
            Happening::Dialled(id, role, outcome) => {
                self.stages.remove(&id)?;
                Some(match outcome {
                    Ok(connection) => {
                        self.open(state, id, role, connection);
                        Event::Dialled(id)
                    }
                    Err(error) => Event::Closed(id, Some(loss(&error))),
                })
            }
        }
    }

    pub(super) fn open(&mut self, state: &M, id: ConnectionId, peer: Role, connection: Connection) {
        let name = Arc::clone(connection.peer());
        let (sender, receiver) = connection.split_frames(state.frame_bytes_max(peer));
        let (queue, messages) = mpsc::channel(UNREAD_MAX);
        tokio::spawn(write(id, sender, messages, self.happenings.clone(), Arc::clone(&self.wire_bytes)));
        let reader = read(id, peer, receiver, self.happenings.clone(), Arc::clone(&self.wire_bytes));
        self.stages.insert(id, Stage::Open { peer: name, queue, reader: tokio::spawn(reader).abort_handle() });
    }

    pub(super) fn dial(&mut self, id: ConnectionId, role: Role, address: std::net::SocketAddr, pause: Duration) {
        let (introduction, happenings) = (self.introduction.clone(), self.happenings.clone());
        let dialling = tokio::spawn(async move {
            sleep(pause).await;
            let outcome = connect(role, address, &introduction, CONNECT_DEADLINE).await;
            // An error means that the process has ended, here as below.
            let _ = happenings.send(Happening::Dialled(id, role, outcome)).await;
        });
        self.stages.insert(id, Stage::Dialling(dialling.abort_handle()));
    }

    /// Does not wait. A peer that does not read is dropped, and no other.
    pub(super) fn send(&mut self, to: ConnectionId, message: M::Outgoing) -> Option<Event<M>> {
        let Some(Stage::Open { peer, queue, .. }) = self.stages.get(&to) else { return None };
        match queue.try_send(message) {
            // How it failed is told by the task that writes.
            Ok(()) | Err(TrySendError::Closed(_)) => None,
            Err(TrySendError::Full(_)) => {
                let error = ConnectionError { peer: Arc::clone(peer), fault: Fault::Unread { messages: UNREAD_MAX } };
                self.stages.remove(&to);
                Some(Event::Closed(to, Some(loss(&error))))
            }
        }
    }

    pub(super) fn close(&mut self, id: ConnectionId) {
        self.stages.remove(&id);
    }
}

/// Nothing more is read; what was sent is still written.
impl<M: Machine> Drop for Stage<M> {
    fn drop(&mut self) {
        match self {
            Self::Dialling(task) | Self::Open { reader: task, .. } => task.abort(),
        }
    }
}

fn loss(error: &ConnectionError) -> Loss {
    Loss { why: error.to_string(), is_breach: matches!(error.fault, Fault::Frame(_) | Fault::Unread { .. }) }
}

/// What a peer says until its connection ends.
async fn read<M: Machine>(
    id: ConnectionId,
    peer: Role,
    mut receiver: FrameReceiver,
    happenings: mpsc::Sender<Happening<M>>,
    wire_bytes: Arc<AtomicU64>,
) {
    let end = loop {
        let before = receiver.wire_bytes();
        let decoded = match receiver.receive().await {
            Ok(Some(frame)) => M::Incoming::decode(peer, frame).map_err(|error| receiver.error(error)),
            Ok(None) => break None,
            Err(error) => Err(error),
        };
        wire_bytes.fetch_add(receiver.wire_bytes() - before, Ordering::Relaxed);
        match decoded {
            Ok(message) => {
                if happenings.send(Happening::Event(Event::Received(id, message))).await.is_err() {
                    return;
                }
            }
            Err(error) => break Some(loss(&error)),
        }
    };
    let _ = happenings.send(Happening::Event(Event::Closed(id, end))).await;
}

/// Writes what is sent until the queue is closed, or the peer is gone.
async fn write<M: Machine>(
    id: ConnectionId,
    mut sender: FrameSender,
    mut messages: mpsc::Receiver<M::Outgoing>,
    happenings: mpsc::Sender<Happening<M>>,
    wire_bytes: Arc<AtomicU64>,
) {
    let mut head = Vec::new();
    while let Some(message) = messages.recv().await {
        head.clear();
        let before = sender.wire_bytes();
        let written = match message.frame(&mut head) {
            Ok([a, b, c, d]) => sender.send(head.as_slice().chain(a).chain(b).chain(c).chain(d)).await,
            Err(error) => Err(sender.error(error)),
        };
        wire_bytes.fetch_add(sender.wire_bytes() - before, Ordering::Relaxed);
        if let Err(error) = written {
            let _ = happenings.send(Happening::Event(Event::Closed(id, Some(loss(&error))))).await;
            return;
        }
    }
    sender.finish().await;
    let _ = happenings.send(Happening::Flushed(id)).await;
}
