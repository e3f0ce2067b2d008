//! All processes of a run, and the manager's shell in virtual time: it carries out what the state decides as
//! `manager/shell.rs` does, and reports to it what came of that.

mod evidence;

use std::collections::{HashMap, HashSet};
use std::time::Duration;

use super::bounds;
use super::child::Child;
use super::files::{Files, Journal};
use super::forgery;
use super::host::Host;
use super::memory::Memory;
use super::network::{Actor, MANAGER, Message, Network, Occurrence, Parcel, Timer, Trouble, Wire};
use super::roles::{NoTasks, Process};
use super::schedule::{FaultKind, Interrupt, Schedule};
use super::stopwatch::{Clock, Stopwatch};
use super::test_scene::TestScene;
use super::tracer::{Counts, Tracer};
use crate::processes::bus::control::Control;
use crate::processes::display::state as display;
use crate::processes::manager::process::{Command, ProcessId, Report};
use crate::processes::manager::simulated::Interrupt as Signal;
use crate::processes::manager::simulated::{self, Queues, SimulatedManager};
use crate::processes::manager::state::{Action, Event};
use crate::processes::master::state as master;
use crate::processes::node::state as node;
use crate::protocol::control::{BusReport, DisplayReport, MasterReport, NodeReport};
use crate::protocol::frame::{self, PREFIX_BYTES};
use crate::protocol::hello::Role;
use crate::protocol::memory::{BULK_BYTES_MAX, MemoryReply, MemoryRequest};
use ground::ids::{Address, Attempt, Epoch, NodeId, Producer, RunId, TileId};

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
    scene: &'a TestScene,
    pub(super) network: Network,
    pub(super) manager: SimulatedManager,
    pub(super) watch: Stopwatch,
    pub(super) journal: Journal,
    /// By actor; the manager has none.
    pub(super) processes: Vec<Option<Process>>,
    actors: HashMap<ProcessId, Actor>,
    /// Who holds a place, or held it last.
    occupants: HashMap<Role, Actor>,
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
    pub(super) corrupted: HashSet<Producer>,
    run: RunId,
    interrupted: bool,
    /// Of the run that this one resumes: attempts whose pixels were made up, finite and permitted, and what was condemned.
    pub(super) made_up_before: HashSet<(Producer, TileId, Attempt)>,
    pub(super) condemned_before: HashSet<Producer>,
    /// Forgeries that reached an honest process, and that process.
    pub(super) forgeries: HashSet<(ProcessId, Producer)>,
    /// What honest nodes counted in tiles that were accepted of them, by node.
    pub(super) counted: Vec<Counts>,
    /// The first bound that was exceeded.
    pub(super) excess: Option<String>,
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
    pub kind: FaultKind,
    pub role: Role,
    /// Since the run began.
    pub at: Duration,
    pub took: Duration,
    /// Nothing else was wrong at the time.
    pub alone: bool,
}

