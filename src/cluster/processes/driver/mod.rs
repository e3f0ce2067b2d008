//! How a process lives: a state decides, a driver does.
//!
//! Every process that the manager starts is a [`Machine`]: it takes an [`Event`], and answers with [`Action`]s. It has no
//! socket, no file, no thread and no clock. Two drivers exist: [`live`], with real ones, and the simulation, where network and
//! time are numbers. What is neither a connection nor time (tracing, files, the loop of the bus) is a task of the driver's
//! [`Worker`](live::Worker).

mod connections;
pub mod live;

use std::net::SocketAddr;
use std::time::Duration;

use bytes::BytesMut;

use crate::protocol::control;
use crate::protocol::frame::CodecError;
use crate::protocol::hello::Role;
use ground::ids::{Epoch, NodeId};

/// For a peer that is dialled to answer the hello.
pub const CONNECT_DEADLINE: Duration = Duration::from_secs(5);
/// Messages that a client has not read yet. An honest one has fewer on their way to it.
pub const UNREAD_MAX: usize = 64;

/// The state of a process, from its first command to its end.
pub trait Machine: Sized {
    /// From the manager, and to it.
    type Command: control::Command;
    type Report: control::Report;
    /// From peers, and to them.
    type Incoming: Incoming;
    type Outgoing: Outgoing;
    /// For the worker, and from it.
    type Task;
    type Answer;

    /// Messages of peers that wait for this state; their senders wait then.
    const WAITING_MAX: usize;
    /// Whether SIGTERM is [`Event::Terminate`]; if not, it ends the process.
    const LEAVES: bool = false;
    /// The last report of a process that fails, of the reason.
    const FAILED: fn(String) -> Self::Report;

    /// What is to be done about an event, in order. `now` is the time since any fixed moment.
    fn handle(&mut self, now: Duration, event: Event<Self>) -> Vec<Action<Self>> {
        let mut actions = Vec::new();
        if let Err(end) = self.step(now, event, &mut actions) {
            self.be_over();
            let (report, outcome) = match end {
                End::Done(report) => (report, Ok(())),
                End::Failed(why) => (Self::FAILED(why.clone()), Err(why)),
            };
            actions.extend([Action::Report(report), Action::End(outcome)]);
        }
        actions
    }

    /// As [`Self::handle`], without the end.
    ///
    /// # Errors
    /// The process is to end, after these actions.
    fn step(&mut self, now: Duration, event: Event<Self>, actions: &mut Vec<Action<Self>>) -> Result<(), End<Self>>;

    /// Nothing more is done about any event.
    fn be_over(&mut self);

    /// When [`Event::Deadline`] is due if nothing happens before.
    fn next_deadline(&self) -> Option<Duration>;

    /// Most bytes that a frame of this peer may have.
    fn frame_bytes_max(&self, peer: Role) -> usize;
}

/// A message as it comes, of the kind that this peer sends.
pub trait Incoming: Sized + Send + 'static {
    /// # Errors
    /// The frame holds something else.
    fn decode(peer: Role, frame: BytesMut) -> Result<Self, CodecError>;
}

/// A message as it goes.
pub trait Outgoing: Send + Sync + 'static {
    /// Appends the head of the frame; the bulk bytes that follow it, in pieces, are not copied.
    ///
    /// # Errors
    /// The message is longer than its kind may be.
    fn frame(&self, head: &mut Vec<u8>) -> Result<[&[u8]; 4], CodecError>;
}

/// A connection of a process.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum ConnectionId {
    /// The state's number for one that it dials; never used twice.
    Dialled(u32),
    /// The driver's, as they come.
    Accepted(u64),
}

/// The process at the other end.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct PeerId {
    pub role: Role,
    pub epoch: Epoch,
}

/// Why a connection ended that the peer did not close between two messages.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Loss {
    /// With the peer's name and address.
    pub why: String,
    /// The peer is at fault: it sent what is no message, or did not read.
    pub is_breach: bool,
}

pub enum Event<M: Machine> {
    /// Of the manager. Heartbeats are not among them.
    Command(M::Command),
    /// The process is asked to go.
    Terminate,
    /// Where others reach this process.
    Listening(SocketAddr),
    /// A peer has come that may.
    Accepted(ConnectionId, PeerId),
    /// Another was not let in; why.
    Refused(String),
    /// The peer has answered.
    Dialled(ConnectionId),
    Received(ConnectionId, M::Incoming),
    /// The connection has ended, or could not be made. After [`Action::Close`]: all that was sent has left, or cannot leave. May
    /// come more than once.
    Closed(ConnectionId, Option<Loss>),
    Answer(M::Answer),
    /// A task could not be done, or the port is of no use; nor was done what the state answered after it.
    Failed(String),
    /// See [`Machine::next_deadline`].
    Deadline,
}

pub enum Action<M: Machine> {
    Report(M::Report),
    /// [`Event::Listening`] is the answer.
    Listen(Admission),
    /// [`Event::Dialled`] or [`Event::Closed`] is the answer, within [`CONNECT_DEADLINE`] after the pause.
    Dial {
        id: ConnectionId,
        role: Role,
        address: SocketAddr,
        pause: Duration,
    },
    /// Without a connection of this number nothing is sent. A client that does not read is dropped; a server is waited for.
    Send(ConnectionId, M::Outgoing),
    Close(ConnectionId),
    Task(M::Task),
    /// The process ends, after all that was reported, and after all that was sent, for half a second at most; why, if it is an
    /// error.
    End(Result<(), String>),
}

/// How a process ends.
pub enum End<M: Machine> {
    /// As it was asked to, with its last report.
    Done(M::Report),
    Failed(String),
}

impl<M: Machine, E: ToString> From<E> for End<M> {
    fn from(error: E) -> Self {
        Self::Failed(error.to_string())
    }
}

/// Which roles a port lets in.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Admission {
    Nodes {
        first: NodeId,
        last: NodeId,
    },
    AnyNode,
    /// Those that have a place on a bus.
    BusClients,
}

impl Admission {
    /// # Errors
    /// What was expected instead.
    pub fn check(self, role: Role) -> Result<(), String> {
        match (self, role) {
            (Self::Nodes { first, last }, Role::Node(node)) if (first..=last).contains(&node) => Ok(()),
            (Self::AnyNode, Role::Node(_)) => Ok(()),
            (Self::BusClients, Role::Manager | Role::Master(_) | Role::Node(_)) => Ok(()),
            (Self::Nodes { first, last }, _) => Err(format!("one of nodes {} to {}", first.0, last.0)),
            (Self::AnyNode, _) => Err("a node".to_owned()),
            (Self::BusClients, _) => Err("the manager, the master or a node".to_owned()),
        }
    }
}
