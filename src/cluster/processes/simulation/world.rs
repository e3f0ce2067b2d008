//! All processes of a run, and the manager's shell in virtual time: it carries out what the state decides as
//! `manager/shell.rs` does, and tells it what came of that.

use std::collections::{HashMap, HashSet};
use std::time::Duration;

use super::child::Child;
use super::files::{Files, Journal};
use super::host::Host;
use super::memory::Memory;
use super::network::{Actor, MANAGER, Message, Network, Occurrence, Parcel, Timer, Trouble, Wire};
use super::roles::{Body, NoTasks};
use super::scenery::Scenery;
use super::schedule::{Schedule, What};
use super::stopwatch::{Clock, Stopwatch};
use super::tracer::Tracer;
use crate::processes::bus::control::Control;
use crate::processes::display::state as display;
use crate::processes::manager::process::{Command, ProcessId, Report};
use crate::processes::manager::rehearsal::{self, Queues, Rehearsal};
use crate::processes::manager::state::{Action, Event};
use crate::processes::master::state as master;
use crate::processes::node::state as node;
use crate::protocol::control::{BusReport, DisplayReport, MasterReport, NodeReport};
use crate::protocol::frame::{self, PREFIX_BYTES};
use crate::protocol::hello::Role;
use crate::protocol::memory::{BULK_BYTES_MAX, MemoryReply, MemoryRequest};
use ground::ids::{Address, Epoch};

/// As in the manager's shell and its port.
const TICK: Duration = Duration::from_millis(50);
const COMMANDS_MAX: usize = 256;
/// A run that goes on for longer hangs.
const DEADLINE: Duration = Duration::from_secs(6 * 3600);
const STEPS_MAX: u64 = 20_000_000;
const HEARTBEATS: u32 = 4;
const MYSELF: ProcessId = ProcessId { role: Role::Manager, epoch: Epoch(0) };

pub(super) struct World<'a> {
    schedule: &'a Schedule,
    scenery: &'a Scenery,
    pub(super) network: Network,
    pub(super) manager: Rehearsal,
    pub(super) watch: Stopwatch,
    pub(super) journal: Journal,
    /// By actor; the manager has none.
    pub(super) bodies: Vec<Option<Body>>,
    actors: HashMap<ProcessId, Actor>,
    /// Who holds a place, or held it last.
    holders: HashMap<Role, Actor>,
    /// Spawned and not connected yet.
    expected: HashSet<ProcessId>,
    controls: HashMap<ProcessId, Wire>,
    peers: HashMap<Wire, ProcessId>,
    uploads: HashMap<Wire, Upload>,
    armed: Vec<bool>,
    /// When faults happened after which no tile has been done yet.
    unrecovered: Vec<Recovery>,
    pub(super) recoveries: Vec<Recovery>,
    /// When the last stop or cut so far is over.
    troubled_until: Duration,
    /// Processes whose tiles are wrong.
    pub(super) corrupted: HashSet<ProcessId>,
    /// The most that waited at any time.
    pub(super) most: Queues,
    /// Most tiles that a master had, queued or handed out, per node.
    pub(super) tiles_a_node: usize,
}

/// Of the database into a bus.
#[derive(Clone, Copy, Debug)]
struct Upload {
    bus: ProcessId,
    /// Bytes that were sent.
    sent: usize,
}

/// From a fault to the next tile that was done.
#[derive(Clone, Copy, Debug)]
pub struct Recovery {
    pub what: What,
    pub role: Role,
    /// Since the run began.
    pub at: Duration,
    pub took: Duration,
    /// Nothing else was wrong at the time.
    pub alone: bool,
}

