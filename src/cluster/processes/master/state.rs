//! A master from its first command to its end: whom it talks to. No socket, no clock. Which node gets which tile is decided
//! in `dispatcher`.

use std::collections::HashMap;
use std::convert::Infallible;
use std::net::SocketAddr;
use std::time::Duration;

use bytes::BytesMut;

use super::dispatcher::{self, Dispatcher};
use super::seat::NodeProcess;
use crate::processes::driver::{self, Admission, ConnectionId, Loss, Machine, PeerId};
use crate::protocol::control::{MasterCommand, MasterConfiguration, MasterReport};
use crate::protocol::frame::{self, CodecError};
use crate::protocol::hello::Role;
use crate::protocol::memory::MemoryRequest;
use crate::protocol::work::{WorkReply, WorkRequest};
use ground::ids::{ClusterId, NodeId};
use machine::hardware::totals::MasterTotals;

/// How often tiles are looked at that may be late.
const LOOK_PERIOD: Duration = Duration::from_millis(100);
/// Requests of nodes that were not looked at yet.
const WAITING_MAX: usize = 1024;

const BUS: ConnectionId = ConnectionId::Dialled(0);

/// From a node.
#[derive(Clone, PartialEq, Debug)]
pub struct Incoming(pub WorkRequest);

/// To a node, or to the bus.
#[derive(Clone, PartialEq, Debug)]
pub enum Outgoing {
    Work(WorkReply),
    Memory(MemoryRequest),
}

type Event = driver::Event<State>;
type Action = driver::Action<State>;
type End = driver::End<State>;

#[derive(Debug, thiserror::Error)]
pub enum MasterError {
    #[error("the manager sent something else than a configuration")]
    NotConfigured,
    #[error("the manager's configuration has {nodes} nodes from node {first} on, expected 1 or more, up to node 65535")]
    NoSuchNodes { first: u16, nodes: u16 },
}

#[derive(Debug)]
pub struct State {
    cluster: ClusterId,
    phase: Phase,
}

#[derive(Debug)]
enum Phase {
    Unconfigured,
    Working(Box<Work>),
    /// All is reported but the totals: the messages to the bus leave first.
    Closing(MasterTotals),
    Over,
}

#[derive(Debug)]
struct Work {
    dispatcher: Dispatcher,
    bus: SocketAddr,
    bus_reached: bool,
    /// Why the next message to the bus is lost.
    bus_loss: Option<Loss>,
    listens: Option<SocketAddr>,
    peers: HashMap<ConnectionId, NodeProcess>,
    /// The latest of each.
    connections: HashMap<NodeProcess, ConnectionId>,
    next_look: Duration,
    /// Once all is done.
    totals: Option<MasterTotals>,
}

impl State {
    /// Of a master that is about to be configured.
    pub fn new(cluster: ClusterId) -> Self {
        Self { cluster, phase: Phase::Unconfigured }
    }

    /// Tiles in the cluster's queue or with its nodes.
    pub fn tiles(&self) -> usize {
        match &self.phase {
            Phase::Working(work) => work.dispatcher.tiles(),
            _ => 0,
        }
    }

    /// Requests of nodes that wait, attempts whose completions would be stale, and connections of nodes.
    pub fn sizes(&self) -> [usize; 3] {
        let Phase::Working(work) = &self.phase else { return [0; 3] };
        let [waiting, lost] = work.dispatcher.sizes();
        [waiting, lost, work.peers.len().max(work.connections.len())]
    }
}

impl Machine for State {
    type Command = MasterCommand;
    type Report = MasterReport;
    type Incoming = Incoming;
    type Outgoing = Outgoing;
    type Task = Infallible;
    type Answer = Infallible;

    const WAITING_MAX: usize = WAITING_MAX;
    const FAILED: fn(String) -> MasterReport = MasterReport::Incident;

