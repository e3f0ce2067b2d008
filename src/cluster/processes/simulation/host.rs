//! The driver in virtual time: one loop, whatever the process. It does for a [`Machine`] what `driver/live.rs` does, over a
//! network of numbers; what goes over it are the frames of the wire.

use std::collections::{HashMap, VecDeque};
use std::net::SocketAddr;
use std::time::Duration;

use bytes::BytesMut;

use super::child::{Child, EXIT_ERROR, EXIT_OK};
use super::hostile::{Adversary, Forge, Manner, Subvertible};
use super::network::{Actor, Message, Network, Parcel, Timer, Wire};
use super::stopwatch::Stopwatch;
use crate::processes::driver::{
    Action, Admission, CONNECT_DEADLINE, ConnectionId, Event, Incoming, Loss, Machine, Outgoing, PeerId, UNREAD_MAX,
};
use crate::processes::manager::process::ProcessId;
use crate::protocol::control::Command as _;
use crate::protocol::frame::PREFIX_BYTES;
use crate::protocol::hello::Role;

/// Does the tasks of a state in virtual time.
pub(super) trait Worker<M: Machine> {
    /// As of the live driver's worker.
    fn begin(&mut self, context: &mut Context, task: M::Task) -> Result<Option<M::Answer>, String>;

    /// Takes a connection that is not for the state.
    fn take_over(&mut self, _desk: &mut Context, _wire: Wire, _peer: ProcessId) -> Option<Vec<M::Answer>> {
        None
    }

    /// Something of a connection that is the worker's; `None`: it is the state's.
    fn arrived(&mut self, _desk: &mut Context, _wire: Wire, _parcel: &Parcel) -> Option<Vec<M::Answer>> {
        None
    }

    /// One of the worker's timers.
    fn timer(&mut self, _desk: &mut Context, _timer: Timer) -> Vec<M::Answer> {
        Vec::new()
    }
}

/// What a worker works with.
pub(super) struct Context<'a> {
    pub(super) network: &'a mut Network,
    pub(super) me: Actor,
    pub(super) id: ProcessId,
}

pub(super) struct Host<M: Subvertible, W> {
    pub(super) child: Child,
    pub(super) machine: M,
    /// `Some`: it is hostile.
    pub(super) hostile: Option<Adversary<M>>,
    pub(super) worker: W,
    admission: Option<Admission>,
    accepted: u64,
    /// Dialled after a pause.
    awaited: HashMap<u32, (Role, SocketAddr)>,
    wires: HashMap<ConnectionId, Connection>,
    ids: HashMap<Wire, ConnectionId>,
    /// Most messages of this process on their way to one client, and to one server.
    pub(super) unread_most: [usize; 2],
    /// The earliest look at deadlines that is planned.
    armed: Option<Duration>,
}

#[derive(Clone, Copy, Debug)]
struct Connection {
    wire: Wire,
    peer: Role,
    /// The peer has answered.
    is_open: bool,
}

impl<M: Subvertible, W: Worker<M>> Host<M, W> {
    pub(super) fn new(child: Child, machine: M, worker: W, forge: Option<Forge>) -> Self {
        Self {
            child,
            machine,
            hostile: forge.map(Adversary::new),
            worker,
            admission: None,
            accepted: 0,
            awaited: HashMap::new(),
            wires: HashMap::new(),
            ids: HashMap::new(),
            unread_most: [0; 2],
            armed: None,
        }
    }

