//! The run as the manager sees it: who lives, who is told what next. No socket, no process, no clock: the shell
//! says what happened and when, and does what is answered.
//!
//! Starting and running are here, the way to the end is in [`ending`](super::ending).

use std::net::SocketAddr;
use std::time::Duration;

use super::Interrupt;
use super::ending::{Cause, Ending};
use super::job_queue::JobQueue;
use super::ledger::Ledger;
use super::plan::{Addresses, Plan};
use super::process::{Command, Process, ProcessId, Report, Stage};
use super::process_table::{ProcessTable, seconds};
use crate::ids::{ClusterId, Epoch, NodeId};
use crate::protocol::control::{
    BusCommand, BusReport, DisplayCommand, DisplayReport, MasterCommand, MasterReport, NodeCommand, NodeReport,
};
use crate::protocol::hello::Role;

/// A node is set aside after so many failures without a tile done in between.
const FAILURES_MAX: u32 = 3;

#[derive(Debug)]
pub(super) enum Event {
    Connected(ProcessId),
    Report(ProcessId, Report),
    /// The control connection ended; `Some`: by nonsense, and what it was.
    Disconnected(ProcessId, Option<String>),
    /// The process is confirmed dead, or could not be started; how, as the rest of a sentence that begins with its name.
    Exited(ProcessId, String),
    /// The bus has the database.
    Uploaded,
    UploadFailed(String),
    /// Somebody was not let in at the manager's port.
    Refused(String),
    Signal(Interrupt),
    Tick,
}

#[derive(Clone, PartialEq, Debug)]
pub(super) enum Action {
    Spawn(ProcessId),
    Tell(ProcessId, Command),
    /// End the control connection.
    HangUp(ProcessId),
    Kill(ProcessId),
    /// Load the database into the bus.
    Upload(SocketAddr),
}

#[derive(Debug)]
pub(super) enum Phase {
    /// Until all servers listen and the bus has the database.
    Starting,
    Running,
    Ending(Ending),
    Over(Cause),
}

#[derive(Debug)]
pub(super) struct State {
    pub(super) plan: Plan,
    pub(super) phase: Phase,
    pub(super) table: ProcessTable,
    pub(super) queue: JobQueue,
    pub(super) ledger: Ledger,
    /// By node id.
    places: Vec<Place>,
    bus: Option<SocketAddr>,
    master: Option<SocketAddr>,
    display: Option<SocketAddr>,
    uploaded: bool,
    pub(super) now: Duration,
    pub(super) actions: Vec<Action>,
}

/// A node's place, which processes hold one after the other.
#[derive(Clone, Copy, Debug, Default)]
struct Place {
    /// Since the last tile done.
    failures: u32,
    set_aside: bool,
}

impl State {
    /// The state, and the first actions.
    pub(super) fn start(plan: Plan) -> (Self, Vec<Action>) {
        let nodes = plan.cluster.nodes;
        let mut state = Self {
            queue: JobQueue::new(&plan.run, plan.tiling, nodes),
            ledger: Ledger::new(nodes),
            places: vec![Place::default(); usize::from(nodes)],
            plan,
            phase: Phase::Starting,
            table: ProcessTable::default(),
            bus: None,
            master: None,
            display: None,
            uploaded: false,
            now: Duration::ZERO,
            actions: Vec::new(),
        };
        let roles = [Role::Bus(ClusterId(0)), Role::Display, Role::Master(ClusterId(0))].into_iter();
        for role in roles.chain((0..nodes).map(|node| Role::Node(NodeId(node)))) {
            state.spawn(ProcessId::first(role));
        }
        let actions = std::mem::take(&mut state.actions);
        (state, actions)
    }

    /// What is to be done about an event, in order. `now` is the time since the run began.
    pub(super) fn handle(&mut self, now: Duration, event: Event) -> Vec<Action> {
        self.now = now;
        match event {
            Event::Connected(id) => self.connected(id),
            Event::Report(id, report) => self.told(id, report),
            Event::Disconnected(id, nonsense) => self.disconnected(id, nonsense),
            Event::Exited(id, how) => self.exited(id, how),
            Event::Uploaded => self.uploaded = true,
            Event::UploadFailed(why) => self.fail(format!("the database cannot be loaded: {why}")),
            Event::Refused(who) => self.ledger.incident(now, who),
            Event::Signal(signal) => self.interrupt(signal),
            Event::Tick => self.tick(),
        }
        self.advance();
        std::mem::take(&mut self.actions)
    }

    /// Why the run ended, once it has.
    pub(super) fn over(&self) -> Option<&Cause> {
        match &self.phase {
            Phase::Over(cause) => Some(cause),
            _ => None,
        }
    }

