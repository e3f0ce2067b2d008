//! A cluster played by hand: what the processes would tell, and what the manager does about it.

use std::net::SocketAddr;
use std::time::Duration;

use super::super::cause::Cause;
use super::super::event::{Action, Event};
use super::super::fixture;
use super::super::plan::Plan;
use super::super::process::{Command, ProcessId, Report};
use super::State;
use crate::protocol::control::{
    BusCommand, BusReport, DisplayCommand, DisplayReport, DisplayTotals, Holdings, MasterCommand, MasterReport,
    NodeCommand, NodeReport, TileGrant,
};
use crate::protocol::hello::Role;
use crate::protocol::work::TileDone;
use ground::ids::{Attempt, ClusterId, Epoch, NodeId, TileId};
use machine::hardware::totals::{BusTotals, LostAttempt, MasterTotals};
use trace::tracer::TraceStats;

pub(super) const BUS: ProcessId = ProcessId { role: Role::Bus(ClusterId(0)), epoch: Epoch(0) };
pub(super) const MASTER: ProcessId = ProcessId { role: Role::Master(ClusterId(0)), epoch: Epoch(0) };
pub(super) const DISPLAY: ProcessId = ProcessId { role: Role::Display, epoch: Epoch(0) };

pub(super) struct Stage {
    pub(super) state: State,
    pub(super) now: Duration,
}

pub(super) fn node(node: u16, epoch: u32) -> ProcessId {
    ProcessId { role: Role::Node(NodeId(node)), epoch: Epoch(epoch) }
}

pub(super) fn address(port: u16) -> SocketAddr {
    ([127, 0, 0, 1], port).into()
}

impl Stage {
    /// All processes spawned, nobody connected.
    fn spawned(nodes: u16, tiles: u32) -> Self {
        let (state, actions) = State::start(fixture::plan(nodes, tiles));
        assert_eq!(actions.len(), 3 + usize::from(nodes));
        Self { state, now: Duration::ZERO }
    }

    /// Configured and at work, all tiles handed out.
    pub(super) fn running(nodes: u16, tiles: u32) -> Self {
        Self::configured(fixture::plan(nodes, tiles), tiles)
    }

    pub(super) fn configured(plan: Plan, tiles: u32) -> Self {
        let nodes = plan.cluster.nodes;
        let mut stage = Self::restored(plan, Holdings::default());
        stage.master(MasterReport::TilesWanted(tiles));
        for n in 0..nodes {
            stage.master(MasterReport::NodeReady { node: NodeId(n), epoch: Epoch(0) });
        }
        stage
    }

    /// Configured, with what the display has from its journal; no tile is wanted yet.
    pub(super) fn restored(plan: Plan, holdings: Holdings) -> Self {
        let nodes = plan.cluster.nodes;
        let (state, _) = State::start(plan);
        let mut stage = Self { state, now: Duration::ZERO };
        for id in [BUS, MASTER, DISPLAY].into_iter().chain((0..nodes).map(|n| node(n, 0))) {
            stage.happens(Event::Connected(id));
        }
        stage.bus(BusReport::Listening(address(1)));
        stage.master(MasterReport::Listening(address(2)));
        stage.display(DisplayReport::Restored(holdings));
        stage.display(DisplayReport::Listening(address(3)));
        stage.happens(Event::Uploaded(BUS));
        stage
    }

    /// All of the cluster's processes of an epoch come up; what is done about it.
    fn serves_again(&mut self, epoch: u32) -> Vec<Action> {
        let of_epoch = |id: ProcessId| ProcessId { epoch: Epoch(epoch), ..id };
        let (bus, master) = (of_epoch(BUS), of_epoch(MASTER));
        self.happens(Event::Connected(bus));
        self.happens(Event::Connected(master));
        self.happens(Event::Report(bus, Report::Bus(BusReport::Listening(address(1)))));
        self.happens(Event::Report(master, Report::Master(MasterReport::Listening(address(2)))));
        self.happens(Event::Uploaded(bus));
        self.happens(Event::Report(master, Report::Master(MasterReport::TilesWanted(99))))
    }