    pub(super) fn arrived(&mut self, network: &mut Network, watch: &mut Stopwatch, wire: Wire, parcel: Parcel) {
        let mut context = Context { network, me: self.child.me, id: self.child.id };
        if let Some(answers) = self.worker.arrived(&mut context, wire, &parcel) {
            return answers.into_iter().for_each(|answer| self.handle(network, watch, Event::Answer(answer)));
        }
        let event = match parcel {
            Parcel::Message(Message::Command(command)) => match M::command(command) {
                Some(command) if !command.is_heartbeat() => Some(Event::Command(command)),
                _ => None,
            },
            Parcel::Hello(peer) => return self.admit(network, watch, wire, peer),
            Parcel::Welcome => self.ids.get(&wire).copied().and_then(|id| {
                self.wires.get_mut(&id)?.is_open = true;
                Some(Event::Dialled(id))
            }),
            Parcel::Message(Message::Frame(frame)) => {
                if self.hostile.as_ref().is_some_and(|hostile| hostile.forge.manner == Manner::Unreading) {
                    network.hold(self.child.me, wire);
                }
                self.ids.get(&wire).copied().map(|id| self.read(network, id, &frame))
            }
            Parcel::End => self.ids.get(&wire).copied().map(|id| {
                let is_open = self.wires.get(&id).is_some_and(|connection| connection.is_open);
                self.forget(network, id);
                let refused = || Loss { why: "nobody listens there".to_owned(), is_breach: false };
                Event::Closed(id, (!is_open).then(refused))
            }),
            Parcel::Message(Message::Report(_)) => None,
        };
        if let Some(event) = event {
            self.handle(network, watch, event);
        }
    }

    pub(super) fn timer(&mut self, network: &mut Network, watch: &mut Stopwatch, timer: Timer) {
        match timer {
            Timer::Deadline => {
                self.armed = None;
                if self.machine.next_deadline().is_some_and(|deadline| deadline <= network.now) {
                    return self.handle(network, watch, Event::Deadline);
                }
                self.arm(network);
            }
            Timer::Dial(number) => {
                if let Some((role, address)) = self.awaited.remove(&number) {
                    self.dial(network, ConnectionId::Dialled(number), role, address);
                }
            }
            Timer::Dialled(wire) if self.ids.contains_key(&wire) => {
                let id = self.ids[&wire];
                if !self.wires[&id].is_open {
                    self.forget(network, id);
                    let why = format!("silent for {} ms", CONNECT_DEADLINE.as_millis());
                    self.handle(network, watch, Event::Closed(id, Some(Loss { why, is_breach: false })));
                }
            }
            timer => {
                let mut context = Context { network, me: self.child.me, id: self.child.id };
                let answers = self.worker.timer(&mut context, timer);
                answers.into_iter().for_each(|answer| self.handle(network, watch, Event::Answer(answer)));
            }
        }
    }

    /// An event, and what the state answers, to its end.
    pub(super) fn handle(&mut self, network: &mut Network, watch: &mut Stopwatch, event: Event<M>) {
        let mut events = VecDeque::from([event]);
        while let Some(event) = events.pop_front() {
            if self.child.is_closing() {
                return;
            }
            let (now, machine) = (network.now, &mut self.machine);
            let mut actions = watch.time(|| machine.handle(now, event));
            if let Some(hostile) = &mut self.hostile {
                actions = hostile.tamper(actions);
            }
            for action in actions {
                match self.act(network, action) {
                    Some(Event::Failed(why)) => {
                        events.push_front(Event::Failed(why));
                        break;
                    }
                    event => events.extend(event),
                }
            }
        }
        self.arm(network);
    }

    fn act(&mut self, network: &mut Network, action: Action<M>) -> Option<Event<M>> {
        match action {
            Action::Report(report) => self.child.report(network, M::report(report)),
            Action::Listen(admission) => {
                self.admission = Some(admission);
                return Some(Event::Listening(Network::address(self.child.me)));
            }
            Action::Dial { id, role, address, pause } => match id {
                ConnectionId::Dialled(number) if !pause.is_zero() => {
                    self.awaited.insert(number, (role, address));
                    network.wake(self.child.me, pause, Timer::Dial(number));
                }
                id => self.dial(network, id, role, address),
            },
            Action::Send(to, message) => return self.send(network, to, &message),
            Action::Close(id) => {
                if let ConnectionId::Dialled(number) = id {
                    self.awaited.remove(&number);
                }
                self.forget(network, id);
                return Some(Event::Closed(id, None));
            }
            Action::Task(task) => {
                let mut context = Context { network, me: self.child.me, id: self.child.id };
                match self.worker.begin(&mut context, task) {
                    Ok(answer) => return answer.map(Event::Answer),
                    Err(why) => return Some(Event::Failed(why)),
                }
            }
            Action::End(outcome) => {
                let mut open: Vec<_> = self.wires.keys().copied().collect();
                open.sort_unstable();
                open.into_iter().for_each(|id| self.forget(network, id));
                self.child.close(network, if outcome.is_ok() { EXIT_OK } else { EXIT_ERROR });
            }
        }
        None
    }

