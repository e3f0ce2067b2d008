//! A node's shell in virtual time: the real state, what `node/mod.rs` does around it, and a tracer that only takes its
//! time.

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::time::Duration;

use super::child::{BADLY, CONNECT_DEADLINE, Child, WELL};
use super::fake_tracer;
use super::network::{Message, Network, Parcel, Timer, Wire};
use crate::ids::{Attempt, TileId};
use crate::processes::manager::process::{Command, Report};
use crate::processes::node::state::{Action, Event, Job, State, Traced};
use crate::protocol::control::{NodeCommand, NodeConfiguration, NodeReport, Packets};
use crate::protocol::image::{ImageReply, TilePixels};
use crate::protocol::work::WorkRequest;
use crate::topology::MemorySize;
use crate::tracer::Pixels;
use crate::tracer::simd::Simd;

/// As the shell's.
const ACKNOWLEDGE_DEADLINE: Duration = Duration::from_secs(30);

#[derive(Debug)]
pub(super) struct Node {
    pub(super) child: Child,
    /// From now on what it renders is wrong.
    pub(super) corrupt: bool,
    configuration: Option<Box<NodeConfiguration>>,
    /// Once master and display have let it in.
    state: Option<State>,
    master: Option<Wire>,
    bus: Option<Wire>,
    display: Option<Wire>,
    display_welcome: bool,
    /// The tracer has the database.
    ready: bool,
    /// What is said to it before it has a state.
    early: VecDeque<NodeCommand>,
    jobs: VecDeque<Job>,
    tracing: Option<Job>,
    /// Sent to a display and not acknowledged, in order.
    unacknowledged: Vec<(TileId, Attempt, Pixels)>,
    /// The number of the acknowledgement that is awaited.
    awaited: u64,
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
            display: None,
            display_welcome: false,
            ready: false,
            early: VecDeque::new(),
            jobs: VecDeque::new(),
            tracing: None,
            unacknowledged: Vec::new(),
            awaited: 0,
        }
    }

    pub(super) fn arrived(&mut self, network: &mut Network, wire: Wire, parcel: Parcel) {
        let wire = Some(wire);
        match parcel {
            Parcel::Message(Message::Command(Command::Node(command))) => self.command(network, command),
            Parcel::Welcome if wire == self.master => self.dial_display(network),
            Parcel::Welcome if wire == self.display => self.display_welcomes(network),
            // The database, in one piece.
            Parcel::Welcome if wire == self.bus => self.fetch(network, TileId(0), Attempt(0), 0, 0),
            Parcel::Message(Message::Data) if wire == self.bus => self.data(network),
            Parcel::Message(Message::Job { tile, attempt }) if wire == self.master => {
                self.handle(network, Event::Job { tile, attempt });
            }
            Parcel::Message(Message::Reply(ImageReply::Acknowledged { tile, attempt })) if wire == self.display => {
                self.unacknowledged.retain(|sent| (sent.0, sent.1) != (tile, attempt));
                self.handle(network, Event::Acknowledged { tile, attempt });
            }
            Parcel::Message(Message::Reply(ImageReply::Refused(why))) if wire == self.display => {
                self.fail(network, format!("the display refused a tile: {why}"));
            }
            Parcel::End if wire == self.master => self.fail(network, "the master left".to_owned()),
            Parcel::End if wire == self.bus => self.fail(network, "tracer: the bus left".to_owned()),
            // The manager will say where the next one is.
            Parcel::End if wire == self.display && self.state.is_some() => self.leave_display(network),
            Parcel::End if wire == self.display => self.fail(network, "the display left".to_owned()),
            _ => {}
        }
    }

    pub(super) fn timer(&mut self, network: &mut Network, timer: Timer) {
        match timer {
            Timer::Traced => self.traced(network),
            Timer::Dialled(wire) => {
                let wire = Some(wire);
                let late = (wire == self.master && self.display.is_none() && self.state.is_none())
                    || (wire == self.display && !self.display_welcome && self.state.is_none())
                    || (wire == self.bus && !self.ready);
                if late {
                    self.fail(network, "nobody answered in time".to_owned());
                } else if wire == self.display && !self.display_welcome {
                    self.leave_display(network);
                }
            }
            Timer::Acknowledgement(awaited) if awaited == self.awaited && self.display_welcome => {
                if self.state.as_ref().is_some_and(State::awaits_display) {
                    self.fail(network, "the display acknowledged nothing for 30 s".to_owned());
                }
            }
            _ => {}
        }
    }

    fn command(&mut self, network: &mut Network, command: NodeCommand) {
        match command {
            NodeCommand::Configure(configuration) if self.configuration.is_none() => {
                self.master = Some(network.dial(self.child.me, self.child.id, configuration.master, CONNECT_DEADLINE));
                self.configuration = Some(configuration);
            }
            NodeCommand::Configure(_) => {}
            NodeCommand::Finish if self.configuration.is_none() || self.state.is_some() => {
                self.child.report(network, Report::Node(NodeReport::Finished));
                self.end(network, WELL);
            }
            NodeCommand::Display(address) if self.state.is_some() => {
                self.leave_display(network);
                self.dial(network, address);
            }
            command => self.early.push_back(command),
        }
    }

    fn dial_display(&mut self, network: &mut Network) {
        if let Some(configuration) = &self.configuration {
            self.dial(network, configuration.display);
        }
    }

    fn dial(&mut self, network: &mut Network, display: SocketAddr) {
        self.display = Some(network.dial(self.child.me, self.child.id, display, CONNECT_DEADLINE));
    }

    fn leave_display(&mut self, network: &mut Network) {
        self.display_welcome = false;
        if let Some(display) = self.display.take() {
            network.close(self.child.me, display);
        }
    }

    fn display_welcomes(&mut self, network: &mut Network) {
        self.display_welcome = true;
        let Some(configuration) = &self.configuration else { return };
        if self.state.is_none() {
            self.state = Some(State::new(configuration.tiling));
            self.bus = Some(network.dial(self.child.me, self.child.id, configuration.bus, CONNECT_DEADLINE));
            for command in std::mem::take(&mut self.early) {
                self.command(network, command);
            }
            return;
        }
        for (tile, attempt, pixels) in &self.unacknowledged {
            self.send_pixels(network, *tile, *attempt, pixels);
        }
        self.await_display(network);
    }

    fn await_display(&mut self, network: &mut Network) {
        self.awaited += 1;
        network.wake(self.child.me, ACKNOWLEDGE_DEADLINE, Timer::Acknowledgement(self.awaited));
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
        self.handle(network, Event::Traced(Traced { done, pixels }));
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
        if matches!(event, Event::Traced(_) | Event::Acknowledged { .. }) {
            self.await_display(network);
        }
        let (Some(state), false) = (&mut self.state, self.child.is_closing()) else { return };
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
                Action::TellDone(done) => self.ask(network, WorkRequest::Done(done)),
                Action::Trace(job) => {
                    self.jobs.push_back(job);
                    self.trace(network);
                }
                Action::SendPixels { tile, attempt, pixels } => {
                    self.send_pixels(network, tile, attempt, &pixels);
                    self.unacknowledged.push((tile, attempt, pixels));
                }
            }
        }
    }

    fn ask(&self, network: &mut Network, request: WorkRequest) {
        if let Some(master) = self.master {
            network.send(self.child.me, master, Message::Work(request));
        }
    }

    fn send_pixels(&self, network: &mut Network, tile: TileId, attempt: Attempt, pixels: &Pixels) {
        let Some(display) = self.display.filter(|_| self.display_welcome) else { return };
        let mut bytes = Vec::new();
        pixels.write_bytes(&mut bytes);
        let pixels = TilePixels { tile, attempt, crc32c: crc32c::crc32c(&bytes) };
        network.send(self.child.me, display, Message::Pixels(pixels, bytes));
    }

    fn fail(&mut self, network: &mut Network, why: String) {
        self.child.report(network, Report::Node(NodeReport::Failed(why)));
        self.end(network, BADLY);
    }

    fn end(&mut self, network: &mut Network, how: &'static str) {
        for wire in [self.master.take(), self.bus.take(), self.display.take()].into_iter().flatten() {
            network.close(self.child.me, wire);
        }
        (self.state, self.tracing) = (None, None);
        self.child.close(network, how);
    }
}
