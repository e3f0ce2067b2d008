//! A node's shell in virtual time: the real state, what `node/mod.rs` does around it, and a tracer that only takes its
//! time.

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use super::child::{BADLY, CONNECT_DEADLINE, Child, WELL};
use super::fake_tracer;
use super::network::{Message, Network, Parcel, Timer, Wire};
use crate::ids::{Attempt, TileId};
use crate::machine::specification::MemorySize;
use crate::picture::Pixels;
use crate::processes::manager::process::{Command, Report};
use crate::processes::node::tiles::{Action, Event, Job, Tiles, Traced};
use crate::protocol::control::{NodeCommand, NodeConfiguration, NodeReport, Packets};
use crate::protocol::image::{ImageReply, TilePixels};
use crate::protocol::mac::Mac;
use crate::protocol::work::WorkRequest;
use crate::tracer::simd::Simd;

/// As the shell's.
const ACKNOWLEDGE_DEADLINE: Duration = Duration::from_secs(30);
const BUS_DEADLINE: Duration = Duration::from_secs(10);
const LEAVE_DEADLINE: Duration = Duration::from_secs(25);

#[derive(Debug)]
pub(super) struct Node {
    pub(super) child: Child,
    /// From now on what it renders is wrong.
    pub(super) corrupt: bool,
    configuration: Option<Box<NodeConfiguration>>,
    /// Once the master has let it in.
    state: Option<Tiles>,
    master: Option<Wire>,
    bus: Option<Wire>,
    display: DisplayLink,
    /// The tracer has the database.
    ready: bool,
    /// What is said to it before it has a state.
    early: VecDeque<NodeCommand>,
    jobs: VecDeque<Job>,
    tracing: Option<Job>,
    /// When what the display owes is overdue.
    late: Duration,
}

#[derive(Clone, Copy, Debug)]
struct DisplayLink {
    address: Option<SocketAddr>,
    wire: Option<Wire>,
    reached: bool,
    /// How often it was to be dialled: a timer of an earlier time does not count.
    dialled: u64,
}

impl Node {
    pub(super) fn new(child: Child) -> Self {
        Self {
            child,
            corrupt: false,
            configuration: None,
            state: None,
            master: None,
            bus: None,
            display: DisplayLink { address: None, wire: None, reached: false, dialled: 0 },
            ready: false,
            early: VecDeque::new(),
            jobs: VecDeque::new(),
            tracing: None,
            late: Duration::ZERO,
        }
    }

    pub(super) fn arrived(&mut self, network: &mut Network, wire: Wire, parcel: Parcel) {
        let wire = Some(wire);
        match parcel {
            Parcel::Message(Message::Command(Command::Node(command))) => self.command(network, command),
            Parcel::Welcome if wire == self.master => self.start(network),
            Parcel::Welcome if wire == self.display.wire => {
                self.display.reached = true;
                self.handle(network, Event::DisplayReached);
            }
            // The database, in one piece.
            Parcel::Welcome if wire == self.bus => self.fetch(network, TileId(0), Attempt(0), 0, 0),
            Parcel::Message(Message::Data) if wire == self.bus => self.data(network),
            Parcel::Message(Message::Job { tile, attempt, permit }) if wire == self.master => {
                self.handle(network, Event::Job { tile, attempt, permit });
            }
            Parcel::Message(Message::Reply(reply)) if wire == self.display.wire => match reply {
                ImageReply::Acknowledged { tile, attempt, receipt } => {
                    self.handle(network, Event::Acknowledged { tile, attempt, receipt });
                }
                ImageReply::Refused(why) => self.fail(network, format!("the display refused a tile: {why}")),
            },
            Parcel::End if wire == self.master => self.fail(network, "the master left".to_owned()),
            Parcel::End if wire == self.bus => self.fail(network, "tracer: the bus left".to_owned()),
            Parcel::End if wire == self.display.wire => self.lose_display(network),
            _ => {}
        }
    }

