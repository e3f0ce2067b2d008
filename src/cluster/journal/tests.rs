//! What is read back is a prefix of what was written, whatever happened to the file.

use std::fs;
use std::path::{Path, PathBuf};
use std::thread;
use std::time::Duration;

use proptest::prelude::*;
use tempfile::TempDir;

use super::*;
use ground::ids::{Attempt, Epoch, NodeId, Producer, RunId, TileId};
use trace::picture::{AovSet, Pixels, Sides, Tiling};

/// Three columns, two rows; the tiles on the edges are smaller.
const TILING: Tiling = Tiling::new(Sides { width: 8, height: 5, tile_width: 3, tile_height: 3 }).expect("possible");
const AOV: AovSet = AovSet { depth: true, normal: false, primitive: false };
const SUBJECT: Subject = Subject { tiling: TILING, aov: AOV, fingerprint: [7; 32] };
const RUN: RunId = RunId(0x0123_4567_89ab_cdef);
const HEADER_BYTES: usize = 68;
const HEAD_BYTES: usize = 32;

/// A record that owns its planes; `None`: condemned, by its node and its epoch.
type Owned = (u32, u32, Option<Vec<u8>>);

fn owned(record: &Record) -> Owned {
    match *record {
        Record::Pixels { tile, attempt, planes, .. } => (tile.0, attempt.0, Some(planes.to_vec())),
        Record::Condemned(Producer { run, node, epoch }) => {
            assert_eq!(run, RUN);
            (node.0.into(), epoch.0, None)
        }
    }
}

fn borrowed((tile, attempt, planes): &Owned) -> Record<'_> {
    match planes {
        Some(planes) => {
            let producer = Producer { run: RUN, node: NodeId(3), epoch: Epoch(1) };
            Record::Pixels { tile: TileId(*tile), attempt: Attempt(*attempt), producer, planes }
        }
        None => Record::Condemned(Producer { run: RUN, node: NodeId(*tile as u16), epoch: Epoch(*attempt) }),
    }
}

fn planes_bytes(tile: u32) -> usize {
    Pixels::byte_len(TILING.rect(TileId(tile)).expect("in the image").pixel_count(), AOV)
}

fn pixels(tile: u32, attempt: u32) -> Owned {
    (tile, attempt, Some(vec![(tile + 16 * attempt) as u8; planes_bytes(tile)]))
}

fn records() -> impl Strategy<Value = Vec<Owned>> {
    let record = (0..TILING.tile_count(), any::<u32>(), any::<Option<u8>>());
    let record =
        record.prop_map(|(tile, attempt, byte)| (tile, attempt, byte.map(|byte| vec![byte; planes_bytes(tile)])));
    prop::collection::vec(record, 0..12)
}

fn record_bytes((_, _, planes): &Owned) -> usize {
    HEAD_BYTES + planes.as_ref().map_or(0, Vec::len)
}

fn folder_and_file() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("tiles");
    (folder, path)
}

/// Opens, and tells what was there and what is said.
fn resumed(path: &Path) -> Result<(Journal, Vec<Owned>, Option<String>), JournalError> {
    let mut found = Vec::new();
    let (journal, said) = Journal::open(path, &SUBJECT, true, |record| found.push(owned(record)))?;
    Ok((journal, found, said))
}

fn written(path: &Path, records: &[Owned]) -> Vec<u8> {
    let (mut journal, said) = Journal::open(path, &SUBJECT, false, |_| panic!("starts over")).expect("a new journal");
    assert_eq!(said, None);
    records.iter().for_each(|record| journal.append(&borrowed(record)).expect("room"));
    fs::read(path).expect("written")
}

fn refusal(path: &Path) -> String {
    let error = resumed(path).expect_err("refused").to_string();
    assert!(error.starts_with(&path.display().to_string()), "{error}");
    error
}

#[test]
fn records_come_back_and_more_can_follow() {
    let (_folder, path) = folder_and_file();
    let mut all = vec![pixels(0, 0), pixels(5, 1), (0, 3, None)];
    written(&path, &all);
    let (mut journal, found, said) = resumed(&path).expect("whole");
    assert_eq!((found, said), (all.clone(), None));
    all.push(pixels(0, 4));
    journal.append(&borrowed(&all[3])).expect("room");
    drop(journal);
    assert_eq!(resumed(&path).expect("whole").1, all);
}