    fn connected(&mut self, id: ProcessId) {
        let now = self.now;
        let Some(process) = self.table.get_mut(id) else { return };
        process.enter(Stage::Connected, now);
        process.last_sign = now;
        match id.role {
            Role::Bus(_) => self.tell(id, Command::Bus(self.plan.configure_bus(ClusterId(0)))),
            Role::Display => self.tell(id, Command::Display(self.plan.configure_display())),
            Role::Master(_) => self.configure_master(),
            Role::Node(_) => self.configure_node(id),
            Role::Manager => {}
        }
    }

    fn told(&mut self, id: ProcessId, report: Report) {
        let Some(process) = self.table.get_mut(id) else { return };
        process.last_sign = self.now;
        match report {
            Report::Bus(BusReport::Heartbeat)
            | Report::Master(MasterReport::Heartbeat)
            | Report::Node(NodeReport::Heartbeat)
            | Report::Display(DisplayReport::Heartbeat) => {}
            Report::Bus(BusReport::Incident(text))
            | Report::Node(NodeReport::Incident(text))
            | Report::Display(DisplayReport::Incident(text))
            | Report::Master(MasterReport::Incident(text)) => self.ledger.incident(self.now, format!("{id}: {text}")),
            Report::Node(NodeReport::Failed(why)) | Report::Display(DisplayReport::Failed(why)) => {
                self.doom(id, format!("failed: {why}"));
            }
            Report::Node(NodeReport::Packets(packets)) => self.ledger.packets = Some(packets),
            Report::Node(NodeReport::Leaving) => process.leaving = true,
            Report::Node(NodeReport::Finished) => process.enter(Stage::Finished, self.now),
            Report::Bus(BusReport::Listening(address)) => self.bus_listens(id, address),
            Report::Bus(BusReport::Finished(totals)) => {
                process.enter(Stage::Finished, self.now);
                self.ledger.bus = Some(totals);
            }
            Report::Display(DisplayReport::Restored(_) | DisplayReport::Compared(_) | DisplayReport::Revoked(_)) => {}
            Report::Display(DisplayReport::Listening(address)) => {
                process.enter(Stage::Serving, self.now);
                self.display = Some(address);
            }
            Report::Display(DisplayReport::Finished(totals)) => {
                process.enter(Stage::Finished, self.now);
                self.ledger.display = Some(totals);
            }
            Report::Master(report) => self.told_by_master(id, report),
        }
    }

    fn told_by_master(&mut self, id: ProcessId, report: MasterReport) {
        match report {
            MasterReport::Heartbeat | MasterReport::Incident(_) => {}
            MasterReport::Listening(address) => {
                self.enter(id, Stage::Serving);
                self.master = Some(address);
            }
            MasterReport::TilesWanted(tiles) => self.queue.want(tiles),
            MasterReport::NodeReady { node, epoch } => {
                self.ledger.first_tile.get_or_insert(self.now);
                self.enter(ProcessId { role: Role::Node(node), epoch }, Stage::Working);
            }
            MasterReport::Done { node, done, .. } => {
                if self.queue.finish(done.tile, done.attempt) {
                    self.ledger.accept(self.now, node, &done);
                    if let Some(place) = self.places.get_mut(usize::from(node.0)) {
                        place.failures = 0;
                    }
                } else {
                    self.ledger.incident(self.now, format!("{id}: {} of {node} is done, but was not out", done.tile));
                }
            }
            MasterReport::Lost(lost) => {
                for attempt in lost {
                    if self.queue.lose(attempt) {
                        self.ledger.lost.push(attempt);
                    }
                }
            }
            MasterReport::Late { node, epoch, tile } => {
                let why = format!("held {tile} for more than {}", seconds(self.plan.run.deadlines.tile));
                self.doom(ProcessId { role: Role::Node(node), epoch }, why);
            }
            MasterReport::Finished(totals) => {
                self.enter(id, Stage::Finished);
                self.ledger.master = Some(totals);
            }
        }
    }

    fn bus_listens(&mut self, id: ProcessId, address: SocketAddr) {
        self.enter(id, Stage::Serving);
        self.bus = Some(address);
        self.actions.push(Action::Upload(address));
        self.configure_master();
    }

    /// Once it is connected and the bus listens.
    fn configure_master(&mut self) {
        let id = ProcessId::first(Role::Master(ClusterId(0)));
        if let Some(bus) = self.bus {
            self.tell(id, Command::Master(self.plan.configure_master(ClusterId(0), bus)));
        }
    }

    /// Once it is connected and everything it needs is there.
    fn configure_node(&mut self, id: ProcessId) {
        let (Phase::Running, Some(bus), Some(master), Some(display)) =
            (&self.phase, self.bus, self.master, self.display)
        else {
            return;
        };
        let addresses = Addresses { bus, master, display };
        self.tell(id, Command::Node(self.plan.configure_node(ClusterId(0), addresses)));
        self.enter(id, Stage::Serving);
    }