    pub(super) fn happens(&mut self, event: Event) -> Vec<Action> {
        self.now += Duration::from_millis(1);
        let mut actions = self.state.handle(self.now, event);
        if actions.contains(&Action::Begin) {
            actions.extend(self.state.handle(self.now, Event::Begun(Ok(()))));
        }
        actions
    }

    pub(super) fn bus(&mut self, report: BusReport) -> Vec<Action> {
        self.happens(Event::Report(BUS, Report::Bus(report)))
    }

    pub(super) fn master(&mut self, report: MasterReport) -> Vec<Action> {
        self.happens(Event::Report(MASTER, Report::Master(report)))
    }

    pub(super) fn display(&mut self, report: DisplayReport) -> Vec<Action> {
        self.happens(Event::Report(DISPLAY, Report::Display(report)))
    }

    pub(super) fn exits(&mut self, id: ProcessId) -> Vec<Action> {
        self.happens(Event::Exited(id, "died: signal 9".to_owned()))
    }

    pub(super) fn all_exit(&mut self, ids: &[ProcessId]) {
        for &id in ids {
            self.exits(id);
        }
    }

    /// The latest question what the first display holds.
    pub(super) fn question(&self) -> Action {
        let question = self.state.display.question;
        Action::Tell(DISPLAY, Command::Display(DisplayCommand::TellHoldings { question }))
    }

    /// The display has these tiles.
    pub(super) fn holds(&mut self, tiles: impl IntoIterator<Item = bool>) -> Vec<Action> {
        let question = self.state.display.question;
        self.display(DisplayReport::Holdings { question, holdings: holdings(tiles) })
    }

    pub(super) fn done(&mut self, n: u16, tile: u32, attempt: u32) -> Vec<Action> {
        let done = TileDone {
            tile: TileId(tile),
            attempt: Attempt(attempt),
            trace: TraceStats { rays: [1, 0, 0, 0], ..TraceStats::default() },
            memory: None,
            render_cpu_nanoseconds: 5,
        };
        self.master(MasterReport::Done { node: NodeId(n), epoch: Epoch(0), done: Box::new(done) })
    }

    pub(super) fn heartbeats(&mut self, ids: &[ProcessId]) {
        for &id in ids {
            let report = match id.role {
                Role::Bus(ClusterId(0)) => Report::Bus(BusReport::Heartbeat),
                Role::Master(ClusterId(0)) => Report::Master(MasterReport::Heartbeat),
                Role::Display => Report::Display(DisplayReport::Heartbeat),
                _ => Report::Node(NodeReport::Heartbeat),
            };
            self.happens(Event::Report(id, report));
        }
    }

    pub(super) fn incidents(&self) -> Vec<String> {
        self.state.supervision.incidents.all().into_iter().map(|incident| incident.text).collect()
    }
}

pub(super) fn to_master(command: MasterCommand) -> Action {
    Action::Tell(MASTER, Command::Master(command))
}

/// What the master is granted.
pub(super) fn granted(actions: &[Action]) -> Vec<TileGrant> {
    let grants = actions.iter().filter_map(|action| match action {
        Action::Tell(_, Command::Master(MasterCommand::Tiles(grants))) => Some(grants.clone()),
        _ => None,
    });
    grants.flatten().collect()
}

pub(super) fn holdings(tiles: impl IntoIterator<Item = bool>) -> Holdings {
    Holdings { tiles: tiles.into_iter().collect(), shares: Vec::new() }
}

pub(super) fn finish_display() -> Action {
    Action::Tell(DISPLAY, Command::Display(DisplayCommand::Finish))
}

pub(super) fn finish_bus(lost: Vec<LostAttempt>) -> Action {
    Action::Tell(BUS, Command::Bus(BusCommand::Finish { lost }))
}

pub(super) fn display_totals() -> DisplayTotals {
    DisplayTotals { sha256: "00".to_owned(), tiles_done: 1, tiles_stale: 0, wire_bytes: 1, written: Vec::new() }
}

