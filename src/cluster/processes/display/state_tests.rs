//! A display from its first command to its end, event by event. What becomes of a tile is tested in `composition_tests`.

use super::*;
use crate::protocol::mac::{Claim, Mac, MacKey};
use ground::ids::{Epoch, NodeId};
use trace::picture::{AovSet, Sides, Tiling};

const RUN: RunId = RunId(1);
const KEY: MacKey = MacKey::new([9; 32]);
const NODE: ConnectionId = ConnectionId::Accepted(0);
const OTHER: ConnectionId = ConnectionId::Accepted(1);

/// Two tiles of one pixel.
fn configuration() -> DisplayConfiguration {
    DisplayConfiguration {
        tiling: Tiling::new(Sides { width: 2, height: 1, tile_width: 1, tile_height: 1 }).expect("possible"),
        aov: AovSet::default(),
        journal: "tiles".into(),
        resume: false,
        fingerprint: [0; 32],
        key: KEY,
        image: "image.png".into(),
        exr: false,
    }
}

fn configure() -> Event {
    Event::Command(DisplayCommand::Configure(configuration()))
}

fn handle(state: &mut State, event: Event) -> Vec<Action> {
    let actions = state.handle(Duration::from_secs(1), event);
    assert_eq!(state.next_deadline(), None, "a display waits for nobody");
    actions
}

fn reported(actions: &[Action]) -> &DisplayReport {
    match actions {
        [Action::Report(report)] => report,
        _ => panic!("one report alone, not {} actions", actions.len()),
    }
}

fn failed(actions: &[Action]) -> &str {
    match actions {
        [Action::Report(DisplayReport::Failed(why)), Action::End(Err(outcome))] if why == outcome => why,
        _ => panic!("it does not fail"),
    }
}

/// The composition that is to be restored.
fn restoring() -> (State, Box<Composition>) {
    let mut state = State::new(RUN);
    let Some(Action::Task(Task::Restore(composition, told))) = handle(&mut state, configure()).pop() else {
        panic!("the journal comes first")
    };
    assert_eq!(told, configuration());
    (state, composition)
}

/// With one node, which has the place of `NODE`.
fn serving() -> State {
    let (mut state, composition) = restoring();
    let actions = handle(&mut state, Event::Answer(Answer::Restored(composition, None)));
    assert!(matches!(&actions[..], [Action::Report(DisplayReport::Restored(_)), Action::Listen(Admission::AnyNode)]));
    let address = ([127, 0, 0, 1], 5).into();
    assert_eq!(*reported(&handle(&mut state, Event::Listening(address))), DisplayReport::Listening(address));
    accept(&mut state, NODE, 3);
    state
}

fn accept(state: &mut State, id: ConnectionId, node: u16) {
    let peer = PeerId { role: Role::Node(NodeId(node)), epoch: Epoch(0) };
    assert!(handle(state, Event::Accepted(id, peer)).is_empty());
}

fn claim(node: u16, tile: u32) -> Claim {
    Claim { tile: TileId(tile), attempt: Attempt(0), node: NodeId(node), epoch: Epoch(0) }
}

/// A pixel of this grey, under a permit for node 3.
fn tile(from: ConnectionId, tile: u32, grey: f32) -> Event {
    let planes = Bytes::from([grey; 3].map(f32::to_le_bytes).concat());
    let permit = KEY.permit(claim(3, tile));
    let tile = TilePixels { tile: TileId(tile), attempt: Attempt(0), permit, crc32c: crc32c::crc32c(&planes) };
    Event::Received(from, Incoming { tile, planes })
}

fn acknowledgement(tile: u32) -> Outgoing {
    let receipt = KEY.receipt(claim(3, tile));
    Outgoing(ImageReply::Acknowledged { tile: TileId(tile), attempt: Attempt(0), receipt })
}

fn totals() -> DisplayTotals {
    DisplayTotals { sha256: "0".to_owned(), tiles_done: 1, tiles_stale: 0, wire_bytes: 9, written: Vec::new() }
}

#[test]
fn a_process_has_one_connection_and_its_last_one_counts() {
    let mut state = serving();
    let peer = PeerId { role: Role::Node(NodeId(3)), epoch: Epoch(0) };
    assert!(matches!(&handle(&mut state, Event::Accepted(OTHER, peer))[..], [Action::Close(NODE)]));
    assert!(handle(&mut state, tile(NODE, 1, 0.5)).is_empty(), "what was under way on the earlier one counts no more");
    let actions = handle(&mut state, tile(OTHER, 1, 0.5));
    assert!(matches!(&actions[..], [Action::Task(Task::Append(_)), Action::Send(OTHER, _)]));
}