    fn disconnected(&mut self, id: ProcessId, nonsense: Option<String>) {
        let now = self.now;
        let Some(process) = self.table.get_mut(id) else { return };
        process.hung_up = Some(now);
        self.actions.push(Action::HangUp(id));
        if let Some(nonsense) = nonsense {
            self.doom(id, format!("broke the protocol: {nonsense}"));
        }
    }

    fn exited(&mut self, id: ProcessId, how: String) {
        let Some(process) = self.table.remove(id) else { return };
        self.actions.push(Action::HangUp(id));
        let expected = process.stage == Stage::Finished;
        let how = if process.leaving { "left, as it was asked to".to_owned() } else { process.doom.unwrap_or(how) };
        let how = format!("{id} {how}");
        match id.node() {
            Some(node) => {
                self.tell_master(MasterCommand::NodeLost { node, epoch: id.epoch });
                if !expected {
                    self.ledger.incident(self.now, how);
                }
                if matches!(self.phase, Phase::Starting | Phase::Running) {
                    self.replace(node, id.epoch, !process.leaving);
                }
            }
            None if expected => {}
            None => self.fail(how),
        }
    }

    /// A node's process is dead: another one takes its place, unless too many did in a row.
    fn replace(&mut self, node: NodeId, epoch: Epoch, failed: bool) {
        let Some(place) = self.places.get_mut(usize::from(node.0)) else { return };
        place.failures += u32::from(failed);
        if place.failures < FAILURES_MAX {
            return self.spawn(ProcessId { role: Role::Node(node), epoch: Epoch(epoch.0 + 1) });
        }
        place.set_aside = true;
        self.ledger
            .incident(self.now, format!("{node} is set aside: it failed {FAILURES_MAX} times without a tile done"));
        self.queue.set_aside(node);
        self.tell_master(MasterCommand::NodeSetAside { node });
        if self.places.iter().all(|place| place.set_aside) {
            self.end(Cause::NoNodes);
        }
    }

    /// What became possible by the event.
    fn advance(&mut self) {
        if matches!(self.phase, Phase::Starting) && self.uploaded && self.master.is_some() && self.display.is_some() {
            self.phase = Phase::Running;
            let connected = self.table.nodes().filter(|process| process.stage == Stage::Connected);
            let connected: Vec<_> = connected.map(|process| process.id).collect();
            connected.into_iter().for_each(|id| self.configure_node(id));
        }
        if matches!(self.phase, Phase::Running) {
            let grants = self.queue.grants();
            if !grants.is_empty() {
                self.tell_master(MasterCommand::Tiles(grants));
            }
            if self.queue.missing() == 0 {
                self.end(Cause::Complete);
            }
        }
        self.advance_ending();
    }

    fn tick(&mut self) {
        for (id, why) in self.table.overdue(self.now, &self.plan.run.deadlines) {
            self.doom(id, why);
        }
        self.tick_ending();
    }

    fn spawn(&mut self, id: ProcessId) {
        let connect_deadline = Some(self.plan.connect_deadline(id.role));
        self.table.insert(Process { connect_deadline, ..Process::spawned(id, self.now) });
        self.actions.push(Action::Spawn(id));
    }

    fn enter(&mut self, id: ProcessId, stage: Stage) {
        let now = self.now;
        if let Some(process) = self.table.get_mut(id) {
            process.enter(stage, now);
        }
    }

    /// Kills a process; its place is free when it is confirmed dead.
    pub(super) fn doom(&mut self, id: ProcessId, why: String) {
        if let Some(process) = self.table.get_mut(id) {
            process.doom.get_or_insert(why);
            self.actions.push(Action::Kill(id));
        }
    }

    /// Ends a process that is not needed any more.
    pub(super) fn dismiss(&mut self, id: ProcessId) {
        self.enter(id, Stage::Finished);
        self.doom(id, "was ended with the run".to_owned());
    }

    pub(super) fn tell(&mut self, id: ProcessId, command: Command) {
        if self.table.get_mut(id).is_some_and(|process| process.can_be_told()) {
            self.actions.push(Action::Tell(id, command));
        }
    }

    /// A master that does not serve yet has handed nothing out: there is nothing to tell it.
    fn tell_master(&mut self, command: MasterCommand) {
        if self.table.holder(Role::Master(ClusterId(0))).is_some_and(|master| master.stage == Stage::Serving) {
            self.tell(ProcessId::first(Role::Master(ClusterId(0))), Command::Master(command));
        }
    }

    /// Tells a process to come to its end, in its own words.
    pub(super) fn tell_to_finish(&mut self, id: ProcessId) {
        let command = match id.role {
            Role::Bus(_) => Command::Bus(BusCommand::Finish { lost: self.ledger.lost.clone() }),
            Role::Master(_) => Command::Master(MasterCommand::Finish),
            Role::Node(_) => Command::Node(NodeCommand::Finish),
            Role::Display => Command::Display(DisplayCommand::Finish),
            Role::Manager => return,
        };
        self.tell(id, command);
    }
}
