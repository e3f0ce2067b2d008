//! The run as the manager sees it: which processes live, what each of them does next. No socket, no process, no clock: the shell
//! says what happened and when, and does what is answered.
//!
//! Each part owns its state and acts through [`supervision`]. Here events are led to the parts, and what goes on between
//! them is done, one step after the other.

mod beginning;
mod clusters;
mod display;
mod ending;
mod incident_log;
mod process_table;
mod reports;
mod supervision;
mod tiles;

#[cfg(test)]
mod beginning_tests;
#[cfg(test)]
mod display_tests;
#[cfg(test)]
mod ending_tests;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod verification_tests;

use std::time::Duration;

use self::beginning::Beginning;
use self::clusters::Clusters;
use self::display::Display;
use self::ending::Ending;
use self::process_table::seconds;
use self::supervision::Supervision;
use self::tiles::{Completion, Tiles, Verdict};
use super::cause::{Cause, Interrupt};
pub(in crate::processes) use super::event::{Action, Event};
use super::plan::Plan;
use super::process::{ProcessId, Report, Stage};
use crate::protocol::control::{
    BusReport, Comparison, DisplayReport, Holdings, MasterReport, NodeReport, PRODUCERS_MAX,
};
use crate::protocol::hello::Role;
use crate::protocol::work::TileDone;
use ground::ids::{ClusterId, Epoch, NodeId, Producer};
use trace::picture::Rect;

/// How often deadlines are looked at.
const TICK: Duration = Duration::from_millis(50);

#[derive(Debug)]
pub(super) struct State {
    pub(super) supervision: Supervision,
    pub(super) tiles: Tiles,
    pub(super) clusters: Clusters,
    pub(super) display: Display,
    pub(super) ending: Ending,
    beginning: Beginning,
    next_tick: Duration,
}

impl State {
    /// The state, and the first actions.
    pub(super) fn start(plan: Plan) -> (Self, Vec<Action>) {
        let mut state = Self {
            tiles: Tiles::new(&plan),
            clusters: Clusters::new(plan.cluster),
            supervision: Supervision::new(plan),
            display: Display::default(),
            ending: Ending::new(),
            beginning: Beginning::default(),
            next_tick: Duration::ZERO,
        };
        state.supervision.spawn(state.display.process());
        state.clusters.start_all(&mut state.supervision);
        let actions = std::mem::take(&mut state.supervision.actions);
        (state, actions)
    }

    /// What is to be done about an event, in order. `now` is the time since the run began.
    pub(super) fn handle(&mut self, now: Duration, event: Event) -> Vec<Action> {
        if self.over().is_some() {
            return Vec::new();
        }
        self.supervision.now = now;
        match event {
            Event::Connected(id) => self.connected(id),
            Event::Report(id, report) => self.told(id, report),
            Event::Disconnected(id, nonsense) => self.supervision.disconnected(id, nonsense),
            Event::Exited(id, how) => self.exited(id, how),
            Event::Uploaded(bus) => {
                self.clusters.uploaded(bus);
                self.configure_nodes();
            }
            Event::UploadFailed(bus, why) => self.supervision.kill(bus, format!("did not take the database: {why}")),
            Event::Begun(Ok(())) => self.beginning.begun(&mut self.supervision),
            Event::Begun(Err(why)) => self.fail(why),
            Event::Refused(who) => self.supervision.incident(who),
            Event::Signal(signal) => self.interrupt(signal),
            Event::Tick => self.tick(),
        }
        self.advance();
        std::mem::take(&mut self.supervision.actions)
    }

    /// When [`Event::Tick`] is due, since the run began; `None`: the run is over.
    pub(super) fn next_deadline(&self) -> Option<Duration> {
        self.over().is_none().then_some(self.next_tick)
    }

    /// Why the run ended, once it has.
    pub(super) fn over(&self) -> Option<&Cause> {
        self.ending.over()
    }

    fn connected(&mut self, id: ProcessId) {
        if !self.supervision.connected(id) {
            return;
        }
        match id.role {
            Role::Bus(_) | Role::Display => self.beginning.configure_writer(id, &mut self.supervision),
            Role::Master(cluster) => self.clusters.configure_master(id, cluster, &mut self.supervision),
            Role::Node(_) => self.configure_nodes(),
            Role::Manager => {}
        }
    }