#[test]
fn a_tile_is_in_the_journal_before_it_is_acknowledged() {
    let mut state = serving();
    let actions = handle(&mut state, tile(NODE, 1, 0.5));
    let [Action::Task(Task::Append(Entry::Pixels { tile, producer, planes, .. })), Action::Send(NODE, reply)] =
        &actions[..]
    else {
        panic!("appended, then acknowledged")
    };
    assert_eq!((*tile, producer.run, producer.node), (TileId(1), RUN, NodeId(3)));
    assert_eq!((planes.len(), reply), (12, &acknowledgement(1)));
}

#[test]
fn the_journal_is_read_before_anybody_is_served_and_what_it_lost_is_an_incident() {
    let (mut state, mut composition) = restoring();
    let (finish, condemn) = (DisplayCommand::Finish, DisplayCommand::Condemn(Producer::default()));
    for event in [Event::Command(finish), Event::Command(condemn), configure(), tile(NODE, 0, 0.5), Event::Terminate] {
        assert!(handle(&mut state, event).is_empty());
    }
    let producer = Producer { run: RunId(0), node: NodeId(8), epoch: Epoch(2) };
    composition.restore(&Record::Pixels { tile: TileId(1), attempt: Attempt(4), producer, planes: &[0; 12] });
    let actions = handle(&mut state, Event::Answer(Answer::Restored(composition, Some("9 bytes".to_owned()))));
    let [Action::Report(DisplayReport::Incident(dropped)), Action::Report(DisplayReport::Restored(holdings)), _] =
        &actions[..]
    else {
        panic!("the loss, then what is left")
    };
    assert_eq!(dropped, "9 bytes");
    assert_eq!([0, 1].map(|tile| holdings.tiles.contains(TileId(tile))), [false, true]);
    assert_eq!(holdings.shares.len(), 1);
}

#[test]
fn nothing_but_a_configuration_comes_first() {
    for command in [DisplayCommand::Finish, DisplayCommand::TellHoldings { question: 1 }] {
        let actions = handle(&mut State::new(RUN), Event::Command(command));
        assert_eq!(failed(&actions), "the manager sent something else than a configuration");
    }
    let mut state = State::new(RUN);
    assert!(handle(&mut state, tile(NODE, 0, 0.5)).is_empty() && handle(&mut state, Event::Terminate).is_empty());
    assert!(matches!(&handle(&mut state, configure())[..], [Action::Task(Task::Restore(..))]));
}

#[test]
fn commands_are_answered_while_it_serves() {
    let mut state = serving();
    handle(&mut state, tile(NODE, 1, 0.5));
    let actions = handle(&mut state, Event::Command(DisplayCommand::TellHoldings { question: 7 }));
    let DisplayReport::Holdings { question: 7, holdings } = reported(&actions) else { panic!("what it holds") };
    assert!(holdings.tiles.contains(TileId(1)) && !holdings.tiles.contains(TileId(0)));

    let producer = Producer { run: RUN, node: NodeId(3), epoch: Epoch(0) };
    let actions = handle(&mut state, Event::Command(DisplayCommand::Condemn(producer)));
    let [Action::Task(Task::Append(Entry::Condemned(appended))), Action::Report(DisplayReport::Condemned(_, tiles))] =
        &actions[..]
    else {
        panic!("it is in the journal first")
    };
    assert!(*appended == producer && tiles.contains(TileId(1)));
    assert!(matches!(&handle(&mut state, tile(NODE, 0, 0.5))[..], [Action::Close(NODE)]), "nothing of it any more");

    let actions = handle(&mut state, configure());
    assert_eq!(*reported(&actions), DisplayReport::Incident("configured twice; the first one counts".to_owned()));
    let actions = handle(&mut state, Event::Refused("a stranger".to_owned()));
    assert_eq!(*reported(&actions), DisplayReport::Incident("a stranger".to_owned()));
}

