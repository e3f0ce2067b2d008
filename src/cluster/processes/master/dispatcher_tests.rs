//! A master, event by event.

use super::*;
use crate::protocol::mac::Claim;
use ground::ids::Epoch;
use machine::tile_order::Assignment;
use trace::tracer::TraceStats;

const KEY: MacKey = MacKey::new([3; 32]);

/// The first attempt at a tile, by a node's first process.
fn claim(node: u16, tile: u32) -> Claim {
    Claim { tile: TileId(tile), attempt: Attempt(0), node: NodeId(node), epoch: Epoch(0) }
}

fn first(node: u16) -> NodeProcess {
    NodeProcess { node: NodeId(node), epoch: Epoch(0) }
}

fn state(nodes: u16) -> Dispatcher {
    let mut state = Dispatcher::new(&MasterConfiguration {
        bus: ([127, 0, 0, 1], 1).into(),
        first_node: NodeId(0),
        nodes,
        threads: 1,
        assignment: Assignment::OnDemand,
        tile_deadline_milliseconds: 1000,
        key: KEY,
    });
    for node in 0..nodes {
        at(&mut state, 0, Event::Connected(first(node)));
    }
    state
}

fn at(state: &mut Dispatcher, milliseconds: u64, event: Event) -> Vec<Action> {
    state.handle(Duration::from_millis(milliseconds), event)
}

fn command(state: &mut Dispatcher, command: MasterCommand) -> Vec<Action> {
    at(state, 0, Event::Command(command))
}

fn tiles(state: &mut Dispatcher, tiles: impl IntoIterator<Item = (u32, Option<u16>)>) -> Vec<Action> {
    let grant = |(tile, node): (u32, Option<u16>)| TileGrant {
        tile: TileId(tile),
        attempt: Attempt(0),
        node: node.map(NodeId),
        except: Vec::new(),
    };
    command(state, MasterCommand::Tiles(tiles.into_iter().map(grant).collect()))
}

fn ready(state: &mut Dispatcher, node: u16) -> Vec<Action> {
    request(state, node, WorkRequest::Ready)
}

fn done(state: &mut Dispatcher, node: u16, tile: u32) -> Vec<Action> {
    let done = TileDone {
        tile: TileId(tile),
        attempt: Attempt(0),
        trace: TraceStats::default(),
        memory: None,
        render_cpu_nanoseconds: 0,
    };
    let receipt = KEY.receipt(claim(node, tile));
    request(state, node, WorkRequest::Done { done: Box::new(done), receipt })
}

fn request(state: &mut Dispatcher, node: u16, request: WorkRequest) -> Vec<Action> {
    at(state, 0, Event::Request(first(node), request))
}

fn handed(actions: &[Action]) -> Vec<(u16, u32)> {
    let hand = |action: &Action| match action {
        Action::Hand { to, tile, .. } => Some((to.node.0, tile.0)),
        _ => None,
    };
    actions.iter().filter_map(hand).collect()
}

fn reports(actions: Vec<Action>) -> Vec<MasterReport> {
    let report = |action| match action {
        Action::Report(report) => Some(report),
        _ => None,
    };
    actions.into_iter().filter_map(report).collect()
}

fn totals(state: &mut Dispatcher) -> MasterTotals {
    let actions = command(state, MasterCommand::Finish);
    let Some(Action::End(totals)) = actions.last() else { panic!("no end in {actions:?}") };
    assert_eq!(
        totals.attempts_issued,
        totals.attempts_accepted + totals.attempts_stale + totals.attempts_lost,
        "{totals:?}"
    );
    *totals
}

#[test]
fn tiles_go_to_whoever_asks_first() {
    let mut state = state(2);
    assert!(handed(&ready(&mut state, 1)).is_empty());
    assert!(handed(&ready(&mut state, 0)).is_empty());
    assert_eq!(handed(&tiles(&mut state, [(5, None), (6, None), (7, None)])), [(1, 5), (0, 6)]);
    assert_eq!(handed(&ready(&mut state, 0)), [(0, 7)]);
    assert_eq!(totals(&mut state).attempts_issued, 3);
}

#[test]
fn the_manager_is_asked_ahead_and_in_handfuls() {
    let mut state = Dispatcher::new(&MasterConfiguration {
        bus: ([127, 0, 0, 1], 1).into(),
        first_node: NodeId(0),
        nodes: 2,
        threads: 1,
        assignment: Assignment::OnDemand,
        tile_deadline_milliseconds: 1000,
        key: KEY,
    });
    let asked = |actions: Vec<Action>| {
        reports(actions).into_iter().find_map(|r| if let MasterReport::TilesWanted(n) = r { Some(n) } else { None })
    };
    assert_eq!(asked(at(&mut state, 0, Event::Connected(first(0)))), Some(16));
    assert_eq!(asked(tiles(&mut state, (0..16).map(|t| (t, None)))), None);
    for tile in 0..3 {
        assert_eq!(asked(ready(&mut state, 0)), None);
        assert_eq!(asked(done(&mut state, 0, tile)), None);
    }
    ready(&mut state, 0);
    assert_eq!(asked(done(&mut state, 0, 3)), Some(4));
}

