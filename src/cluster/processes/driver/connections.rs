//! The connections of a live process: a task that reads and one that writes for each, so that no peer holds up another.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use bytes::Buf;
use tokio::sync::mpsc::{self, error::TrySendError};
use tokio::task::AbortHandle;
use tokio::time::{sleep, timeout};

use super::{CONNECT_DEADLINE, ConnectionId, Event, Incoming, Loss, Machine, Outgoing, UNREAD_MAX};
use crate::protocol::connection::{
    Connection, ConnectionError, Fault, FrameReceiver, FrameSender, Introduction, connect,
};
use crate::protocol::hello::Role;

/// For what a process has sent before its end to leave.
const FINISH_DEADLINE: Duration = Duration::from_millis(500);

/// What comes of connections.
pub(super) enum Happening<M: Machine> {
    Event(Event<M>),
    Dialled(ConnectionId, Role, Result<Connection, ConnectionError>),
    /// Nothing more is written: all that was sent has left, or cannot leave.
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

    /// A server that this process has dialled is waited for, as long as its frames can be written. A client that does not read
    /// is dropped instead: it must not hold up another.
    pub(super) async fn send(&mut self, to: ConnectionId, message: M::Outgoing) -> Option<Event<M>> {
        let Some(Stage::Open { peer, queue, .. }) = self.stages.get(&to) else { return None };
        // Where the queue is closed, the task that writes reports why.
        if let ConnectionId::Dialled(_) = to {
            let _ = queue.send(message).await;
            return None;
        }
        match queue.try_send(message) {
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

    /// Closes all, and waits for [`FINISH_DEADLINE`] at most until what was sent has left.
    pub(super) async fn finish(&mut self, happenings: &mut mpsc::Receiver<Happening<M>>) {
        let open = self.stages.drain().filter(|(_, stage)| matches!(stage, Stage::Open { .. }));
        let mut unfinished: HashSet<ConnectionId> = open.map(|(id, _)| id).collect();
        let flushed = async {
            while !unfinished.is_empty()
                && let Some(happening) = happenings.recv().await
            {
                if let Happening::Flushed(id) = happening {
                    unfinished.remove(&id);
                }
            }
        };
        // A peer that does not read is left to itself.
        let _ = timeout(FINISH_DEADLINE, flushed).await;
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
    let (mut waiting, mut frames, mut failure) = (Vec::new(), Vec::new(), None);
    while failure.is_none() && messages.recv_many(&mut waiting, UNREAD_MAX).await > 0 {
        let before = sender.wire_bytes();
        failure = write_all(&mut sender, &waiting, &mut frames).await.err();
        wire_bytes.fetch_add(sender.wire_bytes() - before, Ordering::Relaxed);
        waiting.clear();
    }
    // The loop may wait for room in this queue, and looks at no happening meanwhile.
    drop(messages);
    if let Some(error) = failure {
        let _ = happenings.send(Happening::Event(Event::Closed(id, Some(loss(&error))))).await;
    }
    sender.finish().await;
    // After an error, too: the state may have closed the connection, and wait for this.
    let _ = happenings.send(Happening::Flushed(id)).await;
}

/// Messages that wait at the same time leave together: the peer wakes once for them.
async fn write_all<O: Outgoing>(
    sender: &mut FrameSender,
    messages: &[O],
    frames: &mut Vec<u8>,
) -> Result<(), ConnectionError> {
    frames.clear();
    for message in messages {
        let bulk = message.frame(frames).map_err(|error| sender.error(error))?;
        let [a, b, c, d] = bulk;
        if bulk.iter().any(|piece| !piece.is_empty()) {
            sender.send(frames.as_slice().chain(a).chain(b).chain(c).chain(d)).await?;
            frames.clear();
        }
    }
    if frames.is_empty() { Ok(()) } else { sender.send(frames.as_slice()).await }
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;

    use super::*;
    use crate::processes::master::state::{Outgoing, State};
    use crate::protocol::connection::{Credentials, Listener, Receiver};
    use crate::protocol::hello::RunToken;
    use crate::protocol::mac::Mac;
    use crate::protocol::memory::{MemoryReply, MemoryRequest};
    use crate::protocol::work::WorkReply;
    use ground::ids::{Attempt, ClusterId, Epoch, NodeId, TileId};

    const BUS: ConnectionId = ConnectionId::Dialled(0);
    const NODE: ConnectionId = ConnectionId::Accepted(0);
    const SOON: Duration = Duration::from_secs(10);
    /// What a master hands out at once to 200 nodes.
    const MESSAGES: u32 = 800;

    fn job(tile: u32) -> Outgoing {
        Outgoing::Memory(MemoryRequest::Job { node: NodeId(0), tile: TileId(tile), attempt: Attempt(0), bytes: 1 })
    }

    /// A master's connections, one of them to a bus or a node that the test plays.
    async fn connected(id: ConnectionId) -> (Connections<State>, mpsc::Receiver<Happening<State>>, Connection) {
        let credentials = Credentials::plain(RunToken::new([1; 32]));
        let mut listener =
            Listener::bind(Ipv4Addr::LOCALHOST.into(), credentials.clone(), |_, _| Ok(())).await.expect("loopback");
        let introduction = credentials.introduction(Role::Master(ClusterId(0)), Epoch(0));
        let bus = Role::Bus(ClusterId(0));
        let connection = connect(bus, listener.address(), &introduction, SOON).await.expect("welcome");
        let (_, other_end) = listener.arrival().await.expect("the master");
        let (mut connections, happenings) = Connections::new(introduction, Arc::default());
        connections.open(&State::new(ClusterId(0)), id, bus, connection);
        (connections, happenings, other_end)
    }

    #[tokio::test]
    async fn a_server_gets_all_that_is_sent_at_once_and_then_the_end() {
        let (mut connections, mut happenings, bus) = connected(BUS).await;
        let reading = tokio::spawn(async move {
            let (_sender, mut receiver): (_, Receiver<MemoryRequest>) = bus.split::<MemoryReply, MemoryRequest>();
            let mut tiles = Vec::new();
            while let Some(request) = receiver.receive_within(SOON).await.expect("whole frames") {
                let MemoryRequest::Job { tile, .. } = request else { panic!("a job") };
                tiles.push(tile.0);
            }
            tiles
        });
        for tile in 0..MESSAGES {
            assert!(connections.send(BUS, job(tile)).await.is_none(), "tile {tile}");
        }
        connections.close(BUS);
        assert_eq!(reading.await.expect("no panic"), Vec::from_iter(0..MESSAGES));
        assert!(matches!(happenings.recv().await, Some(Happening::Flushed(BUS))));
    }

    #[tokio::test]
    async fn what_was_sent_before_the_end_leaves_and_a_peer_that_does_not_read_delays_it_for_a_moment() {
        let (mut connections, mut happenings, bus) = connected(BUS).await;
        let (_sender, mut receiver): (_, Receiver<MemoryRequest>) = bus.split::<MemoryReply, MemoryRequest>();
        assert!(connections.send(BUS, job(7)).await.is_none());
        connections.finish(&mut happenings).await;
        let received = receiver.receive_within(SOON).await.expect("whole frames");
        assert!(matches!(received, Some(MemoryRequest::Job { tile: TileId(7), .. })));
        assert!(receiver.receive_within(SOON).await.expect("no more frames").is_none());
        // Another one fills what the system takes for a peer that does not read.
        let (mut connections, mut happenings, _bus) = connected(BUS).await;
        let fill = async {
            for tile in 0.. {
                connections.send(BUS, job(tile)).await;
            }
        };
        assert!(timeout(Duration::from_millis(300), fill).await.is_err());
        timeout(SOON, connections.finish(&mut happenings)).await.expect("an end");
    }

    #[tokio::test]
    async fn a_server_that_is_gone_holds_nothing_up_and_its_connection_comes_to_an_end() {
        let (mut connections, mut happenings, bus) = connected(BUS).await;
        drop(bus);
        for tile in 0..MESSAGES {
            connections.send(BUS, job(tile)).await;
        }
        connections.close(BUS);
        let flushed = async { while !matches!(happenings.recv().await, Some(Happening::Flushed(BUS)) | None) {} };
        tokio::time::timeout(SOON, flushed).await.expect("an end, whatever was lost");
    }

    #[tokio::test]
    async fn a_client_that_does_not_read_is_dropped() {
        let (mut connections, _happenings, _node) = connected(NODE).await;
        let hand = || Outgoing::Work(WorkReply::Job { tile: TileId(0), attempt: Attempt(0), permit: Mac::default() });
        let mut sent = 0;
        // Nothing is written as long as nothing is awaited.
        let loss = loop {
            match connections.send(NODE, hand()).await {
                None => sent += 1,
                Some(Event::Closed(NODE, Some(loss))) => break loss,
                Some(_) => panic!("closed, if anything"),
            }
        };
        assert_eq!(sent, UNREAD_MAX);
        assert!(loss.is_breach && loss.why.ends_with("did not read 64 messages"), "{}", loss.why);
        assert!(connections.send(NODE, hand()).await.is_none(), "it is gone");
    }
}