#[test]
fn everybody_is_configured_as_soon_as_what_it_needs_is_there() {
    let mut stage = Stage::spawned(1, 4);
    assert!(stage.happens(Event::Connected(MASTER)).is_empty(), "the bus does not listen yet");
    assert!(stage.happens(Event::Connected(node(0, 0))).is_empty());
    assert!(stage.happens(Event::Connected(BUS)).is_empty(), "the run has not begun");
    let actions = stage.happens(Event::Connected(DISPLAY));
    let is_told = |id| actions.iter().any(|action| matches!(action, Action::Tell(to, _) if *to == id));
    assert!(actions.contains(&Action::Begin) && is_told(BUS) && is_told(DISPLAY), "{actions:?}");
    let actions = stage.bus(BusReport::Listening(address(1)));
    assert!(matches!(&actions[..], [Action::Upload(BUS, _), Action::Tell(MASTER, _)]), "{actions:?}");
    assert!(stage.display(DisplayReport::Listening(address(3))).is_empty());
    assert!(stage.happens(Event::Uploaded(BUS)).is_empty());
    let actions = stage.master(MasterReport::Listening(address(2)));
    let [Action::Tell(id, Command::Node(NodeCommand::Configure(configured)))] = &actions[..] else {
        panic!("{actions:?}");
    };
    assert_eq!(
        (*id, configured.bus, configured.master, configured.display),
        (node(0, 0), address(1), address(2), address(3))
    );
}

#[test]
fn a_whole_run_ends_in_order() {
    let mut stage = Stage::running(1, 2);
    assert!(stage.done(0, 0, 0).is_empty());
    let finish_node = Action::Tell(node(0, 0), Command::Node(NodeCommand::Finish));
    assert_eq!(stage.done(0, 1, 0), [stage.question()]);
    assert_eq!(stage.holds([true; 2]), [finish_node]);
    assert!(stage.happens(Event::Report(node(0, 0), Report::Node(NodeReport::Finished))).is_empty());
    assert_eq!(stage.happens(Event::Disconnected(node(0, 0), None)), [Action::HangUp(node(0, 0))]);
    let actions = stage.exits(node(0, 0));
    assert!(actions.ends_with(&[to_master(MasterCommand::Finish), stage.question()]), "{actions:?}");
    assert_eq!(stage.holds([true; 2]), [finish_display()]);
    let totals = DisplayTotals { tiles_done: 2, ..display_totals() };
    assert!(stage.display(DisplayReport::Finished(totals)).is_empty());
    assert_eq!(stage.master(MasterReport::Finished(MasterTotals::default())), [finish_bus(vec![])]);
    assert!(stage.bus(BusReport::Finished(BusTotals::default())).is_empty());
    for id in [BUS, DISPLAY, MASTER] {
        assert_eq!(stage.state.over(), None);
        stage.exits(id);
    }
    assert_eq!(stage.state.over(), Some(&Cause::Complete));
    assert!(stage.incidents().is_empty(), "{:?}", stage.incidents());
    assert_eq!(stage.state.tiles.ledger.total().render_cpu_nanoseconds, 10);
}

#[test]
fn a_dead_nodes_tiles_are_issued_again_and_its_place_is_taken() {
    let mut stage = Stage::running(2, 4);
    let actions = stage.exits(node(1, 0));
    let lost_node = to_master(MasterCommand::NodeLost { node: NodeId(1), epoch: Epoch(0) });
    assert_eq!(actions, [Action::HangUp(node(1, 0)), lost_node, Action::Spawn(node(1, 1))]);
    assert_eq!(stage.incidents(), ["node 1 died: signal 9"]);

    let lost = |tile| LostAttempt { tile: TileId(tile), attempt: Attempt(0) };
    assert!(stage.master(MasterReport::Lost(vec![lost(2), lost(3)])).is_empty(), "none are wanted yet");
    let grant = |tile| TileGrant { tile: TileId(tile), attempt: Attempt(1), node: None, except: Vec::new() };
    let tiles = to_master(MasterCommand::Tiles(vec![grant(3), grant(2)]));
    assert_eq!(stage.master(MasterReport::TilesWanted(2)), [tiles]);
    let lost = stage.state.tiles.ledger.books.values().map(|book| book.lost.len()).sum::<usize>();
    assert_eq!((stage.state.tiles.queue.reissued(), lost), (2, 2));

    // The successor is configured at once, for the run goes on.
    let actions = stage.happens(Event::Connected(node(1, 1)));
    assert!(matches!(&actions[..], [Action::Tell(id, Command::Node(_))] if *id == node(1, 1)), "{actions:?}");
}