#[test]
fn a_node_that_dies_loses_what_it_holds() {
    let mut state = state(2);
    tiles(&mut state, [(0, None), (1, None), (2, None)]);
    assert_eq!(handed(&ready(&mut state, 0)), [(0, 0)]);
    assert_eq!(handed(&ready(&mut state, 0)), [(0, 1)]);
    // The connection's end is not yet a death.
    assert!(reports(at(&mut state, 1, Event::Disconnected(first(0)))).is_empty());
    let told = reports(command(&mut state, MasterCommand::NodeLost { node: NodeId(0), epoch: Epoch(0) }));
    let lost = |tile| LostAttempt { tile: TileId(tile), attempt: Attempt(0) };
    assert_eq!(told, [MasterReport::Lost(vec![lost(0), lost(1)])]);
    // Told again, nothing is lost twice.
    assert!(reports(command(&mut state, MasterCommand::NodeLost { node: NodeId(0), epoch: Epoch(0) })).is_empty());
    assert_eq!(totals(&mut state), MasterTotals { attempts_issued: 2, attempts_lost: 2, ..Default::default() });
}

#[test]
fn a_dead_node_gets_nothing_whatever_it_asked_for() {
    let mut state = state(1);
    tiles(&mut state, [(0, None)]);
    let dead = MasterCommand::NodeLost { node: NodeId(0), epoch: Epoch(1) };
    command(&mut state, dead);
    assert!(handed(&ready(&mut state, 0)).is_empty(), "it asked before it died");
    let late = at(&mut state, 1, Event::Connected(NodeProcess { node: NodeId(0), epoch: Epoch(1) }));
    assert!(late.iter().any(|action| matches!(action, Action::Dismiss(_))), "it died before it was let in");
    let next = NodeProcess { node: NodeId(0), epoch: Epoch(2) };
    at(&mut state, 1, Event::Connected(next));
    assert_eq!(handed(&at(&mut state, 1, Event::Request(next, WorkRequest::Ready))), [(0, 0)]);
}

#[test]
fn a_completion_after_its_nodes_death_is_stale_once() {
    let mut state = state(1);
    tiles(&mut state, [(0, None)]);
    ready(&mut state, 0);
    command(&mut state, MasterCommand::NodeLost { node: NodeId(0), epoch: Epoch(0) });
    let actions = done(&mut state, 0, 0);
    assert!(!actions.iter().any(|a| matches!(a, Action::Report(MasterReport::Done { .. }))), "{actions:?}");
    assert!(done(&mut state, 0, 0).iter().any(|a| matches!(a, Action::Dismiss(_))), "told twice");
    assert_eq!(totals(&mut state), MasterTotals { attempts_issued: 1, attempts_stale: 1, ..Default::default() });
}

#[test]
fn a_successor_implies_the_death_of_its_predecessor() {
    let mut state = state(1);
    tiles(&mut state, [(0, None), (1, None)]);
    ready(&mut state, 0);
    let told = reports(at(&mut state, 1, Event::Connected(NodeProcess { node: NodeId(0), epoch: Epoch(1) })));
    assert!(matches!(told.as_slice(), [MasterReport::Lost(lost)] if lost.len() == 1), "{told:?}");
    // What the predecessor says is no longer heard, and its end does not touch the successor.
    assert!(handed(&ready(&mut state, 0)).is_empty());
    at(&mut state, 1, Event::Disconnected(first(0)));
    let next = Event::Request(NodeProcess { node: NodeId(0), epoch: Epoch(1) }, WorkRequest::Ready);
    assert_eq!(handed(&at(&mut state, 1, next)), [(0, 1)]);
    let again = at(&mut state, 1, Event::Connected(first(0)));
    assert!(again.iter().any(|a| matches!(a, Action::Dismiss(_))));
}

#[test]
fn interleaved_tiles_wait_for_their_node_until_it_is_set_aside() {
    let mut state = state(2);
    tiles(&mut state, [(0, Some(0)), (1, Some(1)), (2, Some(0)), (3, Some(1))]);
    assert_eq!(handed(&ready(&mut state, 1)), [(1, 1)]);
    assert_eq!(handed(&ready(&mut state, 1)), [(1, 3)]);
    done(&mut state, 1, 1);
    assert!(handed(&ready(&mut state, 1)).is_empty(), "the others are node 0's");
    assert_eq!(handed(&command(&mut state, MasterCommand::NodeSetAside { node: NodeId(0) })), [(1, 0)]);
}

