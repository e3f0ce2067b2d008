//! The display's decisions, event by event.

use super::state::{Action, ConnectionId, Event, Finished, Source, State};
use crate::ids::{Attempt, Epoch, NodeId, TileId};
use crate::journal::{Record, RunId};
use crate::protocol::control::{Comparison, DisplayConfiguration, DisplayReport, Revocation};
use crate::protocol::image::{ImageReply, TilePixels};
use crate::tracer::{AovSet, Pixels, Tiling};

const NODE: ConnectionId = ConnectionId(3);
const SOURCE: Source = (NodeId(7), Epoch(1));
const OTHER: Source = (NodeId(8), Epoch(0));
const RUN: RunId = RunId(1);
const EARLIER: RunId = RunId(0);
/// Pixels of each tile.
const SIZES: [usize; 4] = [6, 4, 6, 4];

fn configuration() -> DisplayConfiguration {
    DisplayConfiguration {
        tiling: Tiling { width: 5, height: 4, tile_width: 3, tile_height: 2 },
        aov: AovSet { depth: true, ..AovSet::default() },
        journal: "tiles".into(),
        resume: false,
        fingerprint: [0; 32],
        image: "image.png".into(),
        exr: false,
    }
}

fn state() -> State {
    State::new(&configuration(), RUN).expect("a small image")
}

/// A tile of one colour.
fn planes(tile: u32, grey: f32) -> Vec<u8> {
    let pixels = SIZES[tile as usize];
    let mut bytes = Vec::new();
    Pixels { colour: vec![[grey; 3]; pixels], depth: vec![1.0; pixels], ..Pixels::default() }.write_bytes(&mut bytes);
    bytes
}

fn send<'a>(state: &mut State, source: Source, tile: u32, attempt: u32, bytes: &'a [u8]) -> Vec<Action<'a>> {
    let tile = TilePixels { tile: TileId(tile), attempt: Attempt(attempt), crc32c: crc32c::crc32c(bytes) };
    state.handle(Event::Tile { from: NODE, source, tile, bytes })
}

fn acknowledged(tile: u32, attempt: u32) -> Action<'static> {
    Action::Reply(NODE, ImageReply::Acknowledged { tile: TileId(tile), attempt: Attempt(attempt) })
}

fn record(tile: u32, attempt: u32, planes: &[u8]) -> Record<'_> {
    Record::Pixels { tile: TileId(tile), attempt: Attempt(attempt), source: SOURCE, planes }
}

fn kept(tile: u32, attempt: u32, planes: &[u8]) -> Vec<Action<'_>> {
    vec![Action::Append(record(tile, attempt, planes)), acknowledged(tile, attempt)]
}

fn revocation(tile: u32, attempt: u32) -> Revocation {
    Revocation { tile: TileId(tile), attempt: Attempt(attempt) }
}

fn compared(actions: &[Action]) -> Comparison {
    match actions {
        [Action::Report(DisplayReport::Compared(comparison)), Action::Reply(NODE, ImageReply::Acknowledged { .. })] => {
            *comparison
        }
        other => panic!("not compared: {other:?}"),
    }
}

/// A record that owns its planes; `None`: revoked.
type Owned = (TileId, Attempt, Option<(Source, Vec<u8>)>);

/// Keeps a journal of what is appended, in memory.
#[derive(Default)]
struct Journal(Vec<Owned>);

impl Journal {
    fn append(&mut self, actions: &[Action]) {
        let records = actions.iter().filter_map(|action| match *action {
            Action::Append(Record::Pixels { tile, attempt, source, planes }) => {
                Some((tile, attempt, Some((source, planes.to_vec()))))
            }
            Action::Append(Record::Revoked { tile, attempt }) => Some((tile, attempt, None)),
            _ => None,
        });
        self.0.extend(records);
    }

    fn restored(&self, run: RunId) -> State {
        let mut state = state();
        for (tile, attempt, pixels) in &self.0 {
            let (tile, attempt) = (*tile, *attempt);
            let record = match pixels {
                Some((source, planes)) => Record::Pixels { tile, attempt, source: *source, planes },
                None => Record::Revoked { tile, attempt },
            };
            state.restore(run, &record);
        }
        state
    }
}