impl<'a> World<'a> {
    pub(super) fn new(schedule: &'a Schedule, scenery: &'a Scenery, clock: Option<Clock>) -> Self {
        let Scenery { database, view, tiling } = scenery;
        let (manager, actions) = Rehearsal::start(&schedule.play, &database.database().header, view.clone(), *tiling);
        let mut world = Self {
            schedule,
            scenery,
            network: Network::new(schedule.seed),
            manager,
            watch: Stopwatch::new(clock),
            journal: Journal::default(),
            bodies: vec![None],
            actors: HashMap::new(),
            holders: HashMap::new(),
            expected: HashSet::new(),
            controls: HashMap::new(),
            peers: HashMap::new(),
            uploads: HashMap::new(),
            armed: vec![false; schedule.faults.len()],
            unrecovered: Vec::new(),
            recoveries: Vec::new(),
            troubled_until: Duration::ZERO,
            corrupted: HashSet::new(),
            most: Queues::default(),
            tiles_a_node: 0,
        };
        world.act(actions);
        world.arm_faults();
        world.network.wake(MANAGER, Duration::ZERO, Timer::Tick);
        world
    }

    /// To the end of the run, if it has one.
    pub(super) fn run(&mut self) {
        let mut steps = 0;
        while self.manager.end().is_none() && self.network.now < DEADLINE && steps < STEPS_MAX && self.step() {
            steps += 1;
        }
    }

    /// The next thing happens. `false`: nothing can.
    fn step(&mut self) -> bool {
        match self.network.next() {
            Some(Occurrence::Arrived(MANAGER, wire, parcel)) => self.receive(wire, parcel),
            Some(Occurrence::Arrived(actor, wire, parcel)) => self.arrived(actor, wire, parcel),
            Some(Occurrence::Timer(MANAGER, timer)) => self.timer(timer),
            Some(Occurrence::Timer(actor, timer)) => self.went_off(actor, timer),
            Some(Occurrence::Exited(actor, how)) => {
                if let Some(id) = self.bodies[actor.0].as_ref().map(|body| body.child().id) {
                    self.handle(Event::Exited(id, how.to_owned()));
                }
            }
            Some(Occurrence::Fault(fault)) => self.fault(fault),
            None => return false,
        }
        true
    }

    fn handle(&mut self, event: Event) {
        let before = self.manager.missing();
        let now = self.network.now;
        let actions = self.watch.time(|| self.manager.handle(now, event));
        self.act(actions);
        if self.manager.missing() < before {
            let alone = self.unrecovered.len() == 1;
            for mut recovery in self.unrecovered.drain(..) {
                recovery.took = now - recovery.at;
                recovery.alone &= alone;
                self.recoveries.push(recovery);
            }
        }
        self.arm_faults();
        let queues = self.manager.queues();
        let most = &mut self.most;
        (most.out, most.checks) = (most.out.max(queues.out), most.checks.max(queues.checks));
        (most.wanted, most.processes) = (most.wanted.max(queues.wanted), most.processes.max(queues.processes));
    }

    fn act(&mut self, actions: Vec<Action>) {
        for action in actions {
            match action {
                Action::Spawn(id) => self.spawn(id),
                Action::Tell(id, command) => self.tell(id, command),
                Action::HangUp(id) => {
                    self.expected.remove(&id);
                    if let Some(wire) = self.controls.remove(&id) {
                        self.network.finish(MANAGER, wire);
                    }
                }
                Action::Kill(id) => self.kill(id),
                // There are no files.
                Action::Begin => {}
                Action::Upload(id, address) => {
                    let deadline = self.schedule.play.run.deadlines.startup;
                    let wire = self.network.dial(MANAGER, MYSELF, address, deadline);
                    self.uploads.insert(wire, Upload { bus: id, sent: 0 });
                }
            }
        }
    }