    pub(super) fn timer(&mut self, network: &mut Network, timer: Timer) {
        match timer {
            Timer::Traced => self.traced(network),
            Timer::Redial(dialled) if dialled == self.display.dialled => {
                self.display.wire = self
                    .display
                    .address
                    .map(|display| network.dial(self.child.me, self.child.id, display, CONNECT_DEADLINE));
            }
            Timer::Dialled(wire) => {
                let wire = Some(wire);
                if (wire == self.master && self.state.is_none()) || (wire == self.bus && !self.ready) {
                    self.fail(network, "nobody answered in time".to_owned());
                } else if wire == self.display.wire && !self.display.reached {
                    self.lose_display(network);
                }
            }
            Timer::Late => self.look_at_display(network),
            Timer::Leave => self.has_left(network),
            _ => {}
        }
    }

    fn command(&mut self, network: &mut Network, command: NodeCommand) {
        match (command, &self.configuration, self.state.is_some()) {
            (NodeCommand::Configure(configuration), None, _) => {
                self.master = Some(network.dial(self.child.me, self.child.id, configuration.master, CONNECT_DEADLINE));
                self.configuration = Some(configuration);
            }
            (NodeCommand::Finish, None, _) | (NodeCommand::Finish, _, true) => {
                self.child.report(network, Report::Node(NodeReport::Finished));
                self.end(network, WELL);
            }
            // The configuration will say which display there is.
            (NodeCommand::Display(_), None, _) | (NodeCommand::Configure(_) | NodeCommand::Heartbeat, ..) => {}
            (NodeCommand::Display(address), _, true) => self.handle(network, Event::NewDisplay(address)),
            (NodeCommand::Corrupt, ..) => self.corrupt = true,
            (command, Some(_), false) => self.early.push_back(command),
        }
    }

    /// The master has let it in.
    fn start(&mut self, network: &mut Network) {
        let Some(configuration) = &self.configuration else { return };
        let (display, bus) = (configuration.display, configuration.bus);
        self.state = Some(Tiles::new(configuration.tiling, display));
        self.bus = Some(network.dial(self.child.me, self.child.id, bus, BUS_DEADLINE));
        self.late = network.now + ACKNOWLEDGE_DEADLINE;
        network.wake(self.child.me, ACKNOWLEDGE_DEADLINE, Timer::Late);
        self.redial(network, display, Duration::ZERO);
        for command in std::mem::take(&mut self.early) {
            self.command(network, command);
        }
    }

    /// Leaves whatever connection there is, and makes another after a pause.
    fn redial(&mut self, network: &mut Network, display: SocketAddr, pause: Duration) {
        if let Some(wire) = self.display.wire.take() {
            network.close(self.child.me, wire);
        }
        let dialled = self.display.dialled + 1;
        self.display = DisplayLink { address: Some(display), wire: None, reached: false, dialled };
        network.wake(self.child.me, pause, Timer::Redial(dialled));
    }

    fn lose_display(&mut self, network: &mut Network) {
        if let Some(wire) = self.display.wire.take() {
            network.close(self.child.me, wire);
        }
        self.display.reached = false;
        self.handle(network, Event::DisplayLost);
    }

    fn look_at_display(&mut self, network: &mut Network) {
        let Some(state) = &self.state else { return };
        if network.now >= self.late && state.awaits_display() {
            return self.fail(network, "the display owes something for too long".to_owned());
        }
        let after = self.late.saturating_sub(network.now).max(Duration::from_secs(1));
        network.wake(self.child.me, after, Timer::Late);
    }

    fn fetch(&self, network: &mut Network, tile: TileId, attempt: Attempt, fetches: u64, bytes: u64) {
        if let Some(bus) = self.bus {
            network.send(self.child.me, bus, Message::Fetch { tile, attempt, fetches, bytes });
        }
    }

    /// The bus has answered: the database is there, or the tile's last line.
    fn data(&mut self, network: &mut Network) {
        let Some(configuration) = &self.configuration else { return };
        let size = configuration.local_memory.size;
        let Some(job) = self.tracing.take() else {
            let packets = Packets { simd: Simd::Scalar, derived_bytes: 0 };
            self.ready = true;
            return self.handle(network, Event::TracerReady((size == MemorySize::All).then_some(packets)));
        };
        let mut pixels = fake_tracer::pixels(job.tile);
        if let (true, Some(node)) = (self.corrupt, self.child.id.node()) {
            pixels = fake_tracer::corrupt(pixels, node);
        }
        let done = Box::new(fake_tracer::done(job.tile, job.attempt, size));
        self.trace(network);
        self.handle(network, Event::Traced(Traced { done, pixels: Arc::new(pixels), permit: job.permit }));
    }

