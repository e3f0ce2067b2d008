//! A cluster played by hand: what the processes would tell, and what the manager does about it.

use std::net::SocketAddr;
use std::time::Duration;

use super::Interrupt;
use super::ending::Cause;
use super::process::{Command, ProcessId, Report};
use super::sample;
use super::state::{Action, Event, State};
use crate::ids::{Attempt, ClusterId, Epoch, NodeId, TileId};
use crate::protocol::control::{
    BusCommand, BusReport, BusTotals, DisplayCommand, DisplayReport, DisplayTotals, LostAttempt, MasterCommand,
    MasterReport, MasterTotals, NodeCommand, NodeReport, TileGrant,
};
use crate::protocol::hello::Role;
use crate::protocol::work::TileDone;
use crate::tracer::TraceStats;

const BUS: ProcessId = ProcessId { role: Role::Bus(ClusterId(0)), epoch: Epoch(0) };
const MASTER: ProcessId = ProcessId { role: Role::Master(ClusterId(0)), epoch: Epoch(0) };
const DISPLAY: ProcessId = ProcessId { role: Role::Display, epoch: Epoch(0) };

struct Stage {
    state: State,
    now: Duration,
}

fn node(node: u16, epoch: u32) -> ProcessId {
    ProcessId { role: Role::Node(NodeId(node)), epoch: Epoch(epoch) }
}

fn address(port: u16) -> SocketAddr {
    ([127, 0, 0, 1], port).into()
}

impl Stage {
    /// All processes spawned, nobody connected.
    fn spawned(nodes: u16, tiles: u32) -> Self {
        let (state, actions) = State::start(sample::plan(nodes, tiles));
        assert_eq!(actions.len(), 3 + usize::from(nodes));
        Self { state, now: Duration::ZERO }
    }

    /// Configured and at work, all tiles handed out.
    fn running(nodes: u16, tiles: u32) -> Self {
        let mut stage = Self::spawned(nodes, tiles);
        for id in [BUS, MASTER, DISPLAY].into_iter().chain((0..nodes).map(|n| node(n, 0))) {
            stage.happens(Event::Connected(id));
        }
        stage.bus(BusReport::Listening(address(1)));
        stage.master(MasterReport::Listening(address(2)));
        stage.display(DisplayReport::Listening(address(3)));
        stage.happens(Event::Uploaded);
        stage.master(MasterReport::TilesWanted(tiles));
        for n in 0..nodes {
            stage.master(MasterReport::NodeReady { node: NodeId(n), epoch: Epoch(0) });
        }
        stage
    }

    fn happens(&mut self, event: Event) -> Vec<Action> {
        self.now += Duration::from_millis(1);
        self.state.handle(self.now, event)
    }

    fn bus(&mut self, report: BusReport) -> Vec<Action> {
        self.happens(Event::Report(BUS, Report::Bus(report)))
    }

    fn master(&mut self, report: MasterReport) -> Vec<Action> {
        self.happens(Event::Report(MASTER, Report::Master(report)))
    }

    fn display(&mut self, report: DisplayReport) -> Vec<Action> {
        self.happens(Event::Report(DISPLAY, Report::Display(report)))
    }

    fn exits(&mut self, id: ProcessId) -> Vec<Action> {
        self.happens(Event::Exited(id, "died: signal 9".to_owned()))
    }

    fn all_exit(&mut self, ids: &[ProcessId]) {
        for &id in ids {
            self.exits(id);
        }
    }

    fn done(&mut self, n: u16, tile: u32, attempt: u32) -> Vec<Action> {
        let done = TileDone {
            tile: TileId(tile),
            attempt: Attempt(attempt),
            trace: TraceStats::default(),
            memory: None,
            render_cpu_nanoseconds: 5,
        };
        self.master(MasterReport::Done { node: NodeId(n), epoch: Epoch(0), done: Box::new(done) })
    }