impl<'a> World<'a> {
    /// `before`: a run that this one resumes.
    pub(super) fn new(
        schedule: &'a Schedule,
        scene: &'a TestScene,
        clock: Option<Clock>,
        before: Option<&World>,
    ) -> Self {
        let run = if before.is_some() { RunId(simulated::RUN.0 + 1) } else { simulated::RUN };
        let TestScene { database, view, tiling } = scene;
        let image = (view.clone(), *tiling);
        let (manager, actions) = SimulatedManager::start(&schedule.scenario, run, &database.database().header, image);
        let mut world = Self {
            schedule,
            scene,
            network: Network::new(schedule.seed),
            manager,
            watch: Stopwatch::new(clock),
            journal: before.map(|before| Journal::clone(&before.journal)).unwrap_or_default(),
            processes: vec![None],
            actors: HashMap::new(),
            occupants: HashMap::new(),
            expected: HashSet::new(),
            controls: HashMap::new(),
            peers: HashMap::new(),
            uploads: HashMap::new(),
            armed: vec![false; schedule.faults.len()],
            unrecovered: Vec::new(),
            recoveries: Vec::new(),
            troubled_until: Duration::ZERO,
            corrupted: before.map(|before| before.corrupted.clone()).unwrap_or_default(),
            run,
            interrupted: false,
            made_up_before: before.map(World::made_up).unwrap_or_default(),
            // A display that was ended before it was told, or lies, may have left their tiles in the journal.
            condemned_before: before
                .filter(|before| !before.schedule.troubles(Role::Display))
                .map(|before| before.manager.condemned().collect())
                .unwrap_or_default(),
            forgeries: HashSet::new(),
            counted: vec![Default::default(); usize::from(schedule.all_nodes())],
            excess: None,
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
                if let Some(id) = self.processes[actor.0].as_ref().map(|process| process.child().id) {
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
        let condemned = self.manager.condemned().len();
        let done = self.reported_done(&event);
        let now = self.network.now;
        let actions = self.watch.time(|| self.manager.handle(now, event));
        self.act(actions);
        if let (true, Some((node, counted))) = (self.manager.missing() < before, done) {
            let of_node = &mut self.counted[usize::from(node.0)];
            of_node.0.add(&counted.0);
            if let Some(memory) = counted.1 {
                of_node.1.get_or_insert_default().add(&memory);
            }
        }
        let more = self.manager.condemned().len() > condemned;
        if let (Some(Interrupt::Condemned(after)), true) = (self.schedule.interrupt, more) {
            self.interrupt(after);
        }
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
        if let Some(excess) = bounds::of_manager(&queues, self.schedule) {
            self.excess.get_or_insert(excess);
        }
    }

    fn interrupt(&mut self, after: Duration) {
        if !std::mem::replace(&mut self.interrupted, true) {
            self.network.wake(MANAGER, after, Timer::Interrupt);
        }
    }

    pub(super) fn process(&self, id: ProcessId) -> Option<&Process> {
        self.processes.get(self.actors.get(&id)?.0)?.as_ref()
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
                    let deadline = self.schedule.scenario.run.deadlines.startup;
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
        let period = self.schedule.scenario.run.deadlines.heartbeat / HEARTBEATS;
        let child = Child::spawn(&mut self.network, id, heartbeat, period);
        self.actors.insert(id, child.me);
        self.occupants.insert(id.role, child.me);
        self.expected.insert(id);
        let hostile = self.schedule.hostile(id, self.processes.len() as u64);
        self.processes.push(Some(match id.role {
            Role::Bus(_) => Process::Bus(Box::new(Host::new(child, Control::default(), Memory::default(), hostile))),
            Role::Master(cluster) => {
                Process::Master(Box::new(Host::new(child, master::State::new(cluster), NoTasks, hostile)))
            }
            Role::Display => {
                let files = Files { journal: Journal::clone(&self.journal), finished: None };
                Process::Display(Box::new(Host::new(child, display::State::new(self.run), files, hostile)))
            }
            Role::Node(_) | Role::Manager => {
                let tracer = Tracer::new(self.scene.database.clone());
                Process::Node(Box::new(Host::new(child, node::State::new(id.role), tracer, hostile)))
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
                    Ok((MemoryReply::Stored, _)) if sent < self.scene.database.database().bytes().len() => {
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
        let image = self.scene.database.database().bytes();
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
            Timer::Interrupt => self.handle(Event::Signal(Signal::Sigint)),
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
        self.note_forgery(actor, wire, &parcel);
        let Some(process) = &mut self.processes[actor.0] else { return };
        let network = &mut self.network;
        let child = process.child_mut();
        match parcel {
            Parcel::Welcome if child.is_control(wire) => return child.welcomed(network),
            Parcel::End if child.is_control(wire) => return child.orphaned(network),
            _ if child.is_closing() => return,
            _ => {}
        }
        process.arrived(network, &mut self.watch, wire, parcel);
        self.check_bounds(actor);
    }

    fn went_off(&mut self, actor: Actor, timer: Timer) {
        let Some(process) = &mut self.processes[actor.0] else { return };
        if process.child_mut().timer(&mut self.network, timer) || process.child().is_closing() {
            return;
        }
        process.timer(&mut self.network, &mut self.watch, timer);
        self.check_bounds(actor);
    }

    /// Faults are due that wait for so many tiles.
    fn arm_faults(&mut self) {
        let done = self.schedule.tiles() - self.manager.missing();
        if let Some(Interrupt::Tiles(tiles)) = self.schedule.interrupt
            && tiles <= done
        {
            self.interrupt(Duration::ZERO);
        }
        for (i, fault) in self.schedule.faults.iter().enumerate() {
            if !self.armed[i] && fault.tiles <= done {
                self.armed[i] = true;
                self.network.fault(self.network.now + fault.then, i);
            }
        }
    }

    fn fault(&mut self, fault: usize) {
        let fault = self.schedule.faults[fault];
        let Some(&actor) = self.occupants.get(&fault.role) else { return };
        if self.network.is_dead(actor) {
            return;
        }
        match fault.kind {
            FaultKind::Kill => self.network.exit(actor, "died of signal 9"),
            FaultKind::Stop(lasts) => self.network.trouble(actor, Trouble::Stopped, lasts),
            FaultKind::Cut(lasts) => self.network.trouble(actor, Trouble::Cut, lasts),
            FaultKind::Tear => match self.network.any_wire(actor) {
                Some(wire) => self.network.tear(wire),
                None => return,
            },
            FaultKind::Leave => {
                if let Some(process) = &mut self.processes[actor.0] {
                    process.terminate(&mut self.network, &mut self.watch);
                }
                return;
            }
            FaultKind::Corrupt => {
                if let Some(process) = &mut self.processes[actor.0] {
                    process.corrupt(&mut self.network, &mut self.watch);
                    let id = process.child().id;
                    self.corrupted.insert(self.producer(id));
                }
                return;
            }
        }
        self.unrecovered.push(Recovery {
            kind: fault.kind,
            role: fault.role,
            at: self.network.now,
            took: Duration::ZERO,
            alone: self.network.now >= self.troubled_until,
        });
        if let FaultKind::Stop(lasts) | FaultKind::Cut(lasts) = fault.kind {
            self.troubled_until = self.troubled_until.max(self.network.now + lasts);
        }
    }
}