#[test]
fn a_node_is_heard_until_its_connection_ends() {
    let loss = |is_breach| Some(Loss { why: "node 3: no message".to_owned(), is_breach });
    for (loss, incident) in [(None, false), (loss(false), false), (loss(true), true)] {
        let mut state = serving();
        let actions = handle(&mut state, Event::Closed(NODE, loss.clone()));
        assert_eq!(actions.len(), usize::from(incident), "{loss:?}");
        if incident {
            assert_eq!(*reported(&actions), DisplayReport::Incident("node 3: no message".to_owned()));
        }
        assert!(handle(&mut state, Event::Closed(NODE, loss)).is_empty(), "once");
        assert!(handle(&mut state, tile(NODE, 1, 0.5)).is_empty(), "what was under way counts no more");
        // Its other connection is another matter.
        accept(&mut state, OTHER, 3);
        assert_eq!(handle(&mut state, tile(OTHER, 1, 0.5)).len(), 2);
    }
}

#[test]
fn a_node_whose_tile_is_not_its_own_is_reported_and_heard_no_more() {
    let mut state = serving();
    accept(&mut state, OTHER, 4);
    let actions = handle(&mut state, tile(OTHER, 1, 0.5));
    let [Action::Close(OTHER), Action::Report(DisplayReport::Forged { node: NodeId(4), epoch: Epoch(0), .. })] =
        &actions[..]
    else {
        panic!("the permit is node 3's")
    };
    assert!(handle(&mut state, tile(OTHER, 1, 0.5)).is_empty());
    assert_eq!(handle(&mut state, tile(NODE, 1, 0.5)).len(), 2, "the other one is served");
}

#[test]
fn a_damaged_tile_is_refused_and_its_connection_closed_after_the_reply() {
    let mut state = serving();
    let tile = TilePixels { tile: TileId(0), attempt: Attempt(0), permit: KEY.permit(claim(3, 0)), crc32c: 1 };
    let actions = handle(
        &mut state,
        Event::Received(NODE, Incoming { tile: tile.clone(), planes: Bytes::from_static(&[0; 12]) }),
    );
    let [Action::Send(NODE, Outgoing(ImageReply::Refused(why))), Action::Close(NODE), Action::Report(_)] = &actions[..]
    else {
        panic!("refused")
    };
    assert!(why.contains("its pixels have crc32c"), "{why}");
    let forged = TilePixels { permit: Mac::default(), ..tile };
    let event = Event::Received(NODE, Incoming { tile: forged, planes: Bytes::new() });
    assert!(handle(&mut state, event).is_empty(), "it is gone");
}

#[test]
fn the_image_is_written_once_its_nodes_are_gone_and_the_totals_are_the_last_word() {
    let mut state = serving();
    accept(&mut state, OTHER, 4);
    handle(&mut state, tile(NODE, 1, 0.5));
    let mut actions = handle(&mut state, Event::Command(DisplayCommand::Finish));
    let Some(Action::Task(Task::Write(composition))) = actions.pop() else { panic!("the image comes last") };
    assert!(matches!(&actions[..], [Action::Close(NODE), Action::Close(OTHER)]));
    assert_eq!(composition.finish().tiles_done, 1);
    for event in [Event::Command(DisplayCommand::Finish), tile(NODE, 0, 0.5), Event::Closed(NODE, None), configure()] {
        assert!(handle(&mut state, event).is_empty(), "it writes");
    }
    let actions = handle(&mut state, Event::Answer(Answer::Written(Ok(totals()))));
    assert!(
        matches!(&actions[..], [Action::Report(DisplayReport::Finished(told)), Action::End(Ok(()))] if *told == totals())
    );
    for event in [Event::Failed("late".to_owned()), configure(), Event::Answer(Answer::Written(Ok(totals())))] {
        assert!(handle(&mut state, event).is_empty(), "it is over");
    }
}

#[test]
fn a_journal_or_an_image_that_cannot_be_written_ends_the_display_with_the_reason() {
    let failure = || Event::Failed("tiles: no space left".to_owned());
    for mut state in [State::new(RUN), restoring().0, serving()] {
        assert_eq!(failed(&handle(&mut state, failure())), "tiles: no space left");
        assert!(handle(&mut state, failure()).is_empty() && handle(&mut state, tile(NODE, 1, 0.5)).is_empty());
    }
    let mut state = serving();
    handle(&mut state, Event::Command(DisplayCommand::Finish));
    let actions = handle(&mut state, Event::Answer(Answer::Written(Err("cannot write the image: full".to_owned()))));
    assert_eq!(failed(&actions), "cannot write the image: full");
}

#[test]
fn frames_are_as_long_as_the_image_s_tiles_and_empty_before_it_is_known() {
    let node = Role::Node(NodeId(3));
    assert_eq!(State::new(RUN).frame_bytes_max(node), TilePixels::BYTES_MAX);
    assert_eq!(serving().frame_bytes_max(node), TilePixels::BYTES_MAX + 12);
}