    fn spawn(&mut self, id: ProcessId) {
        let heartbeat = match id.role {
            Role::Bus(_) => Report::Bus(BusReport::Heartbeat),
            Role::Master(_) => Report::Master(MasterReport::Heartbeat),
            Role::Display => Report::Display(DisplayReport::Heartbeat),
            Role::Node(_) | Role::Manager => Report::Node(NodeReport::Heartbeat),
        };
        let period = self.schedule.play.run.deadlines.heartbeat / HEARTBEATS;
        let child = Child::spawn(&mut self.network, id, heartbeat, period);
        self.actors.insert(id, child.me);
        self.holders.insert(id.role, child.me);
        self.expected.insert(id);
        let hostile = self.schedule.hostile(id, self.bodies.len() as u64);
        self.bodies.push(Some(match id.role {
            Role::Bus(_) => Body::Bus(Box::new(Host::new(child, Control::default(), Memory::default(), hostile))),
            Role::Master(cluster) => {
                Body::Master(Box::new(Host::new(child, master::State::new(cluster), NoTasks, hostile)))
            }
            Role::Display => {
                let files = Files { journal: Journal::clone(&self.journal), finished: None };
                Body::Display(Box::new(Host::new(child, display::State::new(rehearsal::RUN), files, hostile)))
            }
            Role::Node(_) | Role::Manager => {
                let tracer = Tracer::new(self.scenery.database.clone());
                Body::Node(Box::new(Host::new(child, node::State::new(id.role), tracer, hostile)))
            }
        }));
    }

    fn tell(&mut self, id: ProcessId, command: Command) {
        match self.controls.get(&id) {
            Some(&wire) if self.network.under_way(MANAGER, wire) < COMMANDS_MAX => {
                self.network.send(MANAGER, wire, Message::Command(command));
            }
            _ => self.kill(id),
        }
    }

    fn kill(&mut self, id: ProcessId) {
        if let Some(&actor) = self.actors.get(&id) {
            self.network.exit(actor, "died of signal 9");
        }
    }

    /// What comes for the manager.
    fn receive(&mut self, wire: Wire, parcel: Parcel) {
        if let Some(&upload) = self.uploads.get(&wire) {
            return self.receive_upload(wire, upload, &parcel);
        }
        match parcel {
            Parcel::Hello(id) if self.expected.remove(&id) => {
                self.network.welcome(MANAGER, wire);
                self.controls.insert(id, wire);
                self.peers.insert(wire, id);
                self.handle(Event::Connected(id));
            }
            Parcel::Hello(id) => {
                self.network.close(MANAGER, wire);
                self.handle(Event::Refused(format!("{id} is not expected")));
            }
            Parcel::Message(Message::Report(report)) => {
                if let Some(&id) = self.peers.get(&wire) {
                    self.handle(Event::Report(id, report));
                }
            }
            Parcel::End => {
                if let Some(id) = self.peers.remove(&wire) {
                    self.handle(Event::Disconnected(id, None));
                }
            }
            _ => {}
        }
    }

    fn receive_upload(&mut self, wire: Wire, Upload { bus, sent }: Upload, parcel: &Parcel) {
        let event = match parcel {
            Parcel::Welcome => return self.upload(wire, bus, 0),
            Parcel::Message(Message::Frame(reply)) => {
                match frame::decode(reply.get(PREFIX_BYTES..).unwrap_or_default()) {
                    Ok((MemoryReply::Stored, _)) if sent < self.scenery.database.database().bytes().len() => {
                        return self.upload(wire, bus, sent);
                    }
                    Ok((MemoryReply::Stored, _)) => Event::Uploaded(bus),
                    reply => Event::UploadFailed(bus, format!("{reply:?}")),
                }
            }
            Parcel::End => Event::UploadFailed(bus, "closed the connection".to_owned()),
            _ => return,
        };
        self.network.close(MANAGER, wire);
        self.uploads.remove(&wire);
        self.handle(event);
    }

