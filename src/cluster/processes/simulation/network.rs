//! Connections and time that exist in numbers only. What is sent arrives later, in order on each connection, unless
//! one of the two ends is gone; what is sent to or by somebody who is cut off, or to somebody who is stopped, arrives
//! when that is over.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};
use std::net::SocketAddr;
use std::time::Duration;

use super::dice::Dice;
use crate::processes::manager::process::{Command, ProcessId, Report};

/// What a message takes; one in a hundred takes [`SPIKE`] times as long.
const DELAY: [Duration; 2] = [Duration::from_micros(30), Duration::from_micros(600)];
const SPIKE: u32 = 50;
/// From the death of a process until it is known.
const EXIT_DELAY: [Duration; 2] = [Duration::from_micros(100), Duration::from_millis(3)];

/// A process, in the order in which they were started.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub(super) struct Actor(pub(super) usize);

/// It has no successors, and none of the troubles below.
pub(super) const MANAGER: Actor = Actor(0);

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub(super) struct Wire(usize);

#[derive(Debug)]
pub(super) enum Parcel {
    /// Who dials.
    Hello(ProcessId),
    Welcome,
    Message(Message),
    /// Nothing comes after it.
    End,
}

/// What the conversations carry.
#[derive(Debug)]
pub(super) enum Message {
    Command(Command),
    Report(Report),
    /// A whole one, as it goes over the wire between other processes than the manager.
    Frame(Vec<u8>),
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Timer {
    Start,
    Heartbeat,
    Tick,
    /// What was dialled has not answered.
    Dialled(Wire),
    /// The pause before a connection of this number is dialled is over.
    Dial(u32),
    /// Time to look at the deadlines of a state.
    Deadline,
    /// The tracer is done with its tile, but for what it waits for.
    Traced,
    /// A bus waits no longer for those who have not left.
    Leave,
    /// The manager is interrupted.
    Interrupt,
    /// Nobody hangs up.
    HangUp,
}

/// What concerns somebody.
#[derive(Debug)]
pub(super) enum Occurrence {
    Arrived(Actor, Wire, Parcel),
    Timer(Actor, Timer),
    /// Known to be dead, and how.
    Exited(Actor, &'static str),
    /// The next fault of the schedule is due.
    Fault(usize),
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Trouble {
    Stopped,
    Cut,
}

#[derive(Debug)]
enum Planned {
    /// The next parcel of the stream to this end.
    Delivery(Wire, usize),
    Timer(Actor, Timer),
    Exited(Actor, &'static str),
    Fault(usize),
    Relief(Actor, Trouble),
}

#[derive(Debug)]
struct Due {
    at: Duration,
    /// What was planned first happens first.
    number: u64,
    what: Planned,
}

#[derive(Debug)]
struct Ends {
    actors: [Actor; 2],
    /// Towards each end.
    streams: [Stream; 2],
}

#[derive(Debug, Default)]
struct Stream {
    parcels: VecDeque<Parcel>,
    /// When the last of them arrives, if nothing is in its way.
    last: Duration,
    /// So many of them should have arrived, and wait.
    stalled: usize,
    /// Its writer has ended it.
    ended: bool,
    /// Nobody reads it any more.
    unread: bool,
    /// Its reader leaves everything where it is.
    held: bool,
}

#[derive(Debug, Default)]
struct Host {
    dead: bool,
    /// How many stops are not over yet.
    stopped: u32,
    cut: u32,
    /// What went off while it was stopped.
    missed: Vec<Timer>,
    wires: Vec<Wire>,
}

#[derive(Debug)]
pub(super) struct Network {
    pub(super) now: Duration,
    pub(super) dice: Dice,
    due: BinaryHeap<Reverse<Due>>,
    planned: u64,
    wires: Vec<Ends>,
    hosts: Vec<Host>,
    /// Most parcels that were under way on one stream, those held up included.
    pub(super) longest: usize,
}

impl Network {
    /// With nobody in it but the manager.
    pub(super) fn new(seed: u64) -> Self {
        Self {
            now: Duration::ZERO,
            dice: Dice::new(seed),
            due: BinaryHeap::new(),
            planned: 0,
            wires: Vec::new(),
            hosts: vec![Host::default()],
            longest: 0,
        }
    }

    pub(super) fn add(&mut self) -> Actor {
        self.hosts.push(Host::default());
        Actor(self.hosts.len() - 1)
    }

    /// Where an actor listens.
    pub(super) fn address(actor: Actor) -> SocketAddr {
        ([127, 0, 0, 1], actor.0 as u16).into()
    }

    /// The next thing that concerns somebody; `None`: nothing will ever happen again.
    pub(super) fn next(&mut self) -> Option<Occurrence> {
        loop {
            let Reverse(Due { at, what, .. }) = self.due.pop()?;
            self.now = at;
            match what {
                Planned::Delivery(wire, end) => {
                    if let Some(arrived) = self.deliver(wire, end) {
                        return Some(arrived);
                    }
                }
                Planned::Timer(actor, timer) => {
                    let host = &mut self.hosts[actor.0];
                    match host {
                        Host { dead: true, .. } => {}
                        Host { stopped: 1.., missed, .. } => missed.push(timer),
                        _ => return Some(Occurrence::Timer(actor, timer)),
                    }
                }
                Planned::Exited(actor, how) => return Some(Occurrence::Exited(actor, how)),
                Planned::Fault(fault) => return Some(Occurrence::Fault(fault)),
                Planned::Relief(actor, trouble) => self.relieve(actor, trouble),
            }
        }
    }

    fn deliver(&mut self, wire: Wire, end: usize) -> Option<Occurrence> {
        let Ends { actors, streams } = &mut self.wires[wire.0];
        let (to, from) = (actors[end], actors[1 - end]);
        let stream = &mut streams[end];
        if stream.held || self.hosts[to.0].stopped > 0 || self.hosts[to.0].cut > 0 || self.hosts[from.0].cut > 0 {
            stream.stalled += 1;
            return None;
        }
        let parcel = stream.parcels.pop_front()?;
        let unread = stream.unread || self.hosts[to.0].dead;
        (!unread).then_some(Occurrence::Arrived(to, wire, parcel))
    }

    pub(super) fn wake(&mut self, actor: Actor, after: Duration, timer: Timer) {
        self.plan(self.now + after, Planned::Timer(actor, timer));
    }

    pub(super) fn fault(&mut self, at: Duration, fault: usize) {
        self.plan(at.max(self.now), Planned::Fault(fault));
    }

    /// Whoever listens there says [`Parcel::Welcome`], or the connection ends.
    pub(super) fn dial(&mut self, from: Actor, hello: ProcessId, to: SocketAddr, deadline: Duration) -> Wire {
        let wire = Wire(self.wires.len());
        let to = Actor(usize::from(to.port()));
        self.wires.push(Ends { actors: [from, to], streams: Default::default() });
        self.hosts[from.0].wires.push(wire);
        self.hosts[to.0].wires.push(wire);
        if self.hosts[to.0].dead {
            // Nobody listens there.
            self.send_to(wire, 0, Parcel::End);
        } else {
            self.send_to(wire, 1, Parcel::Hello(hello));
        }
        self.wake(from, deadline, Timer::Dialled(wire));
        wire
    }

    pub(super) fn welcome(&mut self, by: Actor, wire: Wire) {
        let end = self.other_end(by, wire);
        self.send_to(wire, end, Parcel::Welcome);
    }

    pub(super) fn send(&mut self, from: Actor, wire: Wire, message: Message) {
        let end = self.other_end(from, wire);
        self.send_to(wire, end, Parcel::Message(message));
    }

    /// Parcels on their way to the other end.
    pub(super) fn under_way(&self, from: Actor, wire: Wire) -> usize {
        self.wires[wire.0].streams[self.other_end(from, wire)].parcels.len()
    }

    /// The reader of a connection does not read it any more, and keeps it.
    pub(super) fn hold(&mut self, reader: Actor, wire: Wire) {
        let end = 1 - self.other_end(reader, wire);
        self.wires[wire.0].streams[end].held = true;
    }

    /// The other end.
    pub(super) fn peer(&self, of: Actor, wire: Wire) -> Actor {
        self.wires[wire.0].actors[self.other_end(of, wire)]
    }

    /// Ends our direction, after what was sent.
    pub(super) fn finish(&mut self, by: Actor, wire: Wire) {
        let end = self.other_end(by, wire);
        self.send_to(wire, end, Parcel::End);
    }

    /// Ends both directions.
    pub(super) fn close(&mut self, by: Actor, wire: Wire) {
        self.finish(by, wire);
        let end = self.other_end(by, wire);
        self.wires[wire.0].streams[1 - end].unread = true;
    }

    /// Both ends lose the connection, and what was under way.
    pub(super) fn tear(&mut self, wire: Wire) {
        for end in [0, 1] {
            let stream = &mut self.wires[wire.0].streams[end];
            if !stream.ended {
                // Deliveries that are planned find nothing.
                stream.parcels.clear();
                self.send_to(wire, end, Parcel::End);
            }
        }
    }

    /// An open connection of an actor, any.
    pub(super) fn any_wire(&mut self, of: Actor) -> Option<Wire> {
        let is_open = |wire: &&Wire| self.wires[wire.0].streams.iter().all(|stream| !stream.ended);
        let open: Vec<_> = self.hosts[of.0].wires.iter().filter(is_open).copied().collect();
        (!open.is_empty()).then(|| *self.dice.choose(&open))
    }

    /// The end of a process, by itself or by force.
    pub(super) fn exit(&mut self, actor: Actor, how: &'static str) {
        if std::mem::replace(&mut self.hosts[actor.0].dead, true) {
            return;
        }
        for wire in std::mem::take(&mut self.hosts[actor.0].wires) {
            self.finish(actor, wire);
        }
        let after = self.dice.between(EXIT_DELAY[0], EXIT_DELAY[1]);
        self.plan(self.now + after, Planned::Exited(actor, how));
    }

    pub(super) fn is_dead(&self, actor: Actor) -> bool {
        self.hosts[actor.0].dead
    }

    /// Something is the matter with a process or its connections, for so long.
    pub(super) fn trouble(&mut self, actor: Actor, trouble: Trouble, lasts: Duration) {
        *self.count(actor, trouble) += 1;
        self.plan(self.now + lasts, Planned::Relief(actor, trouble));
    }

    fn relieve(&mut self, actor: Actor, trouble: Trouble) {
        let count = self.count(actor, trouble);
        *count -= 1;
        if *count > 0 {
            return;
        }
        if trouble == Trouble::Stopped {
            for timer in std::mem::take(&mut self.hosts[actor.0].missed) {
                self.plan(self.now, Planned::Timer(actor, timer));
            }
        }
        for wire in 0..self.wires.len() {
            if self.wires[wire].actors.contains(&actor) {
                for end in [0, 1] {
                    for _ in 0..std::mem::take(&mut self.wires[wire].streams[end].stalled) {
                        self.plan(self.now, Planned::Delivery(Wire(wire), end));
                    }
                }
            }
        }
    }

    fn count(&mut self, actor: Actor, trouble: Trouble) -> &mut u32 {
        match trouble {
            Trouble::Stopped => &mut self.hosts[actor.0].stopped,
            Trouble::Cut => &mut self.hosts[actor.0].cut,
        }
    }

    fn other_end(&self, of: Actor, wire: Wire) -> usize {
        usize::from(self.wires[wire.0].actors[0] == of)
    }

    fn send_to(&mut self, wire: Wire, end: usize, parcel: Parcel) {
        let [least, most] = DELAY;
        let delay = self.dice.between(least, most) * if self.dice.chance(1) { SPIKE } else { 1 };
        let stream = &mut self.wires[wire.0].streams[end];
        if stream.ended {
            return;
        }
        stream.ended = matches!(parcel, Parcel::End);
        stream.parcels.push_back(parcel);
        self.longest = self.longest.max(stream.parcels.len());
        stream.last = stream.last.max(self.now + delay);
        let at = stream.last;
        self.plan(at, Planned::Delivery(wire, end));
    }

    fn plan(&mut self, at: Duration, what: Planned) {
        self.planned += 1;
        self.due.push(Reverse(Due { at, number: self.planned, what }));
    }
}

impl PartialEq for Due {
    fn eq(&self, other: &Self) -> bool {
        self.number == other.number
    }
}

impl Eq for Due {}

impl PartialOrd for Due {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Due {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        (self.at, self.number).cmp(&(other.at, other.number))
    }
}