#[test]
fn a_tile_is_kept_once_and_acknowledged_always() {
    let mut state = state();
    let (first, later) = (planes(0, 0.25), planes(0, 0.75));
    assert_eq!(send(&mut state, SOURCE, 0, 0, &first), kept(0, 0, &first));
    assert_eq!(send(&mut state, SOURCE, 0, 0, &first), [acknowledged(0, 0)], "sent again");
    compared(&send(&mut state, OTHER, 0, 1, &later));
    let Finished { frame, tiles_done, tiles_stale } = state.finish();
    assert_eq!((tiles_done, tiles_stale), (1, 1));
    assert_eq!(frame.pixels().colour[0], [0.25; 3]);
    assert_eq!(frame.pixels().colour[3], [0.0; 3]);
}

#[test]
fn a_later_result_is_held_against_the_first() {
    let mut state = state();
    let (first, other) = (planes(1, 0.25), planes(1, f32::from_bits(0.25f32.to_bits() ^ 1)));
    send(&mut state, SOURCE, 1, 4, &first);
    let same = compared(&send(&mut state, OTHER, 1, 2, &first));
    assert_eq!((same.tile, same.kept.attempt, same.other.attempt), (TileId(1), Attempt(4), Attempt(2)));
    assert_eq!((same.kept.source, same.other.source), (Some(SOURCE), Some(OTHER)));
    assert_eq!(same.kept.digest, same.other.digest);
    let different = compared(&send(&mut state, OTHER, 1, 5, &other));
    assert_eq!(different.kept.digest, same.kept.digest);
    assert_ne!(different.other.digest, same.kept.digest, "one bit is enough");
}

#[test]
fn what_is_revoked_is_taken_anew() {
    let mut state = state();
    let (wrong, right) = (planes(0, 0.5), planes(0, 0.25));
    send(&mut state, SOURCE, 0, 1, &wrong);
    let revoked = vec![revocation(0, 2), revocation(3, 0), revocation(99, 0)];
    let actions = state.handle(Event::Revoke(revoked.clone()));
    let appended = |tile, attempt| Action::Append(Record::Revoked { tile: TileId(tile), attempt: Attempt(attempt) });
    assert_eq!(actions, [appended(0, 2), appended(3, 0), Action::Report(DisplayReport::Revoked(revoked.clone()))]);
    assert_eq!(state.restored(), [0]);
    // Told twice, it is appended once.
    let again = state.handle(Event::Revoke(revoked.clone()));
    assert_eq!(again, [Action::Report(DisplayReport::Revoked(revoked))]);
    // Attempts that were under way are dropped; the next is taken.
    assert_eq!(send(&mut state, SOURCE, 0, 2, &wrong), [acknowledged(0, 2)]);
    assert_eq!(send(&mut state, OTHER, 3, 0, &planes(3, 1.0)), [acknowledged(3, 0)]);
    let actions = send(&mut state, SOURCE, 0, 3, &right);
    assert_eq!(actions, kept(0, 3, &right));
    // A revocation of earlier attempts leaves it alone.
    state.handle(Event::Revoke(vec![revocation(0, 2)]));
    let Finished { frame, tiles_done, tiles_stale } = state.finish();
    assert_eq!((tiles_done, tiles_stale, frame.pixels().colour[0]), (1, 2, [0.25; 3]));
}

#[test]
fn it_knows_whose_pixels_are_in_the_frame() {
    let (mut first, mut journal) = (state(), Journal::default());
    journal.append(&send(&mut first, SOURCE, 0, 0, &planes(0, 0.5)));
    journal.append(&send(&mut first, OTHER, 1, 0, &planes(1, 0.5)));
    journal.append(&send(&mut first, SOURCE, 3, 0, &planes(3, 0.5)));
    // Compared, and not kept.
    journal.append(&send(&mut first, SOURCE, 1, 1, &planes(1, 0.5)));
    let tiles_of = |state: &mut State, (node, epoch): Source, tiles: u8| {
        let told = DisplayReport::TilesOf(node, epoch, vec![tiles]);
        assert_eq!(state.handle(Event::TilesOf((node, epoch))), [Action::Report(told)]);
    };
    let mut restarted = journal.restored(RUN);
    for state in [&mut first, &mut restarted] {
        tiles_of(state, SOURCE, 0b1001);
        tiles_of(state, OTHER, 0b10);
    }
    tiles_of(&mut journal.restored(EARLIER), SOURCE, 0);
}

#[test]
fn a_revoked_tile_leaves_no_trace_in_a_partial_image() {
    let mut state = state();
    let empty = self::state().finish().frame;
    send(&mut state, SOURCE, 2, 0, &planes(2, 0.5));
    state.handle(Event::Revoke(vec![revocation(2, 0)]));
    assert_eq!(state.finish().frame.pixels(), empty.pixels());
}