#[test]
fn the_bytes_are_those_of_the_documentation() {
    let (_folder, path) = folder_and_file();
    let bytes = written(&path, &[pixels(1, 2)]);
    assert_eq!(bytes.len(), HEADER_BYTES + HEAD_BYTES + 9 * 16);
    assert_eq!(&bytes[..12], b"marti\0jl\x02\0\0\0");
    let words = |at: usize, count: usize| -> Vec<u32> {
        let words = bytes[at..at + 4 * count].chunks_exact(4);
        words.map(|word| u32::from_le_bytes(word.try_into().expect("four"))).collect()
    };
    assert_eq!(words(12, 5), [8, 5, 3, 3, 1]);
    assert_eq!(bytes[32..64], [7; 32]);
    assert_eq!(words(64, 1), [crc32c::crc32c(&bytes[..64])]);
    let record = &bytes[HEADER_BYTES..];
    assert_eq!(words(HEADER_BYTES, 4), [crc32c::crc32c(&record[4..]), 1, 2, 1]);
    assert_eq!(record[16..20], [3, 0, 1, 0]);
    assert_eq!(words(HEADER_BYTES + 20, 1), [9 * 16]);
    assert_eq!(record[24..32], RUN.0.to_le_bytes());
    assert_eq!(record[32..], [33; 9 * 16]);
}

#[test]
fn nothing_or_half_a_header_starts_over() {
    let (_folder, path) = folder_and_file();
    assert_eq!(resumed(&path).expect("missing").1, []);
    for (content, said) in [(&b""[..], false), (b"marti\0", true), (&[0; 300], true)] {
        fs::write(&path, content).expect("writable");
        let (mut journal, found, incident) = resumed(&path).expect("starts over");
        assert_eq!((found, incident.is_some()), (vec![], said), "{content:?}");
        journal.append(&borrowed(&pixels(2, 0))).expect("room");
        drop(journal);
        assert_eq!(resumed(&path).expect("whole").1, [pixels(2, 0)]);
    }
}

#[test]
fn a_journal_of_something_else_is_refused_and_left_alone() {
    let (_folder, path) = folder_and_file();
    let open = |subject: Subject| drop(Journal::open(&path, &subject, false, |_| ()).expect("starts over"));
    open(Subject { fingerprint: [8; 32], ..SUBJECT });
    assert!(refusal(&path).ends_with("the fingerprint 0808080808080808…, expected 0707070707070707…"));
    open(Subject { tiling: Tiling::new(Sides { tile_width: 4, ..TILING.sides() }).expect("possible"), ..SUBJECT });
    assert!(refusal(&path).ends_with("8x5 pixels in tiles of 4x3, expected 8x5 pixels in tiles of 3x3"));
    open(Subject { aov: AovSet::default(), ..SUBJECT });
    assert!(refusal(&path).contains("its tiles hold AovSet { depth: false,"));

    let mut bytes = written(&path, &[]);
    bytes[8] = 9;
    fs::write(&path, &bytes).expect("writable");
    assert!(refusal(&path).ends_with("is a journal of version 9, expected 2"));
    fs::write(&path, "my own notes").expect("writable");
    assert!(refusal(&path).contains("no journal of tiles"));
    assert!(Journal::open(&path, &SUBJECT, false, |_| ()).is_err(), "no notes are overwritten");
    assert_eq!(fs::read(&path).expect("still there"), b"my own notes");
}

#[test]
fn what_follows_damage_is_dropped_and_said() {
    let (_folder, path) = folder_and_file();
    let all = [pixels(0, 0), pixels(1, 0), pixels(2, 0)];
    let bytes = written(&path, &all);
    let second = HEADER_BYTES + record_bytes(&all[0]);
    // A byte in the middle, a length of 4 GiB, and a file that ends in the second record.
    type Damage<'a> = &'a dyn Fn(&mut Vec<u8>);
    let damages: [(Damage, &str); 3] = [
        (&|bytes| bytes[second + 50] ^= 1, "a record's checksum is wrong"),
        (&|bytes| bytes[second + 20..second + 24].fill(0xff), "what follows is no record"),
        (&|bytes| bytes.truncate(second + 40), "the last record is cut short"),
    ];
    for (damage, why) in damages {
        let mut bytes = bytes.clone();
        damage(&mut bytes);
        fs::write(&path, &bytes).expect("writable");
        let (_, found, said) = resumed(&path).expect("its start is sound");
        assert_eq!(found, all[..1]);
        let dropped = bytes.len() - second;
        let expected = format!("dropped the last {dropped} bytes, from byte {second} on: {why}");
        assert!(said.as_ref().is_some_and(|said| said.ends_with(&expected)), "{said:?}");
        assert_eq!(fs::metadata(&path).expect("still there").len(), second as u64);
    }
}