#[test]
fn a_tile_past_its_deadline_is_reported_once() {
    let mut state = state(1);
    tiles(&mut state, [(4, None), (5, None)]);
    ready(&mut state, 0);
    assert!(reports(at(&mut state, 1000, Event::Tick)).is_empty());
    let late = MasterReport::Late { node: NodeId(0), epoch: Epoch(0), tile: TileId(4) };
    assert_eq!(reports(at(&mut state, 1001, Event::Tick)), [late]);
    assert!(reports(at(&mut state, 2000, Event::Tick)).is_empty());
}

#[test]
fn a_node_that_asks_for_too_much_is_dismissed() {
    let mut state = state(1);
    for _ in 0..jobs_per_node(1) {
        assert!(reports(ready(&mut state, 0)).is_empty());
    }
    let actions = ready(&mut state, 0);
    assert!(actions.contains(&Action::Dismiss(first(0))), "{actions:?}");
    assert!(matches!(&reports(actions)[..], [MasterReport::Forged { why, .. }] if why.contains("more than 4 tiles")));
}

#[test]
fn the_first_tile_of_a_process_is_announced() {
    let mut state = state(1);
    tiles(&mut state, [(0, None), (1, None)]);
    let announced = |actions| reports(actions).iter().any(|r| matches!(r, MasterReport::NodeReady { .. }));
    assert!(announced(ready(&mut state, 0)));
    assert!(!announced(ready(&mut state, 0)));
}

#[test]
fn a_job_comes_with_a_permit_for_its_process() {
    let mut state = state(2);
    tiles(&mut state, [(5, None)]);
    let actions = ready(&mut state, 1);
    let permit = actions.iter().find_map(|a| if let Action::Hand { permit, .. } = a { Some(*permit) } else { None });
    assert_eq!(permit, Some(KEY.permit(claim(1, 5))));
}

#[test]
fn a_completion_without_the_displays_receipt_is_a_forgery() {
    let mut state = state(2);
    tiles(&mut state, [(0, None), (1, None)]);
    ready(&mut state, 0);
    ready(&mut state, 1);
    // None, the permit in its place, another process's, another tile's.
    let receipts = [Mac::default(), KEY.permit(claim(0, 0)), KEY.receipt(claim(1, 0)), KEY.receipt(claim(0, 1))];
    for receipt in receipts {
        let done = TileDone {
            tile: TileId(0),
            attempt: Attempt(0),
            trace: TraceStats::default(),
            memory: None,
            render_cpu_nanoseconds: 0,
        };
        let actions = request(&mut state, 0, WorkRequest::Done { done: Box::new(done), receipt });
        assert!(actions.contains(&Action::Dismiss(first(0))), "{actions:?}");
        let why = "it reported tile 0, attempt 0 without a receipt of the display".to_owned();
        let forged = MasterReport::Forged { node: NodeId(0), epoch: Epoch(0), why };
        let reports = reports(actions);
        assert!(reports.contains(&forged) && !reports.iter().any(|r| matches!(r, MasterReport::Done { .. })));
    }
    // What it holds is lost when it is dead, as ever.
    command(&mut state, MasterCommand::NodeLost { node: NodeId(0), epoch: Epoch(0) });
    done(&mut state, 1, 1);
    let expected = MasterTotals { attempts_issued: 2, attempts_accepted: 1, attempts_lost: 1, ..Default::default() };
    assert_eq!(totals(&mut state), expected);
}

#[test]
fn a_node_that_asks_for_nothing_while_tiles_wait_for_it_is_reported_once() {
    let mut state = state(2);
    tiles(&mut state, [(0, Some(0)), (1, Some(1)), (2, Some(1))]);
    ready(&mut state, 0);
    ready(&mut state, 1);
    done(&mut state, 0, 0);
    done(&mut state, 1, 1);
    assert!(reports(at(&mut state, 5000, Event::Tick)).is_empty(), "it has just become idle");
    assert!(reports(at(&mut state, 6000, Event::Tick)).is_empty());
    let idle = MasterReport::Idle { node: NodeId(1), epoch: Epoch(0) };
    assert_eq!(reports(at(&mut state, 6001, Event::Tick)), [idle], "nothing waits for node 0");
    assert!(reports(at(&mut state, 9000, Event::Tick)).is_empty());
    let mut state = self::state(2);
    tiles(&mut state, [(0, Some(0)), (1, Some(0))]);
    ready(&mut state, 0);
    at(&mut state, 0, Event::Tick);
    done(&mut state, 0, 0);
    at(&mut state, 900, Event::Tick);
    at(&mut state, 900, Event::Request(first(0), WorkRequest::Ready));
    assert!(reports(at(&mut state, 1001, Event::Tick)).is_empty(), "it works, if slowly");
}