#[test]
fn silence_and_late_tiles_are_answered_by_killing() {
    let mut stage = Stage::running(2, 4);
    stage.now = Duration::from_secs(5);
    stage.heartbeats(&[BUS, MASTER, DISPLAY, node(1, 0)]);
    stage.now = Duration::from_secs(6);
    assert_eq!(stage.happens(Event::Tick), [Action::Kill(node(0, 0))]);
    assert!(stage.happens(Event::Tick).is_empty(), "once");
    stage.exits(node(0, 0));
    let late = MasterReport::Late { node: NodeId(1), epoch: Epoch(0), tile: TileId(3) };
    assert_eq!(stage.master(late), [Action::Kill(node(1, 0))]);
    stage.exits(node(1, 0));
    assert_eq!(stage.incidents(), ["node 0 was silent for more than 5 s", "node 1 held tile 3 for more than 60 s"]);
}

#[test]
fn a_master_that_reports_nothing_of_a_tile_is_killed_and_its_cluster_starts_again() {
    let mut stage = Stage::running(2, 4);
    let everybody = [BUS, MASTER, DISPLAY, node(0, 0), node(1, 0)];
    // Ten tile deadlines, and the time to join.
    for (seconds, expected) in [(1200, vec![]), (1201, vec![Action::Kill(MASTER)]), (1202, vec![])] {
        stage.now = Duration::from_secs(seconds);
        stage.heartbeats(&everybody);
        assert_eq!(stage.happens(Event::Tick), expected, "{seconds} s");
    }
    stage.exits(MASTER);
    assert_eq!(stage.incidents(), ["the master reported nothing of tile 0 for more than 1200 s"]);
}

/// It sends signs of life, and no answer.
#[test]
fn a_display_that_does_not_report_what_it_holds_is_replaced_and_asked_again() {
    let mut stage = Stage::running(1, 1);
    let everybody = [BUS, MASTER, DISPLAY, node(0, 0)];
    let actions = stage.done(0, 0, 0);
    assert!(actions.contains(&stage.question()), "{actions:?}");
    for (seconds, expected) in [(60, vec![]), (61, vec![Action::Kill(DISPLAY)]), (62, vec![])] {
        stage.now = Duration::from_secs(seconds);
        stage.heartbeats(&everybody);
        assert_eq!(stage.happens(Event::Tick), expected, "{seconds} s");
    }
    let next = ProcessId { epoch: Epoch(1), ..DISPLAY };
    assert!(stage.exits(DISPLAY).contains(&Action::Spawn(next)));
    assert_eq!(stage.incidents(), ["the display did not report what it holds for more than 60 s"]);
}

#[test]
fn a_server_that_ends_before_it_is_asked_to_is_killed() {
    let mut stage = Stage::running(1, 2);
    assert_eq!(stage.bus(BusReport::Finished(BusTotals::default())), [Action::Kill(BUS)]);
    let mut stage = Stage::running(1, 2);
    assert_eq!(stage.master(MasterReport::Finished(MasterTotals::default())), [Action::Kill(MASTER)]);
    let mut stage = Stage::running(1, 2);
    assert_eq!(stage.display(DisplayReport::Finished(display_totals())), [Action::Kill(DISPLAY)]);
}