    fn told(&mut self, id: ProcessId, report: Report) {
        let Some(process) = self.supervision.table.get_mut(id) else { return };
        process.last_sign = self.supervision.now;
        match report {
            Report::Bus(BusReport::Heartbeat)
            | Report::Master(MasterReport::Heartbeat)
            | Report::Node(NodeReport::Heartbeat)
            | Report::Display(DisplayReport::Heartbeat) => {}
            Report::Bus(BusReport::Incident(text))
            | Report::Node(NodeReport::Incident(text))
            | Report::Display(DisplayReport::Incident(text))
            | Report::Master(MasterReport::Incident(text)) => self.supervision.reported(id, &text),
            // What a process reports after it was killed does not count.
            _ if process.killed.is_some() => {}
            Report::Bus(report) => self.told_by_bus(id, report),
            Report::Master(report) => self.told_by_master(id, report),
            Report::Node(report) => self.told_by_node(id, report),
            Report::Display(report) => self.told_by_display(id, report),
        }
    }

    fn exited(&mut self, id: ProcessId, how: String) {
        let Some(mut exit) = self.supervision.exited(id, how) else { return };
        let is_running = self.ending.is_running();
        let (queue, supervision) = (&mut self.tiles.queue, &mut self.supervision);
        match id.role {
            Role::Node(node) => {
                let by = Producer { run: supervision.plan.id, node, epoch: id.epoch };
                // Why a process was condemned is reported already.
                exit.was_expected |= self.tiles.verification.is_condemned(by);
                self.clusters.node_exited(node, exit, is_running, queue, supervision);
                self.end_without_nodes();
            }
            Role::Bus(cluster) | Role::Master(cluster) => {
                self.clusters.server_exited(cluster, exit, is_running, queue, supervision);
                self.end_without_nodes();
            }
            Role::Display => {
                let is_needed = is_running || self.ending.is_orderly();
                if let Err(why) = self.display.exited(exit, is_needed, supervision) {
                    self.fail(why);
                }
            }
            Role::Manager => {}
        }
    }

    fn producer(&self, node: NodeId, epoch: Epoch) -> Producer {
        Producer { run: self.supervision.plan.id, node, epoch }
    }

    /// The display has a tile's pixels.
    fn done(&mut self, cluster: (ClusterId, Epoch), by: Producer, done: &TileDone) {
        let pixels = self.supervision.plan.tiling.rect(done.tile).map_or(0, Rect::pixel_count);
        if let Some(fault) = done.fault(pixels as u64) {
            self.condemn(by, &format!("it reported {} with {fault}", done.tile));
        }
        let now = self.supervision.now;
        match self.tiles.done(cluster, by, done, now) {
            None | Some(Completion::Extra) => {}
            Some(Completion::Unknown) => {
                self.supervision.incident(format!("{} of {} is done, but was not out", done.tile, by.node));
            }
            Some(Completion::Accepted) => {
                self.clusters.forgive(cluster.0, by.node);
                self.display.failures = 0;
            }
        }
    }

    /// What is done and is not there is done again or, after the last tile, a failure: nothing is missing there because a
    /// process said so.
    fn require(&mut self, holdings: &Holdings, place: &str) {
        let tiles = self.tiles.redo(|tile, _| !holdings.tiles.contains(tile));
        if tiles == 0 {
            return;
        }
        let lacking = format!("{place} lacks {tiles} tiles that were done");
        if self.ending.is_completing() {
            return self.fail(lacking);
        }
        self.supervision.incident(format!("{lacking}: they are done again"));
    }

    /// Two results of a tile were compared.
    fn compared(&mut self, comparison: &Comparison) {
        let (tile, total) = (comparison.tile, self.tiles.queue.total());
        if tile.0 >= total {
            return self.supervision.kill(self.display.process(), format!("compared {tile} of an image of {total}"));
        }
        match self.tiles.verification.judge(comparison) {
            Verdict::Agreed => {}
            Verdict::Again { except } => self.tiles.queue.settle(tile, except),
            Verdict::Dispute { except } => {
                let names: Vec<_> = except.iter().map(ToString::to_string).collect();
                self.supervision.incident(format!("{} disagree about {tile}", names.join(" and ")));
                self.tiles.queue.settle(tile, except);
                if self.ending.is_completing() {
                    self.fail(format!("two results of {tile} differ, which was found after the last tile"));
                }
            }
            Verdict::Wrong(processes) => {
                for process in processes {
                    self.condemn(process, &format!("other nodes agree on other pixels of {tile}"));
                }
            }
        }
    }

