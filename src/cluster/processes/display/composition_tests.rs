//! The display's decisions, event by event.

use super::composition::{Action, Composition, Event, Finished, Source};
use crate::journal::Record;
use crate::processes::driver::ConnectionId;
use crate::protocol::control::{Comparison, DisplayConfiguration, DisplayReport, PRODUCERS_MAX, TileSet};
use crate::protocol::image::{ImageReply, TilePixels};
use crate::protocol::mac::{Claim, Mac, MacKey};
use ground::ids::{Attempt, Epoch, NodeId, Producer, RunId, TileId};
use trace::picture::{AovSet, Pixels, Sides, Tiling};

const NODE: ConnectionId = ConnectionId::Accepted(3);
const SOURCE: Source = (NodeId(7), Epoch(1));
const OTHER: Source = (NodeId(8), Epoch(0));
const RUN: RunId = RunId(1);
const EARLIER: RunId = RunId(0);
const KEY: MacKey = MacKey::new([9; 32]);
/// Pixels of each tile.
const SIZES: [usize; 4] = [6, 4, 6, 4];

fn configuration() -> DisplayConfiguration {
    DisplayConfiguration {
        tiling: Tiling::new(Sides { width: 5, height: 4, tile_width: 3, tile_height: 2 }).expect("possible"),
        aov: AovSet { depth: true, ..AovSet::default() },
        journal: "tiles".into(),
        resume: false,
        fingerprint: [0; 32],
        key: KEY,
        image: "image.png".into(),
        exr: false,
    }
}

fn state() -> Composition {
    Composition::new(&configuration(), RUN).expect("a small image")
}

fn producer((node, epoch): Source) -> Producer {
    Producer { run: RUN, node, epoch }
}

/// A tile of one colour.
fn planes(tile: u32, grey: f32) -> Vec<u8> {
    let pixels = SIZES[tile as usize];
    let mut bytes = Vec::new();
    Pixels { colour: vec![[grey; 3]; pixels], depth: vec![1.0; pixels], ..Pixels::default() }.write_bytes(&mut bytes);
    bytes
}

fn claim((node, epoch): Source, tile: u32, attempt: u32) -> Claim {
    Claim { tile: TileId(tile), attempt: Attempt(attempt), node, epoch }
}

fn send<'a>(state: &mut Composition, source: Source, tile: u32, attempt: u32, bytes: &'a [u8]) -> Vec<Action<'a>> {
    send_by(state, source, (tile, attempt), KEY.permit(claim(source, tile, attempt)), bytes)
}

fn send_by<'a>(
    state: &mut Composition,
    source: Source,
    (tile, attempt): (u32, u32),
    permit: Mac,
    bytes: &'a [u8],
) -> Vec<Action<'a>> {
    let tile = TilePixels { tile: TileId(tile), attempt: Attempt(attempt), permit, crc32c: crc32c::crc32c(bytes) };
    state.handle(Event::Tile { from: NODE, source, tile, bytes })
}

fn acknowledged(source: Source, tile: u32, attempt: u32) -> Action<'static> {
    let receipt = KEY.receipt(claim(source, tile, attempt));
    Action::Reply(NODE, ImageReply::Acknowledged { tile: TileId(tile), attempt: Attempt(attempt), receipt })
}

fn kept(source: Source, tile: u32, attempt: u32, planes: &[u8]) -> Vec<Action<'_>> {
    let producer = producer(source);
    let record = Record::Pixels { tile: TileId(tile), attempt: Attempt(attempt), producer, planes };
    vec![Action::Append(record), acknowledged(source, tile, attempt)]
}

fn compared(actions: &[Action]) -> Comparison {
    match actions {
        [Action::Report(DisplayReport::Compared(comparison)), Action::Reply(NODE, ImageReply::Acknowledged { .. })] => {
            *comparison
        }
        other => panic!("not compared: {other:?}"),
    }
}

fn forged(actions: &[Action]) -> String {
    match actions {
        [Action::Dismiss(NODE), Action::Report(DisplayReport::Forged { why, .. })] => why.clone(),
        other => panic!("not taken for a forgery: {other:?}"),
    }
}

fn tiles(chosen: [u32; 4]) -> TileSet {
    chosen.iter().map(|chosen| *chosen == 1).collect()
}