/// A run without its image is not complete.
#[test]
fn a_display_that_ends_without_an_image_fails_the_run() {
    let mut stage = Stage::running(1, 1);
    stage.done(0, 0, 0);
    stage.holds([true]);
    stage.exits(node(0, 0));
    stage.master(MasterReport::Finished(MasterTotals::default()));
    stage.bus(BusReport::Finished(BusTotals::default()));
    for _ in 0..4 {
        stage.now += Duration::from_secs(61);
        stage.happens(Event::Tick);
    }
    stage.all_exit(&[MASTER, BUS]);
    for _ in 0..4 {
        stage.now += Duration::from_secs(61);
        stage.happens(Event::Tick);
    }
    let over = stage.state.over().map(|cause| format!("{cause:?}"));
    assert!(over.as_deref().is_some_and(|cause| cause.starts_with("Failed")), "{over:?}");
}

#[test]
fn three_failures_in_a_row_set_a_node_aside() {
    let mut stage = Stage::running(2, 8);
    assert!(stage.exits(node(0, 0)).contains(&Action::Spawn(node(0, 1))));
    assert!(stage.exits(node(0, 1)).contains(&Action::Spawn(node(0, 2))));
    // A tile done in between forgives.
    stage.done(0, 0, 0);
    assert!(stage.exits(node(0, 2)).contains(&Action::Spawn(node(0, 3))));
    assert!(stage.exits(node(0, 3)).contains(&Action::Spawn(node(0, 4))));
    let actions = stage.exits(node(0, 4));
    assert!(actions.contains(&to_master(MasterCommand::NodeSetAside { node: NodeId(0) })), "{actions:?}");
    assert!(stage.incidents().iter().any(|text| text.starts_with("node 0 is set aside")));
    // The last one: the run cannot go on.
    stage.exits(node(1, 0));
    stage.exits(node(1, 1));
    let actions = stage.exits(node(1, 2));
    assert!(actions.ends_with(&[to_master(MasterCommand::Finish), stage.question()]), "{actions:?}");
    assert_eq!(stage.holds([true]), [finish_display()]);
    stage.master(MasterReport::Finished(MasterTotals::default()));
    stage.display(DisplayReport::Finished(display_totals()));
    stage.bus(BusReport::Finished(BusTotals::default()));
    stage.all_exit(&[BUS, MASTER, DISPLAY]);
    assert_eq!(stage.state.over(), Some(&Cause::NoNodes));
}

#[test]
fn a_cluster_whose_server_dies_starts_again_with_all_it_has() {
    for dead in [BUS, MASTER] {
        let mut stage = Stage::running(2, 4);
        stage.done(0, 1, 0);
        let others = [BUS, MASTER, node(0, 0), node(1, 0)].into_iter().filter(|&id| id != dead);
        let actions = stage.exits(dead);
        others.clone().for_each(|id| assert!(actions.contains(&Action::Kill(id)), "{id}: {actions:?}"));
        let mut actions = Vec::new();
        others.for_each(|id| actions = stage.exits(id));
        // When the last one is dead, and not before.
        let next = |id: ProcessId| Action::Spawn(ProcessId { epoch: Epoch(1), ..id });
        let expected = [next(BUS), next(MASTER), next(node(0, 0)), next(node(1, 0))];
        assert!(actions.ends_with(&expected), "{actions:?}");
        assert_eq!(stage.incidents(), [format!("{dead} died: signal 9")]);
        // What it had waits again.
        let actions = stage.serves_again(1);
        let tiles: Vec<_> = granted(&actions).iter().map(|grant| (grant.tile.0, grant.attempt.0)).collect();
        assert_eq!(tiles, [(0, 1), (2, 1), (3, 1)]);
    }
}

#[test]
fn a_new_master_knows_the_nodes_that_were_set_aside_before_it() {
    let mut stage = Stage::running(3, 8);
    for id in [MASTER, BUS, node(0, 0), node(1, 0), node(2, 0)] {
        stage.exits(id);
    }
    let of_epoch = |id: ProcessId| ProcessId { epoch: Epoch(1), ..id };
    stage.state.set_aside(NodeId(1), "it failed");
    stage.happens(Event::Connected(of_epoch(BUS)));
    stage.happens(Event::Connected(of_epoch(MASTER)));
    stage.happens(Event::Report(of_epoch(BUS), Report::Bus(BusReport::Listening(address(1)))));
    // Without it, a tile that only node 1 could verify would wait there for ever.
    let listens = Report::Master(MasterReport::Listening(address(2)));
    let actions = stage.happens(Event::Report(of_epoch(MASTER), listens));
    let told = Command::Master(MasterCommand::NodeSetAside { node: NodeId(1) });
    assert!(actions.contains(&Action::Tell(of_epoch(MASTER), told)), "{actions:?}");
}