    fn step(&mut self, now: Duration, event: Event, actions: &mut Vec<Action>) -> Result<(), End> {
        match (&mut self.phase, event) {
            (Phase::Unconfigured, Event::Command(MasterCommand::Configure(configuration))) => {
                self.phase = Phase::Working(Box::new(Work::begin(now, self.cluster, &configuration, actions)?));
            }
            (Phase::Unconfigured, Event::Command(_)) => return Err(MasterError::NotConfigured.into()),
            (Phase::Working(work), event) => {
                work.step(now, self.cluster, event, actions)?;
                if let Some(totals) = work.totals {
                    actions.push(Action::Close(BUS));
                    let is_flushed = work.bus_loss.is_some() || !work.bus_reached;
                    self.phase = Phase::Closing(totals);
                    if is_flushed {
                        return Err(finished(totals));
                    }
                }
            }
            (&mut Phase::Closing(totals), Event::Closed(BUS, _)) => return Err(finished(totals)),
            (Phase::Unconfigured | Phase::Closing(_) | Phase::Over, _) => {}
        }
        Ok(())
    }

    fn be_over(&mut self) {
        self.phase = Phase::Over;
    }

    fn next_deadline(&self) -> Option<Duration> {
        match &self.phase {
            Phase::Working(work) => Some(work.next_look),
            _ => None,
        }
    }

    fn frame_bytes_max(&self, peer: Role) -> usize {
        match peer {
            // It answers nothing that a master says.
            Role::Bus(_) => 0,
            _ => frame::frame_bytes_max::<WorkRequest>(),
        }
    }
}

fn finished(totals: MasterTotals) -> End {
    End::Done(MasterReport::Finished(totals))
}

impl Work {
    fn begin(
        now: Duration,
        cluster: ClusterId,
        configuration: &MasterConfiguration,
        actions: &mut Vec<Action>,
    ) -> Result<Self, MasterError> {
        let MasterConfiguration { bus, first_node, nodes, .. } = *configuration;
        let last = nodes.checked_sub(1).and_then(|more| first_node.0.checked_add(more));
        let last = NodeId(last.ok_or(MasterError::NoSuchNodes { first: first_node.0, nodes })?);
        actions.push(Action::Dial { id: BUS, role: Role::Bus(cluster), address: bus, pause: Duration::ZERO });
        actions.push(Action::Listen(Admission::Nodes { first: first_node, last }));
        Ok(Self {
            dispatcher: Dispatcher::new(configuration),
            bus,
            bus_reached: false,
            bus_loss: None,
            listens: None,
            peers: HashMap::new(),
            connections: HashMap::new(),
            next_look: now,
            totals: None,
        })
    }

    fn step(&mut self, now: Duration, cluster: ClusterId, event: Event, actions: &mut Vec<Action>) -> Result<(), End> {
        match event {
            Event::Listening(address) => {
                self.listens = Some(address);
                self.introduce(actions);
            }
            Event::Dialled(BUS) => {
                self.bus_reached = true;
                self.introduce(actions);
            }
            Event::Closed(BUS, Some(Loss { why, .. })) if !self.bus_reached => return Err(End::Failed(why)),
            Event::Closed(BUS, loss) => {
                let closed = || format!("{} at {}: the connection was closed", Role::Bus(cluster), self.bus);
                self.bus_loss.get_or_insert_with(|| loss.unwrap_or_else(|| Loss { why: closed(), is_breach: false }));
            }
            Event::Failed(why) => return Err(End::Failed(why)),
            Event::Command(command) => self.handle(now, dispatcher::Event::Command(command), actions),
            Event::Refused(who) => self.handle(now, dispatcher::Event::Refused(who), actions),
            Event::Accepted(id, PeerId { role: Role::Node(node), epoch }) => {
                let process = NodeProcess { node, epoch };
                self.peers.insert(id, process);
                if let Some(before) = self.connections.insert(process, id) {
                    self.peers.remove(&before);
                    actions.push(Action::Close(before));
                }
                self.handle(now, dispatcher::Event::Connected(process), actions);
            }
            Event::Received(id, Incoming(request)) => {
                if let Some(&process) = self.peers.get(&id) {
                    self.handle(now, dispatcher::Event::Request(process, request), actions);
                }
            }
            Event::Closed(id, loss) => {
                let Some(process) = self.peers.remove(&id) else { return Ok(()) };
                self.connections.remove(&process);
                match loss {
                    Some(Loss { why, is_breach: true }) => {
                        self.handle(now, dispatcher::Event::Refused(why), actions);
                    }
                    Some(Loss { why, .. }) => tracing::warn!("{why}"),
                    None => {}
                }
                self.handle(now, dispatcher::Event::Disconnected(process), actions);
            }
            Event::Deadline if now >= self.next_look => {
                self.next_look = now + LOOK_PERIOD;
                self.handle(now, dispatcher::Event::Tick, actions);
            }
            _ => {}
        }
        Ok(())
    }

