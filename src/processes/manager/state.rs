//! The run as the manager sees it: who lives, who is told what next. No socket, no process, no clock: the shell
//! says what happened and when, and does what is answered.
//!
//! What goes on between the parts is here; a cluster's life is in [`cluster`](super::cluster), the display's in
//! [`display_place`](super::display_place), the way to the end in [`ending`](super::ending).

use std::net::SocketAddr;
use std::time::Duration;

use super::Interrupt;
use super::beginning::Beginning;
use super::cluster::{Cluster, Place};
use super::display_place::DisplayPlace;
use super::ending::{Cause, Ending};
use super::job_queue::{Completion, JobQueue};
use super::ledger::Ledger;
use super::plan::{Addresses, Plan};
use super::process::{Command, Process, ProcessId, Report, Stage};
use super::process_table::{ProcessTable, seconds};
use super::verification::Verification;
use crate::ids::{ClusterId, Epoch, Producer};
use crate::picture::Rect;
use crate::protocol::control::{
    BusCommand, BusReport, DisplayCommand, DisplayReport, MasterCommand, MasterReport, NodeCommand, NodeReport,
};
use crate::protocol::hello::Role;
use crate::protocol::work::TileDone;

/// A node or a cluster is set aside, and a run without a display fails, after so many failures without a tile done in
/// between.
pub(super) const FAILURES_MAX: u32 = 3;
/// More incidents of one process are counted, not kept.
const PROCESS_INCIDENTS_MAX: u32 = 100;

#[derive(Debug)]
pub(in crate::processes) enum Event {
    Connected(ProcessId),
    Report(ProcessId, Report),
    /// The control connection ended; `Some`: by nonsense, and what it was.
    Disconnected(ProcessId, Option<String>),
    /// The process is confirmed dead, or could not be started; how, as the rest of a sentence that begins with its name.
    Exited(ProcessId, String),
    /// This bus has the database.
    Uploaded(ProcessId),
    UploadFailed(ProcessId, String),
    /// What [`Action::Begin`] came to, or why it cannot be done.
    Begun(Result<(), String>),
    /// Somebody was not let in at the manager's port.
    Refused(String),
    Signal(Interrupt),
    Tick,
}

#[derive(Clone, PartialEq, Debug)]
pub(in crate::processes) enum Action {
    /// Put aside what an earlier run left: this one begins in earnest. [`Event::Begun`] is the answer.
    Begin,
    Spawn(ProcessId),
    Tell(ProcessId, Command),
    /// End the control connection.
    HangUp(ProcessId),
    Kill(ProcessId),
    /// Load the database into this bus.
    Upload(ProcessId, SocketAddr),
}

#[derive(Debug)]
pub(super) enum Phase {
    Running,
    Ending(Ending),
    Over(Cause),
}

#[derive(Debug)]
pub(super) struct State {
    pub(super) plan: Plan,
    pub(super) phase: Phase,
    pub(super) beginning: Beginning,
    pub(super) table: ProcessTable,
    pub(super) queue: JobQueue,
    pub(super) ledger: Ledger,
    pub(super) verification: Verification,
    /// By cluster id.
    pub(super) clusters: Vec<Cluster>,
    /// By node id.
    pub(super) places: Vec<Place>,
    pub(super) display: DisplayPlace,
    pub(super) now: Duration,
    pub(super) actions: Vec<Action>,
}