/// A record that owns its planes; `None`: condemned.
type Owned = (Producer, Option<(TileId, Attempt, Vec<u8>)>);

/// Keeps a journal of what is appended, in memory.
#[derive(Default)]
struct Journal(Vec<Owned>);

impl Journal {
    fn append(&mut self, actions: &[Action]) {
        let records = actions.iter().filter_map(|action| match *action {
            Action::Append(Record::Pixels { tile, attempt, producer, planes }) => {
                Some((producer, Some((tile, attempt, planes.to_vec()))))
            }
            Action::Append(Record::Condemned(producer)) => Some((producer, None)),
            _ => None,
        });
        self.0.extend(records);
    }

    /// What a display of this run begins with; the records are an earlier run's, if `run` is another.
    fn restored(&self, run: RunId) -> Composition {
        let mut state = state();
        for (producer, pixels) in &self.0 {
            let producer = Producer { run, ..*producer };
            state.restore(&match pixels {
                Some((tile, attempt, planes)) => Record::Pixels { tile: *tile, attempt: *attempt, producer, planes },
                None => Record::Condemned(producer),
            });
        }
        state
    }
}

#[test]
fn a_tile_is_kept_once_and_acknowledged_always() {
    let mut state = state();
    let (first, later) = (planes(0, 0.25), planes(0, 0.75));
    assert_eq!(send(&mut state, SOURCE, 0, 0, &first), kept(SOURCE, 0, 0, &first));
    assert_eq!(send(&mut state, SOURCE, 0, 0, &first), [acknowledged(SOURCE, 0, 0)], "sent again");
    compared(&send(&mut state, OTHER, 0, 1, &later));
    let Finished { frame, tiles_done, tiles_stale } = state.finish();
    assert_eq!((tiles_done, tiles_stale), (1, 1));
    assert_eq!(frame.pixels().colour[0], [0.25; 3]);
    assert_eq!(frame.pixels().colour[3], [0.0; 3]);
}

#[test]
fn a_later_result_is_compared_with_the_first() {
    let mut state = state();
    let (first, other) = (planes(1, 0.25), planes(1, f32::from_bits(0.25f32.to_bits() ^ 1)));
    send(&mut state, SOURCE, 1, 4, &first);
    let same = compared(&send(&mut state, OTHER, 1, 2, &first));
    assert_eq!((same.tile, same.kept.producer, same.other.producer), (TileId(1), producer(SOURCE), producer(OTHER)));
    assert_eq!(same.kept.digest, same.other.digest);
    let different = compared(&send(&mut state, OTHER, 1, 5, &other));
    assert_eq!(different.kept.digest, same.kept.digest);
    assert_ne!(different.other.digest, same.kept.digest, "one bit is enough");
}

#[test]
fn a_process_sends_only_what_the_master_handed_to_it() {
    let mut state = state();
    let bytes = planes(0, 0.5);
    let permit = KEY.permit(claim(SOURCE, 0, 0));
    // Another attempt, another tile, another process, no permit at all, a receipt in its place.
    let cases = [
        (SOURCE, (0, 1), permit),
        (SOURCE, (2, 0), permit),
        (OTHER, (0, 0), permit),
        ((NodeId(7), Epoch(2)), (0, 0), permit),
        (SOURCE, (0, u32::MAX), Mac::default()),
        (SOURCE, (0, 0), KEY.receipt(claim(SOURCE, 0, 0))),
    ];
    for (source, job, permit) in cases {
        let why = forged(&send_by(&mut state, source, job, permit, &bytes));
        assert!(why.ends_with("the master did not hand it to this process"), "{why}");
    }
    assert_eq!(state.holdings().tiles, tiles([0; 4]));
    assert_eq!(send(&mut state, SOURCE, 0, 0, &bytes), kept(SOURCE, 0, 0, &bytes));
}

#[test]
fn an_attempt_has_one_result() {
    let mut state = state();
    send(&mut state, SOURCE, 0, 0, &planes(0, 0.5));
    let why = forged(&send(&mut state, SOURCE, 0, 0, &planes(0, 0.25)));
    assert_eq!(why, "tile 0, attempt 0: it was sent twice, with different pixels");
}