    /// A process is wrong, or forges what it reports: it is ended, its node is quarantined, and all that it did is done
    /// again, whichever run it was part of.
    fn condemn(&mut self, process: Producer, why: &str) {
        if self.tiles.verification.condemned().len() >= PRODUCERS_MAX {
            return self.fail(format!("more than {PRODUCERS_MAX} processes are to be condemned"));
        }
        let Some(tiles) = self.tiles.condemn(process) else { return };
        let Producer { run, node, epoch } = process;
        if run == self.supervision.plan.id {
            self.supervision
                .incident(format!("{process} is condemned: {why}; its {tiles} tiles so far are done again"));
            self.supervision.kill(ProcessId { role: Role::Node(node), epoch }, "was condemned".to_owned());
            self.set_aside(node, "it is condemned");
        } else {
            self.supervision
                .incident(format!("{process} of an earlier run is condemned: {why}; its tiles are done again"));
        }
        self.display.condemn(process, &mut self.supervision);
        if self.ending.is_completing() {
            self.fail(format!("{process} was condemned after the last tile: {why}"));
        }
    }

    /// A node gets no more tiles in this run.
    fn set_aside(&mut self, node: NodeId, why: &str) {
        self.clusters.set_aside(node, why, &mut self.tiles.queue, &mut self.supervision);
        self.end_without_nodes();
    }

    fn end_without_nodes(&mut self) {
        if self.ending.is_running() && self.clusters.all_available().is_empty() {
            self.end(Cause::NoNodes);
        }
    }

    /// Nodes that are connected, once everything they need is there.
    fn configure_nodes(&mut self) {
        if let (true, Some(display)) = (self.ending.is_running(), self.display.address) {
            self.clusters.configure_nodes(display, &mut self.supervision);
        }
    }

    /// What became possible by the event.
    fn advance(&mut self) {
        self.beginning.advance(&self.display, &self.ending, &mut self.supervision);
        if self.ending.is_running() && self.display.address.is_some() {
            self.hand_out();
            if self.tiles.queue.missing() > 0 {
                self.display.expect_more();
            } else {
                self.give_up_checks();
                let is_verified = self.tiles.verification.is_idle() && self.ending.is_running();
                if is_verified && self.display.has_told_all(&mut self.supervision) && !self.verify_latest() {
                    self.end(Cause::Complete);
                }
            }
        }
        self.ending.advance(&mut self.display, &mut self.tiles, &mut self.supervision);
    }

    fn hand_out(&mut self) {
        self.clusters.hand_out(&mut self.tiles.queue, &mut self.supervision);
    }

    /// All tiles are there: the latest one of each process is verified too. `false`: each is, or no node is left to do it.
    fn verify_latest(&mut self) -> bool {
        let is_needed = self.tiles.verify_latest(&self.display.shares);
        if is_needed {
            self.display.expect_more();
            self.give_up_checks();
        }
        is_needed
    }

    /// Tiles whose checks no node is left to do.
    fn give_up_checks(&mut self) {
        for tile in self.tiles.queue.give_up_checks(&self.clusters.all_available()) {
            if self.tiles.verification.give_up(tile) {
                return self.fail(format!("nodes disagree about {tile}, and none is left to settle it"));
            }
            self.supervision.incident(format!("{tile} is not verified: no other node is left"));
        }
        self.hand_out();
    }

    fn tick(&mut self) {
        let now = self.supervision.now;
        self.next_tick = now + TICK;
        self.beginning.tick(&mut self.supervision);
        self.supervision.kill_overdue();
        self.display.tick(&mut self.supervision);
        if self.ending.is_running() {
            self.clusters.kill_silent_masters(&self.tiles.queue, &mut self.supervision);
        }
        if self.tiles.verification.is_overdue(now, self.tiles.queue.is_quiet()) {
            self.tiles.ask_for_comparisons();
        }
        self.ending.tick(&self.tiles, &mut self.supervision);
    }

    /// Begins the end.
    fn end(&mut self, cause: Cause) {
        // What is under way to the display, or found by it, is not to be missed.
        self.display.expect_more();
        self.ending.begin(cause, &mut self.tiles, &mut self.supervision);
    }

    /// The run cannot go on, and why.
    fn fail(&mut self, why: String) {
        if self.ending.is_running() {
            return self.end(Cause::Failed(why));
        }
        self.ending.fail(why, &mut self.supervision);
    }

    /// The first signal ends the run and keeps the partial image, the second one ends everything at once.
    fn interrupt(&mut self, signal: Interrupt) {
        self.supervision.incident(format!("interrupted by {signal}"));
        if self.ending.is_running() {
            return self.end(Cause::Interrupted(signal));
        }
        self.ending.interrupt(signal, &mut self.supervision);
    }
}
