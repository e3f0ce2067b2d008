//! The loop that owns all memory sockets: reads what is ready, grants in the arbiter's order, replies.
//!
//! One thread from a request's arrival to its reply, so that no hand-off costs time on the way.

use std::io;
use std::sync::Arc;
use std::time::{Duration, Instant};

use crossbeam_channel as channel;
use mio::{Events, Interest, Poll, Token, Waker};
use tokio::sync::{mpsc, oneshot};

use super::client::Client;
use super::state::{Refusal, State, initiator};
use crate::protocol::connection::{Fault, Peer, Socket};
use crate::protocol::frame;
use crate::protocol::memory::MemoryReply;
use ground::pulse::Beacon;
use machine::hardware::totals::{BusTotals, LostAttempt};
use machine::hardware::transaction::Initiator;
use machine::recording::{RecordingError, Writer};

const WAKE: Token = Token(usize::MAX);
const EVENTS_MAX: usize = 512;
const COMMANDS_MAX: usize = 64;
/// Rounds between two looks at the sockets: a client that never stops asking must not keep the others from being heard.
const ROUNDS_MAX: u32 = 256;
/// How often to look at what no event reports, while there is such.
const LOOK_PERIOD: Duration = Duration::from_millis(200);

/// For the master and the nodes to leave once the end was announced.
pub const LEAVE_DEADLINE: Duration = Duration::from_millis(500);

/// From the process to its loop.
#[derive(Debug)]
pub enum Command {
    /// A peer whose hello was accepted. It takes the place of its predecessor.
    Admit(Peer, Socket<std::net::TcpStream>),
    /// Serve what comes until all but the loader have left, half a second at most, then end.
    Finish { lost: Vec<LostAttempt> },
}