#[test]
fn colours_that_are_not_finite_are_a_forgery() {
    let mut state = state();
    for (i, wrong) in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY].into_iter().enumerate() {
        let mut bytes = planes(0, f32::MAX);
        bytes[4 * i..4 * i + 4].copy_from_slice(&wrong.to_le_bytes());
        assert!(forged(&send(&mut state, SOURCE, 0, 0, &bytes)).contains("not finite"), "{wrong}");
    }
    // A depth may be more than an f32 can say.
    let mut bytes = planes(0, f32::MAX);
    let depth = bytes.len() - 4;
    bytes[depth..].copy_from_slice(&f32::INFINITY.to_le_bytes());
    assert_eq!(send(&mut state, SOURCE, 0, 0, &bytes), kept(SOURCE, 0, 0, &bytes));
}

#[test]
fn all_tiles_of_a_condemned_process_are_taken_out_whatever_their_attempts() {
    let mut state = state();
    let empty = self::state().finish().frame;
    for (source, tile, attempt) in [(SOURCE, 0, 0), (SOURCE, 3, u32::MAX), (OTHER, 1, 7)] {
        send(&mut state, source, tile, attempt, &planes(tile, 0.5));
    }
    let wrong = producer(SOURCE);
    let told = |taken_out| Action::Report(DisplayReport::Condemned(wrong, taken_out));
    let actions = state.handle(Event::Condemn(wrong));
    assert_eq!(actions, [Action::Append(Record::Condemned(wrong)), told(tiles([1, 0, 0, 1]))]);
    assert_eq!(state.handle(Event::Condemn(wrong)), [told(TileSet::default())], "appended once");
    assert_eq!(state.holdings().tiles, tiles([0, 1, 0, 0]));
    // What it still sends is not taken, though it was handed to it.
    assert_eq!(send(&mut state, SOURCE, 2, 0, &planes(2, 0.5)), [Action::Dismiss(NODE)]);
    let right = planes(0, 0.25);
    assert_eq!(send(&mut state, OTHER, 0, 1, &right), kept(OTHER, 0, 1, &right));
    let Finished { frame, tiles_done, tiles_stale } = state.finish();
    assert_eq!((tiles_done, tiles_stale, frame.pixels().colour[0]), (2, 1, [0.25; 3]));
    assert_eq!(frame.pixels().colour[4 * 5 - 1], empty.pixels().colour[4 * 5 - 1], "nothing is left of tile 3");
}

#[test]
fn a_condemnation_outlives_a_restart_and_its_run() {
    let (mut first, mut journal) = (state(), Journal::default());
    let (wrong, right) = (planes(0, 0.5), planes(0, 0.25));
    journal.append(&send(&mut first, SOURCE, 0, 5, &wrong));
    journal.append(&first.handle(Event::Condemn(producer(SOURCE))));
    // A tile that was appended by a display that had not been told yet.
    let late =
        Record::Pixels { tile: TileId(1), attempt: Attempt(0), producer: producer(SOURCE), planes: &planes(1, 0.5) };
    journal.append(&[Action::Append(late)]);
    let mut restarted = journal.restored(RUN);
    assert_eq!(restarted.holdings().tiles, tiles([0; 4]));
    assert_eq!(send(&mut restarted, SOURCE, 0, 4, &wrong), [Action::Dismiss(NODE)]);
    // The same numbers in another run are another process.
    let mut resumed = journal.restored(EARLIER);
    assert_eq!(resumed.holdings().tiles, tiles([0; 4]));
    assert_eq!(send(&mut resumed, SOURCE, 0, 0, &right), kept(SOURCE, 0, 0, &right));
}

#[test]
fn it_reports_whose_pixels_are_in_the_frame() {
    let (mut first, mut journal) = (state(), Journal::default());
    for (source, tile, attempt) in [(SOURCE, 0, 0), (OTHER, 1, 0), (SOURCE, 3, 0), (SOURCE, 1, 1)] {
        // The last one is compared, and not kept.
        journal.append(&send(&mut first, source, tile, attempt, &planes(tile, 0.5)));
    }
    let shares = |state: &mut Composition| {
        let actions = state.handle(Event::TellHoldings { question: 3 });
        let [Action::Report(DisplayReport::Holdings { question: 3, holdings })] = &actions[..] else {
            panic!("{actions:?}")
        };
        assert_eq!(holdings.tiles, tiles([1, 1, 0, 1]));
        let share = |share: &crate::protocol::control::Share| (share.producer.node.0, share.tiles, share.latest.0);
        holdings.shares.iter().map(share).collect::<Vec<_>>()
    };
    assert_eq!(shares(&mut first), [(7, 2, 3), (8, 1, 1)]);
    assert_eq!(shares(&mut journal.restored(RUN)), [(7, 2, 3), (8, 1, 1)]);
    let resumed = journal.restored(EARLIER).holdings();
    assert!(resumed.shares.iter().all(|share| share.producer.run == EARLIER));
}