    /// Says where it listens, once it can serve.
    fn introduce(&self, actions: &mut Vec<Action>) {
        if let (true, Some(address)) = (self.bus_reached, self.listens) {
            actions.push(Action::Report(MasterReport::Listening(address)));
        }
    }

    fn handle(&mut self, now: Duration, event: dispatcher::Event, actions: &mut Vec<Action>) {
        for action in self.dispatcher.handle(now, event) {
            match action {
                dispatcher::Action::Report(report) => actions.push(Action::Report(report)),
                dispatcher::Action::Hand { to, tile, attempt, permit } => {
                    if let Some(&id) = self.connections.get(&to) {
                        let job = WorkReply::Job { tile, attempt, permit };
                        actions.push(Action::Send(id, Outgoing::Work(job)));
                    }
                }
                dispatcher::Action::Bus(message) => match &mut self.bus_loss {
                    None => actions.push(Action::Send(BUS, Outgoing::Memory(message))),
                    // Reported once.
                    Some(loss) if !loss.why.is_empty() => {
                        let why = std::mem::take(&mut loss.why);
                        actions.push(Action::Report(MasterReport::Incident(why)));
                    }
                    Some(_) => {}
                },
                dispatcher::Action::Dismiss(process) => {
                    if let Some(id) = self.connections.remove(&process) {
                        self.peers.remove(&id);
                        actions.push(Action::Close(id));
                    }
                }
                dispatcher::Action::End(totals) => self.totals = Some(totals),
            }
        }
    }
}

impl driver::Incoming for Incoming {
    fn decode(_peer: Role, frame: BytesMut) -> Result<Self, CodecError> {
        Ok(Self(frame::decode_whole(&frame)?))
    }
}