/// What ends a bus.
#[derive(Debug, thiserror::Error)]
pub enum LoopError {
    #[error("cannot wait for sockets: {0}")]
    Poll(#[from] io::Error),
    #[error(transparent)]
    Recording(#[from] RecordingError),
}

/// The other end of a loop; the loop ends when it is dropped.
#[derive(Debug)]
pub struct Handle {
    commands: channel::Sender<Command>,
    waker: Arc<Waker>,
}

impl Handle {
    /// # Errors
    /// The loop has ended, or takes no commands.
    pub fn send(&self, command: Command) -> io::Result<()> {
        let refused = |error: channel::TrySendError<Command>| io::Error::other(error.to_string());
        self.commands.try_send(command).map_err(refused)?;
        self.waker.wake()
    }
}

impl Drop for Handle {
    fn drop(&mut self) {
        // The loop sees that there is no sender any more, but only once it wakes.
        let (nobody, _) = channel::bounded(0);
        self.commands = nobody;
        let _ = self.waker.wake();
    }
}

pub struct MemoryLoop {
    poll: Poll,
    /// Kept open so that the handle's last call, when it is dropped, arrives.
    _waker: Arc<Waker>,
    commands: channel::Receiver<Command>,
    /// What the manager should know of; one more than fit is in the text log only.
    incidents: mpsc::Sender<String>,
    /// Told when the loader leaves.
    farewell: Option<oneshot::Sender<()>>,
    state: State,
    recording: Writer,
    /// Rows were pushed since it was flushed.
    unflushed: bool,
    /// By [`slot`].
    clients: Vec<Option<Client>>,
    /// Slots whose client may have a request, and those whose request is on the bus.
    ready: Vec<usize>,
    asked: Vec<usize>,
    start: Instant,
    stuck_deadline: Duration,
    /// Of clients that have left.
    wire_bytes: u64,
}

/// Each place on the bus has one client at most.
fn slot(initiator: Initiator) -> usize {
    match initiator {
        Initiator::Loader => 0,
        Initiator::Master => 1,
        Initiator::Node(node) => 2 + usize::from(node.0),
    }
}

impl MemoryLoop {
    /// A peer that does not take its reply within `stuck_deadline` is dropped.
    ///
    /// # Errors
    /// The system has no file descriptor left.
    pub fn new(
        state: State,
        recording: Writer,
        incidents: mpsc::Sender<String>,
        stuck_deadline: Duration,
    ) -> io::Result<(Self, Handle)> {
        let poll = Poll::new()?;
        let waker = Arc::new(Waker::new(poll.registry(), WAKE)?);
        let (sender, commands) = channel::bounded(COMMANDS_MAX);
        let handle = Handle { commands: sender, waker: Arc::clone(&waker) };
        let memory_loop = Self {
            poll,
            _waker: waker,
            commands,
            incidents,
            farewell: None,
            state,
            recording,
            unflushed: false,
            clients: Vec::new(),
            ready: Vec::new(),
            asked: Vec::new(),
            start: Instant::now(),
            stuck_deadline,
            wire_bytes: 0,
        };
        Ok((memory_loop, handle))
    }

    /// Tells when the loader leaves, which is of interest where no manager says when it is over.
    pub fn tell_when_the_loader_leaves(&mut self, farewell: oneshot::Sender<()>) {
        self.farewell = Some(farewell);
    }

    /// Serves until asked to finish; `None` when the handle was dropped instead. The recording is whole after
    /// the former.
    ///
    /// # Errors
    /// The system cannot poll, or the recording cannot be written: a bus without its log is of no use.
    pub fn run(mut self, beacon: &Beacon) -> Result<Option<BusTotals>, LoopError> {
        let mut events = Events::with_capacity(EVENTS_MAX);
        loop {
            let told = self.turn(&mut events, self.timeout(), beacon)?;
            if events.is_empty() && self.ready.is_empty() {
                self.recording.flush()?;
                self.unflushed = false;
            }
            if told {
                match self.obey() {
                    Obeyed::On => self.serve(beacon)?,
                    Obeyed::Abandoned => return Ok(None),
                    Obeyed::Finish { lost } => return Ok(Some(self.finish(&mut events, &lost, beacon)?)),
                }
            }
        }
    }

    /// Waits for sockets and serves those that are ready. `true`: there are commands.
    fn turn(&mut self, events: &mut Events, timeout: Option<Duration>, beacon: &Beacon) -> Result<bool, LoopError> {
        beacon.idle();
        let polled = self.poll.poll(events, timeout);
        beacon.turn();
        match polled {
            // There are no events then.
            Err(error) if error.kind() == io::ErrorKind::Interrupted => events.clear(),
            polled => polled?,
        }
        let mut told = false;
        for event in events.iter() {
            match event.token() {
                WAKE => told = true,
                Token(slot) => self.wake(slot),
            }
        }
        self.serve(beacon)?;
        if timeout.is_some() {
            self.drop_stuck();
        }
        Ok(told)
    }

    /// The next look at what no event reports: peers that do not read, rows that wait for more rows.
    fn timeout(&self) -> Option<Duration> {
        if !self.ready.is_empty() {
            return Some(Duration::ZERO);
        }
        (self.unflushed || self.clients.iter().flatten().any(Client::is_stuck)).then_some(LOOK_PERIOD)
    }

    fn wake(&mut self, slot: usize) {
        if let Some(client) = self.clients.get_mut(slot).and_then(Option::as_mut) {
            client.wake();
            self.ready.push(slot);
        }
    }

    /// Rounds until there is no request, or [`ROUNDS_MAX`]: one request of each client that has one, all of them in the
    /// arbiter's order.
    fn serve(&mut self, beacon: &Beacon) -> Result<(), RecordingError> {
        for _ in 0..ROUNDS_MAX {
            if self.ready.is_empty() {
                break;
            }
            beacon.turn();
            let mut ready = std::mem::take(&mut self.ready);
            ready.drain(..).for_each(|slot| self.take_request(slot));
            self.ready = ready;
            while let Some(grant) = self.state.grant(nanoseconds_since(self.start)) {
                let slot = slot(grant.initiator);
                let Some(client) = self.clients.get_mut(slot).and_then(Option::as_mut) else {
                    self.state.abandon(grant);
                    continue;
                };
                let start = self.start;
                match self.state.serve(grant, &mut client.output, || nanoseconds_since(start)) {
                    Ok(transaction) => {
                        self.recording.push(transaction)?;
                        self.unflushed = true;
                    }
                    Err(refusal) => self.refuse(slot, &refusal),
                }
            }
            let mut asked = std::mem::take(&mut self.asked);
            asked.drain(..).for_each(|slot| self.reply(slot));
            self.asked = asked;
        }
        Ok(())
    }

    fn take_request(&mut self, slot: usize) {
        let Some(client) = self.clients.get_mut(slot).and_then(Option::as_mut) else {
            return;
        };
        let requested = client.flush().and_then(|()| match (client.peer, client.next_request()?) {
            (_, None) => Ok(None),
            (peer, Some((message, bulk))) => Ok(initiator(peer.role)
                .map(|initiator| self.state.request(initiator, message, bulk, nanoseconds_since(self.start)))),
        });
        match requested {
            Ok(None) => {}
            Ok(Some(Ok(()))) => self.asked.push(slot),
            Ok(Some(Err(refusal))) => self.refuse(slot, &refusal),
            Err(fault) => self.lose(slot, &fault),
        }
    }

    fn reply(&mut self, slot: usize) {
        let Some(client) = self.clients.get_mut(slot).and_then(Option::as_mut) else {
            return;
        };
        match client.flush() {
            // There may be another request in what was read.
            Ok(()) => self.ready.push(slot),
            Err(fault) => self.lose(slot, &fault),
        }
    }

    fn refuse(&mut self, slot: usize, refusal: &Refusal) {
        let Some(client) = self.clients.get_mut(slot).and_then(Option::as_mut) else {
            return;
        };
        let reply = MemoryReply::Refused(refusal.to_string());
        if frame::encode_into(&reply, &mut client.output, |_| ()).is_ok() {
            // The peer is dropped either way.
            let _ = client.flush();
        }
        let incident = format!("refused {}: {refusal}", client.peer);
        self.remove(slot);
        self.say_farewell(slot);
        self.tell(incident);
    }

    /// A peer that ends is none of the bus's business; one that breaks the conversation is named.
    fn lose(&mut self, slot: usize, fault: &Fault) {
        let Some(client) = self.remove(slot) else {
            return;
        };
        self.say_farewell(slot);
        match fault {
            Fault::Closed | Fault::Torn | Fault::Io(_) => tracing::info!("{}: {fault}", client.peer),
            _ => self.tell(format!("dropped {}: {fault}", client.peer)),
        }
    }

    fn say_farewell(&mut self, left: usize) {
        if left == slot(Initiator::Loader)
            && let Some(farewell) = self.farewell.take()
        {
            // An error means that it is not awaited.
            let _ = farewell.send(());
        }
    }

    fn drop_stuck(&mut self) {
        let deadline = self.stuck_deadline;
        for slot in 0..self.clients.len() {
            if self.clients[slot].as_ref().is_some_and(|client| client.is_stuck_for(deadline)) {
                self.lose(slot, &Fault::Stuck { deadline });
            }
        }
    }

    fn tell(&mut self, incident: String) {
        tracing::warn!("{incident}");
        // A full queue must not hold up the bus; the text log has it.
        let _ = self.incidents.try_send(incident);
    }

    fn obey(&mut self) -> Obeyed {
        loop {
            match self.commands.try_recv() {
                Ok(Command::Admit(peer, socket)) => self.admit(peer, socket),
                Ok(Command::Finish { lost }) => return Obeyed::Finish { lost },
                Err(channel::TryRecvError::Empty) => return Obeyed::On,
                Err(channel::TryRecvError::Disconnected) => return Obeyed::Abandoned,
            }
        }
    }

    fn admit(&mut self, peer: Peer, socket: Socket<std::net::TcpStream>) {
        let Some(initiator) = initiator(peer.role) else {
            return self.tell(format!("{peer} has no place on the bus"));
        };
        let slot = slot(initiator);
        if self.clients.len() <= slot {
            self.clients.resize_with(slot + 1, || None);
        }
        if let Some(before) = &self.clients[slot] {
            if before.peer.epoch > peer.epoch {
                return self.tell(format!("{peer} comes after {}: not admitted", before.peer));
            }
            tracing::info!("{peer} takes the place of {}", before.peer);
            self.remove(slot);
        }
        let mut client = Client::new(socket, peer);
        let interest = Interest::READABLE | Interest::WRITABLE;
        if let Err(error) = self.poll.registry().register(client.socket.inner_mut(), Token(slot), interest) {
            return self.tell(format!("{peer}: cannot be polled: {error}"));
        }
        tracing::info!("{peer} is on the bus");
        self.clients[slot] = Some(client);
        self.ready.push(slot);
    }

    fn remove(&mut self, slot: usize) -> Option<Client> {
        let mut client = self.clients.get_mut(slot)?.take()?;
        self.wire_bytes += client.wire_bytes;
        if let Some(initiator) = initiator(client.peer.role) {
            self.state.disconnect(initiator);
        }
        // An error means that it is not polled any more, which is the aim.
        let _ = self.poll.registry().deregister(client.socket.inner_mut());
        Some(client)
    }

    /// What was sent before the end may still be in the senders' sockets, where TCP holds it back until earlier
    /// data are acknowledged: it is whole when they have left.
    fn finish(mut self, events: &mut Events, lost: &[LostAttempt], beacon: &Beacon) -> Result<BusTotals, LoopError> {
        let late = Instant::now() + LEAVE_DEADLINE;
        self.serve(beacon)?;
        while self.clients.iter().skip(1).any(Option::is_some) && Instant::now() < late {
            self.turn(events, self.timeout().or(Some(LOOK_PERIOD)), beacon)?;
        }
        let wire_bytes = self.wire_bytes + self.clients.iter().flatten().map(|client| client.wire_bytes).sum::<u64>();
        let log = self.recording.finish()?;
        Ok(BusTotals { wire_bytes, log_rows: log.rows, log_waits: log.waits, ..self.state.totals(lost) })
    }
}

enum Obeyed {
    On,
    Abandoned,
    Finish { lost: Vec<LostAttempt> },
}

/// 584 years fit.
fn nanoseconds_since(start: Instant) -> u64 {
    start.elapsed().as_nanos() as u64
}