#[test]
fn the_order_of_tiles_does_not_change_the_hash_nor_does_a_restart_at_any_point() {
    let all: Vec<Vec<u8>> = (0..4).map(|tile| planes(tile, tile as f32)).collect();
    let hash = |order: [u32; 4], restart: usize| {
        let (mut state, mut journal) = (state(), Journal::default());
        for (i, tile) in order.into_iter().enumerate() {
            if i == restart {
                state = journal.restored(RUN);
                assert_eq!(state.restored()[0].count_ones() as usize, i);
            }
            journal.append(&send(&mut state, SOURCE, tile, 0, &all[tile as usize]));
        }
        // What was not acknowledged before the restart comes again.
        for tile in order {
            assert_eq!(send(&mut state, SOURCE, tile, 0, &all[tile as usize]), [acknowledged(tile, 0)]);
        }
        let Finished { frame, tiles_done, tiles_stale } = state.finish();
        assert_eq!((tiles_done, tiles_stale), (4, 0));
        frame.sha256()
    };
    let expected = hash([0, 1, 2, 3], 4);
    assert_eq!(expected.len(), 64);
    for restart in 0..=4 {
        assert_eq!(hash([3, 1, 0, 2], restart), expected);
    }
}

#[test]
fn revocations_outlive_a_restart_and_not_their_run() {
    let (mut first, mut journal) = (state(), Journal::default());
    let (wrong, right) = (planes(0, 0.5), planes(0, 0.25));
    journal.append(&send(&mut first, SOURCE, 0, 5, &wrong));
    journal.append(&first.handle(Event::Revoke(vec![revocation(0, 5)])));
    let mut restarted = journal.restored(RUN);
    assert_eq!(send(&mut restarted, SOURCE, 0, 4, &wrong), [acknowledged(0, 4)]);
    // Another run counts its attempts from 0.
    let mut resumed = journal.restored(EARLIER);
    assert_eq!(resumed.restored(), [0]);
    assert_eq!(send(&mut resumed, SOURCE, 0, 0, &right), kept(0, 0, &right));
}

#[test]
fn a_tile_of_an_earlier_run_is_compared_and_revoked_whatever_its_attempt() {
    let (mut first, mut journal) = (state(), Journal::default());
    let (wrong, right) = (planes(0, 0.5), planes(0, 0.25));
    journal.append(&send(&mut first, SOURCE, 0, 5, &wrong));
    let mut resumed = journal.restored(EARLIER);
    assert_eq!(resumed.restored(), [1]);
    // The same numbers, but another process.
    let comparison = compared(&send(&mut resumed, SOURCE, 0, 5, &right));
    assert_eq!((comparison.kept.source, comparison.other.source), (None, Some(SOURCE)));
    resumed.handle(Event::Revoke(vec![revocation(0, 1)]));
    assert_eq!(send(&mut resumed, OTHER, 0, 2, &right).len(), 2);
    assert_eq!(resumed.finish().frame.pixels().colour[0], [0.25; 3]);
}

#[test]
fn tiles_come_from_the_nodes_of_all_clusters() {
    let mut state = state();
    for tile in 0..4 {
        let bytes = planes(tile, 0.5);
        let source = (NodeId(tile as u16 * 100), Epoch(tile));
        let actions = send(&mut state, source, tile, 0, &bytes);
        assert!(matches!(actions[0], Action::Append(Record::Pixels { source: of, .. }) if of == source));
    }
    assert_eq!(state.restored(), [0b1111]);
}

#[test]
fn what_is_not_a_tiles_pixels_is_refused() {
    fn refusal(actions: &[Action]) -> String {
        match actions {
            [Action::Reply(NODE, ImageReply::Refused(why)), Action::Dismiss(NODE), Action::Report(_)] => why.clone(),
            other => panic!("no refusal: {other:?}"),
        }
    }
    let mut state = state();
    let bytes = planes(0, 0.0);
    assert!(refusal(&send(&mut state, SOURCE, 4, 0, &bytes)).contains("the image has 4 tiles"));
    // The right column's tiles are 2 pixels wide.
    assert!(refusal(&send(&mut state, SOURCE, 1, 0, &bytes)).ends_with("its pixels have 96 bytes, expected 64"));
    let torn = TilePixels { tile: TileId(0), attempt: Attempt(2), crc32c: 1 };
    let actions = state.handle(Event::Tile { from: NODE, source: SOURCE, tile: torn, bytes: &bytes });
    assert!(refusal(&actions).starts_with("tile 0, attempt 2: its pixels have crc32c"));
    assert_eq!(state.finish().tiles_done, 0);
}