#[test]
fn one_process_appends_and_the_next_waits_for_it() {
    let (_folder, path) = folder_and_file();
    let (mut first, ..) = resumed(&path).expect("new");
    let second = thread::spawn({
        let path = path.clone();
        move || resumed(&path).map(|(_, found, _)| found)
    });
    thread::sleep(Duration::from_millis(100));
    first.append(&borrowed(&pixels(1, 0))).expect("room");
    drop(first);
    assert_eq!(second.join().expect("no panic").expect("free"), [pixels(1, 0)]);

    let _held = resumed(&path).expect("free");
    assert!(refusal(&path).ends_with("another process still appends to it, after 3 s"));
}

#[test]
fn a_full_disk_is_said_with_the_name_of_the_file() {
    let full = fs::File::options().write(true).open("/dev/full").expect("a device of Linux");
    let error = Journal::of_file("out/tiles", full).append(&borrowed(&pixels(0, 0))).expect_err("full").to_string();
    assert!(error.starts_with("cannot append to out/tiles: No space left on device"), "{error}");
}

proptest! {
    #[test]
    fn a_file_cut_anywhere_holds_every_whole_record(records in records(), cut in any::<prop::sample::Index>()) {
        let (_folder, path) = folder_and_file();
        let bytes = written(&path, &records);
        let cut = cut.index(bytes.len() + 1);
        fs::write(&path, &bytes[..cut]).expect("writable");
        let (_, found, said) = resumed(&path).expect("a cut is no error");
        let mut end = HEADER_BYTES;
        let whole = records.iter().take_while(|record| { end += record_bytes(record); end <= cut }).count();
        prop_assert_eq!(&found, &records[..whole]);
        let kept = HEADER_BYTES + found.iter().map(record_bytes).sum::<usize>();
        prop_assert_eq!(said.is_none(), cut == 0 || cut == kept);
    }

    #[test]
    fn a_flipped_byte_never_gives_a_wrong_tile(
        records in records(), at in any::<prop::sample::Index>(), flip in 1..=255u8, resized in any::<bool>(),
    ) {
        let (_folder, path) = folder_and_file();
        let mut bytes = written(&path, &records);
        let at = at.index(bytes.len());
        bytes[at] ^= flip;
        if resized {
            bytes.extend_from_slice(&[flip; 100]);
        }
        fs::write(&path, &bytes).expect("writable");
        match resumed(&path) {
            Ok((journal, found, said)) => {
                drop(journal);
                prop_assert!(at >= HEADER_BYTES);
                prop_assert!(found.len() < records.len(), "the flipped record is not there");
                prop_assert_eq!(&found, &records[..found.len()]);
                prop_assert!(said.is_some());
                // What is there now is whole.
                let (_, again, said) = resumed(&path).expect("whole");
                prop_assert_eq!((again, said), (found, None));
            }
            Err(_) => prop_assert!(at < HEADER_BYTES),
        }
    }

    #[test]
    fn a_zeroed_or_foreign_tail_is_dropped(records in records(), tail in prop::collection::vec(any::<u8>(), 1..200), zero in any::<bool>()) {
        let (_folder, path) = folder_and_file();
        let mut bytes = written(&path, &records);
        bytes.extend(tail.iter().map(|byte| if zero { 0 } else { *byte }));
        fs::write(&path, &bytes).expect("writable");
        let (_, found, said) = resumed(&path).expect("its start is sound");
        prop_assert_eq!(found, records);
        let expected = format!("dropped the last {} bytes", tail.len());
        prop_assert!(said.is_some_and(|said| said.contains(&expected)));
    }

    #[test]
    fn garbage_is_read_to_its_end_without_a_panic(
        garbage in prop::collection::vec(any::<u8>(), 0..400), begins_well in any::<bool>(),
    ) {
        let header = bytemuck::bytes_of(&super::format::Header::of(&SUBJECT)).to_vec();
        let bytes = if begins_well { [header, garbage].concat() } else { garbage };
        let mut reader = Reader::new(bytes.as_slice(), SUBJECT);
        if let Ok(Start::Header) = reader.start() {
            while let Ok(Next::Record(..)) = reader.next_record() {}
        }
    }
}