    /// Begins with the next tile.
    fn trace(&mut self, network: &mut Network) {
        if self.tracing.is_none()
            && let Some(job) = self.jobs.pop_front()
        {
            self.tracing = Some(job);
            network.wake(self.child.me, fake_tracer::takes(job.tile), Timer::Traced);
        }
    }

    /// All but what it waits for.
    fn traced(&mut self, network: &mut Network) {
        let (Some(Job { tile, attempt, .. }), Some(configuration)) = (self.tracing, &self.configuration) else {
            return;
        };
        let (records, lines) = match configuration.local_memory.size {
            MemorySize::All => (0, 0),
            _ => fake_tracer::misses(tile, attempt),
        };
        let bytes = lines * u64::from(configuration.local_memory.line);
        self.fetch(network, tile, attempt, records, bytes);
    }

    fn handle(&mut self, network: &mut Network, event: Event) {
        let (Some(state), false) = (&mut self.state, self.child.is_closing()) else { return };
        let progress = matches!(event, Event::Traced(_) | Event::Acknowledged { .. } | Event::NewDisplay(_));
        if progress || !state.awaits_display() {
            self.late = network.now + ACKNOWLEDGE_DEADLINE;
        }
        let actions = match state.handle(event) {
            Ok(actions) => actions,
            Err(violation) => return self.fail(network, violation.to_string()),
        };
        for action in actions {
            match action {
                Action::TellPackets(packets) => {
                    self.child.report(network, Report::Node(NodeReport::Packets(packets)));
                }
                Action::AskForTile => self.ask(network, WorkRequest::Ready),
                Action::TellDone { done, receipt } => self.ask(network, WorkRequest::Done { done, receipt }),
                Action::Trace(job) => {
                    self.jobs.push_back(job);
                    self.trace(network);
                }
                Action::DialDisplay { address, pause } => self.redial(network, address, pause),
                Action::SendPixels { tile, attempt, permit, pixels } => {
                    self.send_pixels(network, (tile, attempt, permit), &pixels);
                }
            }
        }
        if self.state.as_ref().is_some_and(Tiles::has_left) {
            self.has_left(network);
        }
    }

    /// It is asked to go.
    pub(super) fn leave(&mut self, network: &mut Network) {
        if self.child.is_closing() {
            return;
        }
        if self.state.is_none() {
            return self.has_left(network);
        }
        network.wake(self.child.me, LEAVE_DEADLINE, Timer::Leave);
        self.handle(network, Event::Leave);
    }

    fn has_left(&mut self, network: &mut Network) {
        self.child.report(network, Report::Node(NodeReport::Leaving));
        self.end(network, WELL);
    }

    fn ask(&self, network: &mut Network, request: WorkRequest) {
        if let Some(master) = self.master {
            network.send(self.child.me, master, Message::Work(request));
        }
    }

    fn send_pixels(&self, network: &mut Network, (tile, attempt, permit): (TileId, Attempt, Mac), pixels: &Pixels) {
        let Some(display) = self.display.wire.filter(|_| self.display.reached) else { return };
        let mut bytes = Vec::new();
        pixels.write_bytes(&mut bytes);
        let pixels = TilePixels { tile, attempt, permit, crc32c: crc32c::crc32c(&bytes) };
        network.send(self.child.me, display, Message::Pixels(pixels, bytes));
    }

    fn fail(&mut self, network: &mut Network, why: String) {
        self.child.report(network, Report::Node(NodeReport::Failed(why)));
        self.end(network, BADLY);
    }

    fn end(&mut self, network: &mut Network, how: &'static str) {
        for wire in [self.master.take(), self.bus.take(), self.display.wire.take()].into_iter().flatten() {
            network.close(self.child.me, wire);
        }
        (self.state, self.tracing) = (None, None);
        self.child.close(network, how);
    }
}