#[test]
fn a_cluster_without_nodes_gets_no_tiles() {
    let mut plan = fixture::plan(1, 4);
    plan.cluster.count = 2;
    let mut stage = Stage::configured(plan, 0);
    stage.state.set_aside(NodeId(0), "it is condemned");
    let actions = stage.master(MasterReport::TilesWanted(4));
    assert!(granted(&actions).is_empty(), "its master would give them back: {actions:?}");
}

#[test]
fn what_a_dead_cluster_still_says_does_not_count() {
    let mut stage = Stage::running(1, 2);
    stage.exits(BUS);
    stage.done(0, 0, 0);
    assert_eq!(stage.state.tiles.queue.missing(), 2);
}

#[test]
fn a_cluster_that_fails_three_times_is_set_aside() {
    let mut stage = Stage::running(1, 4);
    for epoch in 0..3 {
        let of_epoch = |id: ProcessId| ProcessId { epoch: Epoch(epoch), ..id };
        assert_eq!(stage.state.over(), None);
        stage.exits(of_epoch(BUS));
        stage.all_exit(&[of_epoch(MASTER), node(0, epoch)]);
    }
    assert!(stage.incidents().iter().any(|text| text.starts_with("cluster 0 is set aside")), "{:?}", stage.incidents());
    stage.holds([false; 4]);
    stage.display(DisplayReport::Finished(display_totals()));
    stage.exits(DISPLAY);
    assert_eq!(stage.state.over(), Some(&Cause::NoNodes));
}

#[test]
fn a_resumed_run_does_what_the_journal_lacks() {
    let mut stage = Stage::spawned(1, 4);
    for id in [BUS, MASTER, DISPLAY, node(0, 0)] {
        stage.happens(Event::Connected(id));
    }
    stage.bus(BusReport::Listening(address(1)));
    stage.master(MasterReport::Listening(address(2)));
    stage.happens(Event::Uploaded(BUS));
    let wanted = stage.master(MasterReport::TilesWanted(9));
    assert!(wanted.is_empty(), "nothing is handed out before the journal is read: {wanted:?}");
    stage.display(DisplayReport::Restored(holdings([false, true, false, true])));
    let actions = stage.display(DisplayReport::Listening(address(3)));
    let tiles: Vec<_> = granted(&actions).iter().map(|grant| grant.tile.0).collect();
    assert_eq!(tiles, [0, 2]);
    stage.done(0, 0, 0);
    let finish_node = Action::Tell(node(0, 0), Command::Node(NodeCommand::Finish));
    assert_eq!(stage.done(0, 2, 0), [stage.question()]);
    assert!(stage.holds([true; 4]).contains(&finish_node));
    assert_eq!(stage.state.tiles.ledger.resumed, 2);
}

#[test]
fn whoever_does_not_connect_is_tried_again_and_named() {
    let mut stage = Stage::spawned(1, 1);
    for epoch in 0..3 {
        let of_epoch = |id: ProcessId| ProcessId { epoch: Epoch(epoch), ..id };
        stage.now += Duration::from_secs(11);
        let actions = stage.happens(Event::Tick);
        assert_eq!(actions.len(), 4, "{actions:?}");
        stage.exits(of_epoch(DISPLAY));
        stage.all_exit(&[of_epoch(BUS), of_epoch(MASTER), node(0, epoch)]);
    }
    let expected = "the display (epoch 2) did not connect within 10 s".to_owned();
    assert_eq!(stage.state.over(), Some(&Cause::Failed(expected)));
}
