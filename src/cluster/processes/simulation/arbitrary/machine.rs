//! A sequence of events for one [`Machine`]. After each of them is checked:
//!
//! - it answers an event with a bounded number of actions, and has a bounded number of tasks at its worker;
//! - what it sends and reports can be encoded;
//! - it dials no connection twice, and listens once;
//! - when its deadline has passed and was looked at, the next one is later;
//! - it ends after a last report, and does nothing more.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use super::super::dice::Dice;
use super::super::hostile::Forge;
use crate::processes::driver::{Action, Admission, ConnectionId, Event, Loss, Machine, Outgoing, PeerId};
use crate::protocol::frame;
use crate::protocol::hello::Role;
use ground::ids::Epoch;

/// Of every state here.
pub(super) const NODES: u16 = 3;
pub(super) const TILES: u32 = 12;
/// Messages that are remembered, to be answered.
const SENT_MAX: usize = 16;
/// Between two events.
const PAUSE_MAX: Duration = Duration::from_secs(8);
/// For each connection, as many as a peer may be owed at a time; and some more.
const ACTIONS_OF_A_CONNECTION: usize = 16;
const ACTIONS_MAX: usize = 16;

/// A machine whose events can be made up.
pub(super) trait Arbitrary: Machine<Outgoing: Clone> {
    /// Tasks that its worker has at a time.
    const TASKS_MAX: usize;

    /// About to be configured.
    fn begin() -> Self;

    fn command(forge: &mut Forge) -> Self::Command;

    /// A message of this peer; `sent` is what went to it lately. `None`: it sends nothing.
    fn message(forge: &mut Forge, peer: PeerId, sent: &[Self::Outgoing]) -> Option<Self::Incoming>;

    /// Whether the worker is done with it when it has begun, without an answer.
    fn is_done_at_once(_task: &Self::Task) -> bool {
        false
    }

    /// What the worker answers to another one.
    fn answer(forge: &mut Forge, task: Self::Task) -> Self::Answer;
}

pub(super) struct Course<M: Arbitrary> {
    machine: M,
    forge: Forge,
    now: Duration,
    admission: Option<Admission>,
    accepted: u64,
    /// Those that are over, too: what is dialled has a new number each time.
    connections: BTreeMap<ConnectionId, Connection<M>>,
    tasks: VecDeque<M::Task>,
    is_over: bool,
}

struct Connection<M: Arbitrary> {
    peer: PeerId,
    stage: Stage,
    sent: Vec<M::Outgoing>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Stage {
    Dialling,
    Open,
    /// By the machine. That what was sent has left may still be reported.
    Closed,
}

impl<M: Arbitrary> Course<M> {
    pub(super) fn run(bytes: &[u8]) {
        let dice = Dice::Bytes(bytes.iter().copied().collect());
        let mut course = Self {
            machine: M::begin(),
            forge: Forge::new(dice, NODES, TILES),
            now: Duration::ZERO,
            admission: None,
            accepted: 0,
            connections: BTreeMap::new(),
            tasks: VecDeque::new(),
            is_over: false,
        };
        while !course.forge.dice.is_spent() {
            if course.forge.dice.chance(20) {
                course.wait();
            } else {
                course.now += course.forge.dice.between(Duration::ZERO, PAUSE_MAX) / 16;
                if let Some(event) = course.event() {
                    course.happen(event);
                }
            }
        }
        course.wait();
    }

    /// Until the next deadline.
    fn wait(&mut self) {
        let Some(deadline) = self.machine.next_deadline() else { return };
        self.now = self.now.max(deadline);
        self.happen(Event::Deadline);
        let next = self.machine.next_deadline();
        assert!(next.is_none_or(|next| next > self.now), "no progress: {next:?} at {:?}", self.now);
    }