#[test]
fn tiles_of_more_processes_than_can_be_reported_are_rendered_again() {
    let tiling = Tiling::new(Sides { width: PRODUCERS_MAX as u32 / 2 + 1, height: 2, tile_width: 1, tile_height: 1 })
        .expect("possible");
    let aov = AovSet::default();
    let mut state =
        Composition::new(&DisplayConfiguration { tiling, aov, ..configuration() }, RUN).expect("a small image");
    for tile in 0..=PRODUCERS_MAX as u32 {
        let producer = Producer { run: RunId(u64::from(tile)), ..Producer::default() };
        state.restore(&Record::Pixels { tile: TileId(tile), attempt: Attempt(0), producer, planes: &[0; 12] });
    }
    let holdings = state.holdings();
    assert_eq!(holdings.shares.len(), PRODUCERS_MAX);
    assert!(!holdings.tiles.contains(TileId(PRODUCERS_MAX as u32)));
    let report = DisplayReport::Restored(holdings);
    crate::protocol::frame::encode(&report, &[]).expect("fits a message");
}

#[test]
fn the_order_of_tiles_does_not_change_the_hash_nor_does_a_restart_at_any_point() {
    let all: Vec<Vec<u8>> = (0..4).map(|tile| planes(tile, tile as f32)).collect();
    let hash = |order: [u32; 4], restart: usize| {
        let (mut state, mut journal) = (state(), Journal::default());
        for (i, tile) in order.into_iter().enumerate() {
            if i == restart {
                state = journal.restored(RUN);
                assert_eq!((0..4).filter(|tile| state.holdings().tiles.contains(TileId(*tile))).count(), i);
            }
            journal.append(&send(&mut state, SOURCE, tile, 0, &all[tile as usize]));
        }
        // What was not acknowledged before the restart comes again.
        for tile in order {
            assert_eq!(send(&mut state, SOURCE, tile, 0, &all[tile as usize]), [acknowledged(SOURCE, tile, 0)]);
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
fn a_tile_of_an_earlier_run_is_compared_and_taken_out_with_its_process() {
    let (mut first, mut journal) = (state(), Journal::default());
    let (wrong, right) = (planes(0, 0.5), planes(0, 0.25));
    journal.append(&send(&mut first, SOURCE, 0, 5, &wrong));
    let mut resumed = journal.restored(EARLIER);
    // The same numbers, but another process.
    let comparison = compared(&send(&mut resumed, SOURCE, 0, 5, &right));
    let earlier = Producer { run: EARLIER, ..producer(SOURCE) };
    assert_eq!((comparison.kept.producer, comparison.other.producer), (earlier, producer(SOURCE)));
    resumed.handle(Event::Condemn(earlier));
    assert_eq!(send(&mut resumed, OTHER, 0, 2, &right).len(), 2);
    assert_eq!(resumed.finish().frame.pixels().colour[0], [0.25; 3]);
}

#[test]
fn tiles_come_from_the_nodes_of_all_clusters() {
    let mut state = state();
    for tile in 0..4 {
        let bytes = planes(tile, 0.5);
        let source = (NodeId(tile as u16 * 100), Epoch(tile));
        assert_eq!(send(&mut state, source, tile, 0, &bytes), kept(source, tile, 0, &bytes));
    }
    assert_eq!(state.holdings().tiles, tiles([1; 4]));
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
    let permit = KEY.permit(claim(SOURCE, 0, 2));
    let torn = TilePixels { tile: TileId(0), attempt: Attempt(2), permit, crc32c: 1 };
    let actions = state.handle(Event::Tile { from: NODE, source: SOURCE, tile: torn, bytes: &bytes });
    assert!(refusal(&actions).starts_with("tile 0, attempt 2: its pixels have crc32c"));
    assert_eq!(state.finish().tiles_done, 0);
}