impl State {
    /// The state, and the first actions.
    pub(super) fn start(plan: Plan) -> (Self, Vec<Action>) {
        let mut state = Self {
            queue: JobQueue::new(&plan.run, plan.tiling, plan.cluster),
            ledger: Ledger::default(),
            verification: Verification::new(plan.run.verify, plan.run.seed),
            clusters: plan.cluster.ids().map(Cluster::new).collect(),
            places: vec![Place::default(); usize::from(plan.cluster.all_nodes())],
            display: DisplayPlace::default(),
            plan,
            phase: Phase::Running,
            beginning: Beginning::default(),
            table: ProcessTable::default(),
            now: Duration::ZERO,
            actions: Vec::new(),
        };
        state.spawn(state.display_process());
        state.plan.cluster.ids().for_each(|cluster| state.start_cluster(cluster));
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
            Event::Uploaded(bus) => self.uploaded(bus),
            Event::UploadFailed(bus, why) => self.doom(bus, format!("did not take the database: {why}")),
            Event::Begun(outcome) => self.begun(outcome),
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
            Role::Bus(_) | Role::Display => self.configure_writer(id),
            Role::Master(cluster) => self.configure_master(id, cluster),
            Role::Node(_) => self.configure_nodes(),
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
            | Report::Master(MasterReport::Incident(text)) => {
                process.incidents = process.incidents.saturating_add(1);
                match process.incidents {
                    ..PROCESS_INCIDENTS_MAX => self.ledger.incident(self.now, format!("{id}: {text}")),
                    PROCESS_INCIDENTS_MAX => {
                        self.ledger
                            .incident(self.now, format!("{id}: {text} (its further incidents are counted only)"));
                    }
                    _ => self.ledger.drop_incident(),
                }
            }
            // Whoever is being ended has said its last words that count.
            _ if process.doom.is_some() => {}
            Report::Bus(report) => self.told_by_bus(id, report),
            Report::Master(report) => self.told_by_master(id, report),
            Report::Node(report) => self.told_by_node(id, report),
            Report::Display(report) => self.told_by_display(id, report),
        }
    }

    fn told_by_bus(&mut self, id: ProcessId, report: BusReport) {
        let Role::Bus(cluster) = id.role else { return };
        match report {
            BusReport::Heartbeat | BusReport::Incident(_) => {}
            BusReport::Failed(why) => self.bus_failed(id, &why),
            BusReport::Listening(address) => self.bus_listens(id, cluster, address),
            BusReport::Finished(totals) => {
                self.enter(id, Stage::Finished);
                self.ledger.books.entry((cluster, id.epoch)).or_default().bus = Some(totals);
            }
        }
    }

    fn told_by_node(&mut self, id: ProcessId, report: NodeReport) {
        match report {
            NodeReport::Heartbeat | NodeReport::Incident(_) => {}
            NodeReport::Failed(why) => self.doom(id, format!("failed: {why}")),
            NodeReport::Leaving => {
                if let Some(process) = self.table.get_mut(id) {
                    process.leaving = true;
                }
            }
            NodeReport::Packets(packets) => self.ledger.packets = Some(packets),
            NodeReport::Finished if matches!(self.phase, Phase::Running) => {
                self.doom(id, "reported its end before it was asked to end".to_owned());
            }
            NodeReport::Finished => self.enter(id, Stage::Finished),
        }
    }

    fn told_by_display(&mut self, id: ProcessId, report: DisplayReport) {
        match report {
            DisplayReport::Heartbeat | DisplayReport::Incident(_) => {}
            DisplayReport::Failed(why) => self.doom(id, format!("failed: {why}")),
            DisplayReport::Restored(holdings) => self.restored(&holdings),
            DisplayReport::Listening(address) => self.display_listens(id, address),
            DisplayReport::Compared(comparison) => self.compared(&comparison),
            DisplayReport::Forged { node, epoch, why } => {
                self.condemn(self.producer(node, epoch), &format!("it sent what is not its own: {why}"));
            }
            DisplayReport::Condemned(process, tiles) => self.taken_out(process, &tiles),
            DisplayReport::Holdings { question, holdings } => self.holds(question, holdings),
            DisplayReport::Finished(totals) => {
                self.enter(id, Stage::Finished);
                self.ledger.display = Some(totals);
            }
        }
    }

    fn told_by_master(&mut self, id: ProcessId, report: MasterReport) {
        let Role::Master(cluster) = id.role else { return };
        match report {
            MasterReport::Heartbeat | MasterReport::Incident(_) => {}
            MasterReport::Listening(address) => self.master_listens(id, cluster, address),
            MasterReport::TilesWanted(tiles) => {
                let wanted = &mut self.cluster(cluster).wanted;
                *wanted = wanted.saturating_add(tiles);
            }
            MasterReport::NodeReady { node, epoch } => {
                self.ledger.first_tile.get_or_insert(self.now);
                self.enter(ProcessId { role: Role::Node(node), epoch }, Stage::Working);
            }
            MasterReport::Done { node, epoch, done } => {
                self.done((cluster, id.epoch), self.producer(node, epoch), &done)
            }
            MasterReport::Lost(lost) => {
                for attempt in &lost {
                    self.queue.lose(attempt.tile, attempt.attempt);
                }
                self.ledger.books.entry((cluster, id.epoch)).or_default().lost.extend(lost);
            }
            MasterReport::Returned(grants) => {
                for (tile, attempt) in grants {
                    self.queue.lose(tile, attempt);
                }
            }
            MasterReport::Forged { node, epoch, why } => self.condemn(self.producer(node, epoch), &why),
            MasterReport::Idle { node, epoch } => {
                // Another process of it might do one tile, and wait again.
                let why = format!("asked for no tile for more than {}", seconds(self.plan.run.deadlines.tile));
                self.set_aside(node, &format!("it {why}"));
                self.doom(ProcessId { role: Role::Node(node), epoch }, why);
            }
            MasterReport::Late { node, epoch, tile } => {
                let why = format!("held {tile} for more than {}", seconds(self.plan.run.deadlines.tile));
                self.doom(ProcessId { role: Role::Node(node), epoch }, why);
            }
            MasterReport::Finished(totals) => {
                self.enter(id, Stage::Finished);
                self.ledger.books.entry((cluster, id.epoch)).or_default().master = Some(totals);
            }
        }
    }

    /// The display has a tile's pixels.
    fn done(&mut self, cluster: (ClusterId, Epoch), by: Producer, done: &TileDone) {
        let pixels = self.plan.tiling.rect(done.tile).map_or(0, Rect::pixel_count);
        if let Some(fault) = done.fault(pixels as u64) {
            self.condemn(by, &format!("it reported {} with {fault}", done.tile));
        }
        if self.verification.is_condemned(by) {
            self.ledger.disown(cluster, done);
            self.queue.lose(done.tile, done.attempt);
            return;
        }
        self.ledger.told_done(cluster, done);
        match self.queue.complete(done.tile, done.attempt, by, self.now) {
            Completion::Unknown => {
                self.ledger.incident(self.now, format!("{} of {} is done, but was not out", done.tile, by.node));
            }
            Completion::Extra => {}
            Completion::Accepted => {
                self.ledger.accept(self.now, by, done);
                self.cluster(cluster.0).failures = 0;
                self.display.failures = 0;
                if let Some(place) = self.places.get_mut(usize::from(by.node.0)) {
                    (place.failures, place.departures) = (0, 0);
                }
                if self.verification.accept(done.tile, by) {
                    self.queue.check(done.tile, vec![by.node]);
                }
            }
        }
    }

    /// Nodes that are connected, once everything they need is there.
    pub(super) fn configure_nodes(&mut self) {
        let (Phase::Running, Some(display)) = (&self.phase, self.display.address) else { return };
        let waiting = self.table.nodes().filter(|node| node.stage == Stage::Connected);
        let waiting: Vec<_> = waiting.map(|node| node.id).collect();
        for id in waiting {
            let Role::Node(node) = id.role else { continue };
            let cluster = self.plan.cluster.of(node);
            let Some((bus, master)) = self.cluster(cluster).servers() else { continue };
            let addresses = Addresses { bus, master, display };
            self.tell(id, Command::Node(self.plan.configure_node(cluster, addresses)));
            self.enter(id, Stage::Serving);
        }
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
        let was_expected = process.stage == Stage::Finished;
        let how = if process.leaving { "left, as it was asked to".to_owned() } else { process.doom.unwrap_or(how) };
        let how = format!("{id} {how}");
        match id.role {
            Role::Node(node) => self.node_exited((node, id.epoch), how, was_expected, process.leaving),
            Role::Bus(cluster) | Role::Master(cluster) => self.server_exited(cluster, how, was_expected),
            Role::Display => self.display_exited(how, was_expected),
            Role::Manager => {}
        }
    }

    /// What became possible by the event.
    fn advance(&mut self) {
        self.begin_when_possible();
        if matches!(self.phase, Phase::Running) && self.display.address.is_some() {
            self.hand_out();
            if self.queue.missing() > 0 {
                self.expect_more_of_display();
            } else {
                self.give_up_checks();
                let is_verified = self.verification.is_idle() && matches!(self.phase, Phase::Running);
                if is_verified && self.has_told_all() && !self.verify_latest() {
                    self.end(Cause::Complete);
                }
            }
        }
        self.advance_ending();
    }

    /// Gives masters what they can take.
    fn hand_out(&mut self) {
        for cluster in self.plan.cluster.ids() {
            let Cluster { wanted, .. } = *self.cluster(cluster);
            if wanted == 0 || self.cluster(cluster).servers().is_none() {
                continue;
            }
            let available = self.available(cluster);
            // A master without nodes would give all of it back.
            if available.is_empty() {
                continue;
            }
            let grants = self.queue.grants(cluster, wanted, &available, self.now);
            if !grants.is_empty() {
                self.cluster(cluster).wanted -= grants.len() as u32;
                self.tell_master(cluster, MasterCommand::Tiles(grants));
            }
        }
    }

    /// All tiles are there: the latest one of each process is verified too. `false`: each is, or no node is left to do it.
    fn verify_latest(&mut self) -> bool {
        let latest = self.verification.latest(&self.display.shares);
        if latest.is_empty() {
            return false;
        }
        for (tile, node) in latest {
            self.queue.check(tile, vec![node]);
        }
        self.expect_more_of_display();
        self.give_up_checks();
        true
    }

    /// Tiles whose checks no node is left to do.
    fn give_up_checks(&mut self) {
        for tile in self.queue.give_up_checks(&self.all_available()) {
            if self.verification.give_up(tile) {
                return self.fail(format!("nodes disagree about {tile}, and none is left to settle it"));
            }
            self.ledger.incident(self.now, format!("{tile} is not verified: no other node is left"));
        }
        self.hand_out();
    }

    fn tick(&mut self) {
        self.wait_for_beginning();
        for (id, why) in self.table.overdue(self.now, &self.plan.run.deadlines) {
            self.doom(id, why);
        }
        if self.verification.is_overdue(self.now, self.queue.is_quiet()) {
            self.ask_for_comparisons();
        }
        self.tick_ending();
    }

    pub(super) fn spawn(&mut self, id: ProcessId) {
        let connect_deadline = Some(self.plan.connect_deadline(id.role));
        self.table.insert(Process { connect_deadline, ..Process::spawned(id, self.now) });
        self.actions.push(Action::Spawn(id));
    }

    pub(super) fn enter(&mut self, id: ProcessId, stage: Stage) {
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

    /// Tells a process to come to its end, in its own words.
    pub(super) fn tell_to_finish(&mut self, id: ProcessId) {
        let command = match id.role {
            Role::Bus(cluster) => {
                let book = self.ledger.books.entry((cluster, id.epoch)).or_default();
                let mut lost = [&book.lost[..], &book.disowned].concat();
                // Where the master did not live to tell.
                lost.extend(self.queue.open(cluster));
                Command::Bus(BusCommand::Finish { lost })
            }
            Role::Master(_) => Command::Master(MasterCommand::Finish),
            Role::Node(_) => Command::Node(NodeCommand::Finish),
            Role::Display => Command::Display(DisplayCommand::Finish),
            Role::Manager => return,
        };
        self.tell(id, command);
    }
}