    fn event(&mut self) -> Option<Event<M>> {
        let forge = &mut self.forge;
        Some(match forge.dice.below(32) {
            0..6 => Event::Command(M::command(forge)),
            6 if M::LEAVES => Event::Terminate,
            7 => Event::Refused("a stranger".to_owned()),
            8 if forge.dice.chance(10) => Event::Failed("no space left".to_owned()),
            9..12 => {
                let peer = PeerId { role: Role::Node(forge.node()), epoch: forge.epoch() };
                self.admission.filter(|admission| admission.check(peer.role).is_ok())?;
                let id = ConnectionId::Accepted(self.accepted);
                self.accepted += 1;
                self.connections.insert(id, Connection { peer, stage: Stage::Open, sent: Vec::new() });
                Event::Accepted(id, peer)
            }
            12..15 => {
                let id = self.any(|stage| stage == Stage::Dialling)?;
                self.connections.get_mut(&id)?.stage = Stage::Open;
                Event::Dialled(id)
            }
            15 => {
                let id = self.any(|_| true)?;
                let loss = Loss { why: "a peer: gone".to_owned(), is_breach: self.forge.dice.chance(50) };
                let is_lost = self.connections.get(&id)?.stage != Stage::Closed && self.forge.dice.chance(70);
                self.connections.get_mut(&id)?.stage = Stage::Closed;
                Event::Closed(id, is_lost.then_some(loss))
            }
            16..21 => {
                let task = self.tasks.pop_front()?;
                Event::Answer(M::answer(&mut self.forge, task))
            }
            _ => {
                let id = self.any(|stage| stage == Stage::Open)?;
                let Connection { peer, sent, .. } = self.connections.get(&id)?;
                Event::Received(id, M::message(&mut self.forge, *peer, sent)?)
            }
        })
    }

    /// A connection in such a stage.
    fn any(&mut self, is_suitable: impl Fn(Stage) -> bool) -> Option<ConnectionId> {
        let suitable = self.connections.iter().filter(|(_, connection)| is_suitable(connection.stage));
        let ids: Vec<_> = suitable.map(|(id, _)| *id).collect();
        (!ids.is_empty()).then(|| *self.forge.dice.choose(&ids))
    }

    /// An event, and what the driver does at once about the actions.
    fn happen(&mut self, event: Event<M>) {
        let mut events = VecDeque::from([event]);
        while let Some(event) = events.pop_front() {
            let actions = self.machine.handle(self.now, event);
            self.check(&actions);
            for action in actions {
                match self.act(action) {
                    Some(Event::Failed(why)) => {
                        events.push_front(Event::Failed(why));
                        break;
                    }
                    event => events.extend(event),
                }
            }
        }
    }

    fn check(&mut self, actions: &[Action<M>]) {
        if self.is_over {
            assert!(actions.is_empty() && self.machine.next_deadline().is_none(), "it goes on after its end");
        }
        let connections = self.connections.values().filter(|connection| connection.stage != Stage::Closed).count();
        let most = ACTIONS_MAX + ACTIONS_OF_A_CONNECTION * connections;
        assert!(actions.len() <= most, "{} actions with {connections} connections", actions.len());
        if let Some(end) = actions.iter().position(|action| matches!(action, Action::End(_))) {
            assert_eq!(end + 1, actions.len(), "it goes on after its end");
            assert!(
                end.checked_sub(1).is_some_and(|last| matches!(actions[last], Action::Report(_))),
                "no last report"
            );
            self.is_over = true;
        }
    }

    fn act(&mut self, action: Action<M>) -> Option<Event<M>> {
        match action {
            Action::Report(report) => {
                frame::encode(&report, &[]).expect("a report that can be sent");
            }
            Action::Listen(admission) => {
                assert!(self.admission.replace(admission).is_none(), "it listens twice");
                return Some(Event::Listening(([127, 0, 0, 1], 1).into()));
            }
            Action::Dial { id, role, .. } => {
                let connection =
                    Connection { peer: PeerId { role, epoch: Epoch(0) }, stage: Stage::Dialling, sent: Vec::new() };
                assert!(self.connections.insert(id, connection).is_none(), "{id:?} is dialled twice");
            }
            Action::Send(to, message) => {
                message.frame(&mut Vec::new()).expect("a message that can be sent");
                if let Some(Connection { stage: Stage::Open, sent, .. }) = self.connections.get_mut(&to) {
                    if sent.len() == SENT_MAX {
                        sent.remove(0);
                    }
                    sent.push(message);
                }
            }
            Action::Close(id) => {
                if let Some(connection) = self.connections.get_mut(&id) {
                    connection.stage = Stage::Closed;
                }
            }
            Action::Task(task) => {
                if self.forge.dice.chance(1) {
                    return Some(Event::Failed("the worker cannot".to_owned()));
                }
                if !M::is_done_at_once(&task) {
                    self.tasks.push_back(task);
                }
                assert!(self.tasks.len() <= M::TASKS_MAX, "{} tasks", self.tasks.len());
            }
            Action::End(_) => {}
        }
        None
    }
}
