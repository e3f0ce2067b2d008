//! A node from its first command to its end, in numbers.

use super::*;
use crate::protocol::work::{TileDone, jobs_per_node};
use glam::DVec3;
use ground::ids::NodeId;
use machine::hardware::specification::{LocalMemory, MemorySize, Replacement};
use trace::database::{Header, Layout, Normalisation, Section};
use trace::picture::{AovSet, ImageSettings, Sides, Tiling};
use trace::scene::Camera;
use trace::tracer::octree::Octree;
use trace::tracer::{TraceStats, View};

const DISPLAY: ConnectionId = ConnectionId::Dialled(1);

fn configuration() -> NodeConfiguration {
    let camera = Camera { from: DVec3::ZERO, at: DVec3::Z, up: DVec3::Y, angle_degrees: 45.0, resolution: None };
    let address = |port| ([127, 0, 0, 1], port).into();
    NodeConfiguration {
        cluster: ClusterId(0),
        master: address(1),
        bus: address(2),
        display: address(3),
        header: Header {
            layout: Layout::new([8; Section::COUNT]).expect("small"),
            normalisation: Normalisation::new(None),
            max_depth: 12,
            scene_primitives: 1,
            has_sheets: false,
        },
        view: View {
            camera,
            lights: Vec::new(),
            background: DVec3::ZERO,
            image: ImageSettings::new(8, 1, 4, 0.0).expect("possible"),
        },
        tiling: Tiling::new(Sides { width: 8, height: 1, tile_width: 1, tile_height: 1 }).expect("possible"),
        aov: AovSet::default(),
        octree: Octree { leaf_size: 8, max_depth: 12, mailbox: true },
        local_memory: LocalMemory { size: MemorySize::All, line: 64, ways: None, replacement: Replacement::Lru },
        threads: 1,
        seed: 1,
        references: None,
    }
}

fn at(state: &mut State, seconds: u64, event: Event) -> Vec<Action> {
    state.handle(Duration::from_secs(seconds), event)
}

fn configured() -> State {
    let mut state = State::new(Role::Node(NodeId(0)));
    let actions = at(&mut state, 0, Event::Command(NodeCommand::Configure(Box::new(configuration()))));
    let is_begun = matches!(
        &actions[..],
        [
            Action::Dial { id: MASTER, role: Role::Master(_), .. },
            Action::Dial { id: DISPLAY, role: Role::Display, .. },
            Action::Task(Task::Start(_)),
        ]
    );
    assert!(is_begun);
    state
}

/// The outcome of the last action, if it is the end, and what was reported before it.
fn end(actions: &[Action]) -> Option<(&NodeReport, &Result<(), String>)> {
    match actions {
        [.., Action::Report(report), Action::End(outcome)] => Some((report, outcome)),
        _ => None,
    }
}

fn traced() -> Event {
    let done = Box::new(TileDone {
        tile: TileId(0),
        attempt: Attempt(0),
        trace: TraceStats::default(),
        memory: None,
        render_cpu_nanoseconds: 1,
    });
    let pixels = Arc::new(Pixels { colour: vec![[0.5; 3]], ..Pixels::default() });
    Event::Answer(Answer::Traced(Traced { done, pixels, permit: Mac::default() }))
}

/// With a tile in the tracer.
fn working() -> State {
    let mut state = configured();
    at(&mut state, 1, Event::Dialled(MASTER));
    at(&mut state, 1, Event::Dialled(DISPLAY));
    at(&mut state, 1, Event::Answer(Answer::Ready(None)));
    let job = WorkReply::Job { tile: TileId(0), attempt: Attempt(0), permit: Mac::default() };
    let actions = at(&mut state, 1, Event::Received(MASTER, Incoming::Work(job)));
    assert!(matches!(&actions[..], [Action::Task(Task::Trace(_))]));
    state
}

#[test]
fn tiles_are_asked_for_when_the_master_is_reached_and_the_tracer_ready_whichever_is_first() {
    for events in [
        [Event::Dialled(MASTER), Event::Answer(Answer::Ready(None))],
        [Event::Answer(Answer::Ready(None)), Event::Dialled(MASTER)],
    ] {
        let mut state = configured();
        let [first, second] = events.map(|event| at(&mut state, 1, event).len());
        assert_eq!((first, second), (0, jobs_per_node(1)));
    }
}