impl driver::Outgoing for Outgoing {
    fn frame(&self, head: &mut Vec<u8>) -> Result<[&[u8]; 4], CodecError> {
        match self {
            Self::Work(reply) => frame::encode_head(reply, 0, head)?,
            Self::Memory(request) => frame::encode_head(request, 0, head)?,
        }
        Ok([&[]; 4])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::control::TileGrant;
    use crate::protocol::mac::MacKey;
    use ground::ids::Epoch;
    use machine::tile_order::Assignment;

    const NODE: ConnectionId = ConnectionId::Accepted(7);

    fn configure(first: u16, nodes: u16) -> Event {
        Event::Command(MasterCommand::Configure(MasterConfiguration {
            bus: ([127, 0, 0, 1], 1).into(),
            first_node: NodeId(first),
            nodes,
            threads: 1,
            assignment: Assignment::OnDemand,
            tile_deadline_milliseconds: 1000,
            key: MacKey::new([1; 32]),
        }))
    }

    fn at(state: &mut State, milliseconds: u64, event: Event) -> Vec<Action> {
        state.handle(Duration::from_millis(milliseconds), event)
    }

    fn reports(actions: &[Action]) -> Vec<&MasterReport> {
        actions
            .iter()
            .filter_map(|action| if let Action::Report(report) = action { Some(report) } else { None })
            .collect()
    }

    /// With node 0 connected, and nothing to do.
    fn serving() -> State {
        let mut state = State::new(ClusterId(0));
        at(&mut state, 0, configure(0, 2));
        let listens = Event::Listening(([127, 0, 0, 1], 9).into());
        assert!(reports(&at(&mut state, 1, listens)).is_empty(), "the bus is not reached");
        let actions = at(&mut state, 1, Event::Dialled(BUS));
        assert_eq!(reports(&actions), [&MasterReport::Listening(([127, 0, 0, 1], 9).into())]);
        let peer = PeerId { role: Role::Node(NodeId(0)), epoch: Epoch(0) };
        at(&mut state, 2, Event::Accepted(NODE, peer));
        state
    }

    fn grant(tile: u32) -> Event {
        let grant = TileGrant {
            tile: ground::ids::TileId(tile),
            attempt: ground::ids::Attempt(0),
            node: None,
            except: Vec::new(),
        };
        Event::Command(MasterCommand::Tiles(vec![grant]))
    }

    #[test]
    fn nodes_that_cannot_be_are_refused() {
        for (first, nodes) in [(0, 0), (65_535, 2), (2, 65_535)] {
            let actions = at(&mut State::new(ClusterId(0)), 0, configure(first, nodes));
            let [Action::Report(MasterReport::Incident(why)), Action::End(Err(_))] = &actions[..] else {
                panic!("{first}, {nodes}")
            };
            assert!(why.contains("expected 1 or more, up to node 65535"), "{why}");
        }
        let mut last = State::new(ClusterId(0));
        for event in [configure(65_535, 1), grant(0), Event::Deadline, Event::Command(MasterCommand::Finish)] {
            let actions = at(&mut last, 0, event);
            assert!(actions.iter().all(|action| !matches!(action, Action::End(Err(_)))));
        }
    }

    #[test]
    fn a_lost_bus_is_reported_once_with_the_first_message_that_it_lacks() {
        let mut state = serving();
        assert!(at(&mut state, 3, Event::Closed(BUS, None)).is_empty());
        for (tile, incidents) in [(0, 1), (1, 0)] {
            at(&mut state, 4, Event::Received(NODE, Incoming(WorkRequest::Ready)));
            let actions = at(&mut state, 5, grant(tile));
            assert!(actions.iter().any(|action| matches!(action, Action::Send(NODE, Outgoing::Work(_)))));
            let told = reports(&actions).into_iter().filter(|report| matches!(report, MasterReport::Incident(_)));
            assert_eq!(told.count(), incidents, "tile {tile}");
        }
    }

    #[test]
    fn the_totals_are_reported_when_all_that_was_modelled_has_left() {
        let mut state = serving();
        at(&mut state, 3, Event::Received(NODE, Incoming(WorkRequest::Ready)));
        at(&mut state, 3, grant(0));
        let actions = at(&mut state, 4, Event::Command(MasterCommand::Finish));
        assert!(matches!(&actions[..], [.., Action::Close(BUS)]), "not yet");
        let actions = at(&mut state, 5, Event::Closed(BUS, None));
        assert!(matches!(&actions[..], [Action::Report(MasterReport::Finished(_)), Action::End(Ok(()))]));
        assert!(at(&mut state, 6, Event::Closed(BUS, None)).is_empty());
    }

    #[test]
    fn a_node_that_comes_again_leaves_its_first_connection() {
        let mut state = serving();
        let again = ConnectionId::Accepted(8);
        let peer = PeerId { role: Role::Node(NodeId(0)), epoch: Epoch(0) };
        let actions = at(&mut state, 3, Event::Accepted(again, peer));
        let closed = |action: &Action| if let Action::Close(id) = action { Some(*id) } else { None };
        assert_eq!(actions.iter().filter_map(closed).collect::<Vec<_>>(), [NODE, again], "one process has one");
        assert!(at(&mut state, 4, Event::Received(NODE, Incoming(WorkRequest::Ready))).is_empty());
    }

    #[test]
    fn late_tiles_are_looked_for_every_100_ms() {
        let mut state = serving();
        at(&mut state, 3, Event::Received(NODE, Incoming(WorkRequest::Ready)));
        at(&mut state, 3, grant(0));
        let mut now = Duration::ZERO;
        let late = loop {
            now = state.next_deadline().expect("serving").max(now);
            let actions = state.handle(now, Event::Deadline);
            if reports(&actions).iter().any(|report| matches!(report, MasterReport::Late { .. })) {
                break now;
            }
        };
        assert!((1003..=1103).contains(&late.as_millis()), "{late:?}");
    }
}