    /// The next piece of the database, from this byte on.
    fn upload(&mut self, wire: Wire, bus: ProcessId, from: usize) {
        let image = self.scenery.database.database().bytes();
        let to = image.len().min(from + BULK_BYTES_MAX as usize);
        let store = MemoryRequest::Store { address: Address(from as u64) };
        if let Ok(frame) = frame::encode(&store, &image[from..to]) {
            self.network.send(MANAGER, wire, Message::Frame(frame));
        }
        self.uploads.insert(wire, Upload { bus, sent: to });
    }

    fn timer(&mut self, timer: Timer) {
        match timer {
            Timer::Tick => {
                self.network.wake(MANAGER, TICK, Timer::Tick);
                self.handle(Event::Tick);
            }
            Timer::Dialled(wire) => {
                if let Some(Upload { bus, .. }) = self.uploads.remove(&wire) {
                    self.network.close(MANAGER, wire);
                    self.handle(Event::UploadFailed(bus, "does not answer".to_owned()));
                }
            }
            _ => {}
        }
    }

    /// What comes for a child.
    fn arrived(&mut self, actor: Actor, wire: Wire, parcel: Parcel) {
        let Some(body) = &mut self.bodies[actor.0] else { return };
        let network = &mut self.network;
        let child = body.child_mut();
        match parcel {
            Parcel::Welcome if child.is_control(wire) => return child.welcomed(network),
            Parcel::End if child.is_control(wire) => return child.orphaned(network),
            _ if child.is_closing() => return,
            _ => {}
        }
        body.arrived(network, &mut self.watch, wire, parcel);
        self.look_at_master(actor);
    }

    fn went_off(&mut self, actor: Actor, timer: Timer) {
        let Some(body) = &mut self.bodies[actor.0] else { return };
        if body.child_mut().timer(&mut self.network, timer) || body.child().is_closing() {
            return;
        }
        body.timer(&mut self.network, &mut self.watch, timer);
        self.look_at_master(actor);
    }

    fn look_at_master(&mut self, actor: Actor) {
        if let Some(Body::Master(master)) = &self.bodies[actor.0] {
            let tiles = master.machine.tiles().div_ceil(usize::from(self.schedule.play.nodes));
            self.tiles_a_node = self.tiles_a_node.max(tiles);
        }
    }

    /// Faults are due that wait for so many tiles.
    fn arm_faults(&mut self) {
        let done = self.schedule.tiles() - self.manager.missing();
        for (i, fault) in self.schedule.faults.iter().enumerate() {
            if !self.armed[i] && fault.tiles <= done {
                self.armed[i] = true;
                self.network.fault(self.network.now + fault.then, i);
            }
        }
    }

    fn fault(&mut self, fault: usize) {
        let fault = self.schedule.faults[fault];
        let Some(&actor) = self.holders.get(&fault.role) else { return };
        if self.network.is_dead(actor) {
            return;
        }
        match fault.what {
            What::Kill => self.network.exit(actor, "died of signal 9"),
            What::Stop(lasts) => self.network.trouble(actor, Trouble::Stopped, lasts),
            What::Cut(lasts) => self.network.trouble(actor, Trouble::Cut, lasts),
            What::Tear => match self.network.any_wire(actor) {
                Some(wire) => self.network.tear(wire),
                None => return,
            },
            What::Leave => {
                if let Some(body) = &mut self.bodies[actor.0] {
                    body.terminate(&mut self.network, &mut self.watch);
                }
                return;
            }
            What::Corrupt => {
                if let Some(body) = &mut self.bodies[actor.0] {
                    body.corrupt(&mut self.network, &mut self.watch);
                    self.corrupted.insert(body.child().id);
                }
                return;
            }
        }
        self.unrecovered.push(Recovery {
            what: fault.what,
            role: fault.role,
            at: self.network.now,
            took: Duration::ZERO,
            alone: self.network.now >= self.troubled_until,
        });
        if let What::Stop(lasts) | What::Cut(lasts) = fault.what {
            self.troubled_until = self.troubled_until.max(self.network.now + lasts);
        }
    }
}