    fn admit(&mut self, network: &mut Network, watch: &mut Stopwatch, wire: Wire, peer: ProcessId) {
        let admitted = match self.admission {
            Some(admission) => admission.check(peer.role),
            None => return network.close(self.child.me, wire),
        };
        if let Err(expected) = admitted {
            network.close(self.child.me, wire);
            return self.handle(network, watch, Event::Refused(format!("{peer} is not expected, {expected} is")));
        }
        network.welcome(self.child.me, wire);
        let mut context = Context { network, me: self.child.me, id: self.child.id };
        if let Some(answers) = self.worker.take_over(&mut context, wire, peer) {
            return answers.into_iter().for_each(|answer| self.handle(network, watch, Event::Answer(answer)));
        }
        let id = ConnectionId::Accepted(self.accepted);
        self.accepted += 1;
        self.open(id, Connection { wire, peer: peer.role, is_open: true });
        self.handle(network, watch, Event::Accepted(id, PeerId { role: peer.role, epoch: peer.epoch }));
    }

    fn dial(&mut self, network: &mut Network, id: ConnectionId, peer: Role, address: SocketAddr) {
        let wire = network.dial(self.child.me, self.child.id, address, CONNECT_DEADLINE);
        self.open(id, Connection { wire, peer, is_open: false });
    }

    fn open(&mut self, id: ConnectionId, connection: Connection) {
        self.ids.insert(connection.wire, id);
        self.wires.insert(id, connection);
    }

    fn read(&mut self, network: &mut Network, id: ConnectionId, frame: &[u8]) -> Event<M> {
        let peer = self.wires[&id].peer;
        let body = frame.get(PREFIX_BYTES..).unwrap_or_default();
        let decoded = if body.len() <= self.machine.frame_bytes_max(peer) {
            M::Incoming::decode(peer, BytesMut::from(body)).map_err(|error| error.to_string())
        } else {
            Err(format!("a frame of {} bytes", body.len()))
        };
        match decoded {
            Ok(message) => Event::Received(id, message),
            Err(why) => self.breach(network, id, why),
        }
    }

    fn send(&mut self, network: &mut Network, to: ConnectionId, message: &M::Outgoing) -> Option<Event<M>> {
        let &Connection { wire, is_open: true, .. } = self.wires.get(&to)? else { return None };
        // As live: a server is waited for.
        let is_client = matches!(to, ConnectionId::Accepted(_));
        if is_client && network.under_way(self.child.me, wire) >= UNREAD_MAX {
            return Some(self.breach(network, to, format!("did not read {UNREAD_MAX} messages")));
        }
        let mut frame = Vec::new();
        match message.frame(&mut frame).map(|bulk| bulk.concat()) {
            Ok(bulk) => {
                frame.extend(bulk);
                network.send(self.child.me, wire, Message::Frame(frame));
                if self.hostile.is_none() {
                    let sent = &mut self.unread_most[usize::from(!is_client)];
                    *sent = (*sent).max(network.under_way(self.child.me, wire));
                }
                None
            }
            Err(error) => Some(self.breach(network, to, error.to_string())),
        }
    }

    fn breach(&mut self, network: &mut Network, id: ConnectionId, why: String) -> Event<M> {
        self.forget(network, id);
        Event::Closed(id, Some(Loss { why, is_breach: true }))
    }

    /// Whether what comes on a connection is read.
    pub(super) fn reads(&self, wire: Wire) -> bool {
        !self.child.is_closing() && self.ids.contains_key(&wire)
    }

    fn forget(&mut self, network: &mut Network, id: ConnectionId) {
        if let Some(connection) = self.wires.remove(&id) {
            self.ids.remove(&connection.wire);
            network.close(self.child.me, connection.wire);
        }
    }

    /// Looks at deadlines when the next one is due.
    fn arm(&mut self, network: &mut Network) {
        let Some(deadline) = self.machine.next_deadline().filter(|_| !self.child.is_closing()) else { return };
        if self.armed.is_none_or(|armed| deadline < armed) {
            self.armed = Some(deadline);
            network.wake(self.child.me, deadline.saturating_sub(network.now), Timer::Deadline);
        }
    }
}