#[test]
fn a_display_that_owes_something_for_30_s_ends_the_node_with_the_reason() {
    let mut state = configured();
    assert_eq!(state.next_deadline(), Some(ACKNOWLEDGE_DEADLINE));
    let loss = Loss { why: "display at 127.0.0.1:3: nobody".to_owned(), is_breach: false };
    let actions = at(&mut state, 5, Event::Closed(DISPLAY, Some(loss)));
    assert!(matches!(&actions[..], [Action::Close(DISPLAY), Action::Dial { id: ConnectionId::Dialled(2), .. }]));
    assert!(at(&mut state, 29, Event::Deadline).is_empty());
    let actions = at(&mut state, 30, Event::Deadline);
    let why = "no display for 30 s: display at 127.0.0.1:3: nobody".to_owned();
    assert_eq!(end(&actions), Some((&NodeReport::Failed(why.clone()), &Err(why))));
    assert_eq!(state.next_deadline(), None);

    let mut state = working();
    assert_eq!(state.next_deadline(), None, "the display owes nothing");
    assert!(matches!(&at(&mut state, 40, traced())[..], [Action::Send(DISPLAY, Outgoing::Pixels { .. })]));
    let actions = at(&mut state, 70, Event::Deadline);
    let why = "the display acknowledged nothing for 30 s".to_owned();
    assert_eq!(end(&actions), Some((&NodeReport::Failed(why.clone()), &Err(why))));
}

#[test]
fn a_node_that_is_asked_to_go_goes_with_its_last_tile_or_after_25_s() {
    let mut state = State::new(Role::Node(NodeId(0)));
    assert_eq!(end(&at(&mut state, 0, Event::Terminate)), Some((&NodeReport::Leaving, &Ok(()))));
    let mut state = working();
    assert!(at(&mut state, 2, Event::Terminate).is_empty());
    assert!(at(&mut state, 9, Event::Terminate).is_empty(), "once more");
    assert_eq!(state.next_deadline(), Some(Duration::from_secs(2) + LEAVE_DEADLINE));
    assert_eq!(end(&at(&mut state, 27, Event::Deadline)), Some((&NodeReport::Leaving, &Ok(()))));

    let mut state = working();
    at(&mut state, 2, Event::Terminate);
    at(&mut state, 3, traced());
    let (tile, attempt, receipt) = (TileId(0), Attempt(0), Mac::default());
    let reply = ImageReply::Acknowledged { tile, attempt, receipt };
    let actions = at(&mut state, 4, Event::Received(DISPLAY, Incoming::Image(reply)));
    assert!(matches!(&actions[0], Action::Send(MASTER, Outgoing::Work(WorkRequest::Done { .. }))));
    assert_eq!(end(&actions), Some((&NodeReport::Leaving, &Ok(()))));
}

#[test]
fn a_connection_that_was_replaced_says_nothing_any_more() {
    let mut state = working();
    let address = ([127, 0, 0, 1], 4).into();
    let actions = at(&mut state, 2, Event::Command(NodeCommand::Display(address)));
    assert!(matches!(&actions[..], [Action::Close(DISPLAY), Action::Dial { id: ConnectionId::Dialled(2), .. }]));
    let refused = Incoming::Image(ImageReply::Refused("late".to_owned()));
    assert!(at(&mut state, 3, Event::Received(DISPLAY, refused)).is_empty());
    assert!(at(&mut state, 3, Event::Closed(DISPLAY, None)).is_empty());
}

#[test]
fn a_master_that_leaves_and_a_tracer_that_fails_end_the_node() {
    let ends = |event| {
        let actions = at(&mut working(), 2, event);
        end(&actions).map(|(_, outcome)| outcome.clone().expect_err("an error"))
    };
    assert_eq!(ends(Event::Closed(MASTER, None)).as_deref(), Some("the master closed the connection"));
    assert_eq!(ends(Event::Answer(Answer::Failed("no bus".to_owned()))).as_deref(), Some("tracer: no bus"));
    assert_eq!(ends(Event::Failed("no thread".to_owned())).as_deref(), Some("tracer: no thread"));
    let mut state = working();
    assert_eq!(end(&at(&mut state, 2, Event::Command(NodeCommand::Finish))), Some((&NodeReport::Finished, &Ok(()))));
    for event in [Event::Closed(MASTER, None), Event::Command(NodeCommand::Finish), Event::Terminate] {
        assert!(at(&mut state, 3, event).is_empty(), "it is over");
    }
}

#[test]
fn a_corrupt_node_errs_from_the_command_on() {
    let colour = |is_corrupt: bool| {
        let mut state = working();
        if is_corrupt {
            at(&mut state, 2, Event::Command(NodeCommand::Corrupt));
        }
        let actions = at(&mut state, 3, traced());
        let [Action::Send(_, Outgoing::Pixels { pixels, .. })] = &actions[..] else { panic!("sent") };
        pixels.colour[0][0].to_bits()
    };
    assert_eq!(colour(false) ^ colour(true), 1);
}