    fn heartbeats(&mut self, ids: &[ProcessId]) {
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

    fn incidents(&self) -> Vec<String> {
        self.state.ledger.incidents().into_iter().map(|incident| incident.text).collect()
    }
}

fn to_master(command: MasterCommand) -> Action {
    Action::Tell(MASTER, Command::Master(command))
}

fn finish_display() -> Action {
    Action::Tell(DISPLAY, Command::Display(DisplayCommand::Finish))
}

fn finish_bus(lost: Vec<LostAttempt>) -> Action {
    Action::Tell(BUS, Command::Bus(BusCommand::Finish { lost }))
}

fn display_totals() -> DisplayTotals {
    DisplayTotals { sha256: "00".to_owned(), tiles_done: 1, tiles_stale: 0, wire_bytes: 1, written: Vec::new() }
}

#[test]
fn everybody_is_configured_as_soon_as_what_it_needs_is_there() {
    let mut stage = Stage::spawned(1, 4);
    assert!(stage.happens(Event::Connected(MASTER)).is_empty(), "the bus does not listen yet");
    assert!(stage.happens(Event::Connected(node(0, 0))).is_empty());
    assert!(matches!(&stage.happens(Event::Connected(BUS))[..], [Action::Tell(BUS, Command::Bus(_))]));
    assert!(matches!(&stage.happens(Event::Connected(DISPLAY))[..], [Action::Tell(DISPLAY, _)]));
    let actions = stage.bus(BusReport::Listening(address(1)));
    assert!(matches!(&actions[..], [Action::Upload(_), Action::Tell(MASTER, _)]), "{actions:?}");
    assert!(stage.display(DisplayReport::Listening(address(3))).is_empty());
    assert!(stage.happens(Event::Uploaded).is_empty());
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
    assert_eq!(stage.done(0, 1, 0), [finish_node]);
    assert!(stage.happens(Event::Report(node(0, 0), Report::Node(NodeReport::Finished))).is_empty());
    assert_eq!(stage.happens(Event::Disconnected(node(0, 0), None)), [Action::HangUp(node(0, 0))]);
    let actions = stage.exits(node(0, 0));
    assert!(actions.ends_with(&[to_master(MasterCommand::Finish), finish_display()]), "{actions:?}");
    assert!(stage.display(DisplayReport::Finished(display_totals())).is_empty());
    assert_eq!(stage.master(MasterReport::Finished(MasterTotals::default())), [finish_bus(vec![])]);
    assert!(stage.bus(BusReport::Finished(BusTotals::default())).is_empty());
    for id in [BUS, DISPLAY, MASTER] {
        assert_eq!(stage.state.over(), None);
        stage.exits(id);
    }
    assert_eq!(stage.state.over(), Some(&Cause::Complete));
    assert!(stage.incidents().is_empty(), "{:?}", stage.incidents());
    assert_eq!(stage.state.ledger.render_cpu_nanoseconds, 10);
}

#[test]
fn a_dead_nodes_tiles_are_issued_again_and_its_place_is_taken() {
    let mut stage = Stage::running(2, 4);
    let actions = stage.exits(node(1, 0));
    let lost_node = to_master(MasterCommand::NodeLost { node: NodeId(1), epoch: Epoch(0) });
    assert_eq!(actions, [Action::HangUp(node(1, 0)), lost_node, Action::Spawn(node(1, 1))]);
    assert_eq!(stage.incidents(), ["node 1 died: signal 9"]);

    let lost = |tile| LostAttempt { node: NodeId(1), tile: TileId(tile), attempt: Attempt(0) };
    assert!(stage.master(MasterReport::Lost(vec![lost(2), lost(3)])).is_empty(), "none are wanted yet");
    let grant = |tile| TileGrant { tile: TileId(tile), attempt: Attempt(1), node: None, except: Vec::new() };
    let tiles = to_master(MasterCommand::Tiles(vec![grant(3), grant(2)]));
    assert_eq!(stage.master(MasterReport::TilesWanted(2)), [tiles]);
    assert_eq!((stage.state.queue.reissued(), stage.state.ledger.lost.len()), (2, 2));

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
    assert!(actions.ends_with(&[to_master(MasterCommand::Finish), finish_display()]), "{actions:?}");
    stage.master(MasterReport::Finished(MasterTotals::default()));
    stage.display(DisplayReport::Finished(display_totals()));
    stage.bus(BusReport::Finished(BusTotals::default()));
    stage.all_exit(&[BUS, MASTER, DISPLAY]);
    assert_eq!(stage.state.over(), Some(&Cause::NoNodes));
}

#[test]
fn a_dead_server_ends_the_run_and_is_named() {
    for (dead, name) in [(BUS, "bus"), (MASTER, "master"), (DISPLAY, "display")] {
        let mut stage = Stage::running(1, 4);
        assert!(stage.exits(dead).contains(&Action::Kill(node(0, 0))), "{name}");
        let actions = stage.exits(node(0, 0));
        assert_eq!(actions.contains(&finish_display()), dead != DISPLAY, "{name}: {actions:?}");
        stage.master(MasterReport::Finished(MasterTotals::default()));
        stage.display(DisplayReport::Finished(display_totals()));
        stage.bus(BusReport::Finished(BusTotals::default()));
        stage.all_exit(&[BUS, MASTER, DISPLAY]);
        assert_eq!(stage.state.over(), Some(&Cause::Failed(format!("the {name} died: signal 9"))));
    }
}

#[test]
fn an_interrupted_run_is_over_in_time_whoever_hangs() {
    let mut stage = Stage::running(1, 4);
    assert!(stage.happens(Event::Signal(Interrupt::Sigint)).contains(&Action::Kill(node(0, 0))));
    let interrupted = stage.now;
    stage.exits(node(0, 0));
    // Nobody answers any more, not even to being killed.
    while stage.state.over().is_none() {
        stage.now += Duration::from_millis(100);
        stage.happens(Event::Tick);
        assert!(stage.now < interrupted + Duration::from_millis(2500));
    }
    assert_eq!(stage.state.over(), Some(&Cause::Interrupted(Interrupt::Sigint)));
}

#[test]
fn an_interrupted_run_kills_a_master_that_hangs_and_keeps_the_image() {
    let mut stage = Stage::running(1, 4);
    stage.happens(Event::Signal(Interrupt::Sigterm));
    let interrupted = stage.now;
    assert!(stage.exits(node(0, 0)).contains(&finish_display()));
    stage.display(DisplayReport::Finished(display_totals()));
    let mut killed = Vec::new();
    while !killed.contains(&Action::Kill(MASTER)) {
        stage.now += Duration::from_millis(100);
        killed = stage.happens(Event::Tick);
    }
    assert!(stage.now <= interrupted + Duration::from_millis(1700));
    assert!(stage.exits(MASTER).contains(&finish_bus(vec![])));
}

#[test]
fn a_second_signal_kills_everybody_at_once() {
    let mut stage = Stage::running(1, 4);
    stage.happens(Event::Signal(Interrupt::Sigint));
    let actions = stage.happens(Event::Signal(Interrupt::Sigint));
    for id in [BUS, MASTER, DISPLAY, node(0, 0)] {
        assert!(actions.contains(&Action::Kill(id)), "{id}");
    }
    stage.all_exit(&[BUS, MASTER, DISPLAY, node(0, 0)]);
    assert_eq!(stage.state.over(), Some(&Cause::Interrupted(Interrupt::Sigint)));
}

#[test]
fn a_server_that_does_not_close_its_books_fails_a_whole_run() {
    let mut stage = Stage::running(1, 1);
    stage.done(0, 0, 0);
    stage.happens(Event::Report(node(0, 0), Report::Node(NodeReport::Finished)));
    stage.exits(node(0, 0));
    stage.display(DisplayReport::Finished(display_totals()));
    stage.exits(DISPLAY);
    for second in 1..62 {
        stage.now = Duration::from_secs(second);
        stage.heartbeats(&[BUS, MASTER]);
        stage.happens(Event::Tick);
    }
    assert!(stage.exits(MASTER).contains(&finish_bus(vec![])));
    stage.bus(BusReport::Finished(BusTotals::default()));
    stage.exits(BUS);
    assert_eq!(stage.state.over(), Some(&Cause::Failed("the master did not end in time".to_owned())));
}

#[test]
fn whoever_does_not_connect_is_named() {
    let mut stage = Stage::spawned(1, 1);
    stage.now = Duration::from_secs(11);
    let actions = stage.happens(Event::Tick);
    assert_eq!(actions.len(), 4, "{actions:?}");
    stage.exits(DISPLAY);
    stage.all_exit(&[BUS, MASTER, node(0, 0)]);
    assert_eq!(stage.state.over(), Some(&Cause::Failed("the display did not connect within 10 s".to_owned())));
}
