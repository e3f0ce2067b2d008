//! A log that is damaged, in every way that disks and people know: it is named, with what can still be used.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use arrow_array::{RecordBatch, UInt64Array};
use arrow_ipc::writer::StreamWriter;
use arrow_schema::{DataType, Field, Schema};
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::format::Format;
use super::format::tests::{metadata, row};
use super::reader::LIMITS;
use super::rows::rows;
use super::{FILE_NAME, ReadError, Reader, SIDECAR_NAME, Usable, Writer};
use crate::hardware::transaction::{Kind, Transaction};
use crate::recording::batches::Batches;
use crate::recording::frames::{FrameKind, FrameLimits, Frames};

const BATCHES: u64 = 4;
const BATCH_ROWS: u64 = 20;
const ROWS: u64 = BATCHES * BATCH_ROWS;

/// A log and its sidecar.
#[derive(Clone)]
struct Files {
    log: Vec<u8>,
    sidecar: Vec<u8>,
}

/// Four batches of twenty rows.
fn written() -> Files {
    let folder = tempfile::tempdir().expect("a folder");
    let mut writer = Writer::create(folder.path(), &metadata()).expect("a folder to write to");
    for sequence in 0..ROWS {
        writer.push(row(sequence)).expect("written");
        if sequence % BATCH_ROWS == BATCH_ROWS - 1 {
            writer.flush().expect("written");
        }
    }
    writer.finish().expect("whole");
    let read = |name| fs::read(folder.path().join(name)).expect("written");
    Files { log: read(FILE_NAME), sidecar: read(SIDECAR_NAME) }
}

/// Where the frames of a log begin, by kind.
fn frames(log: &[u8], kind: FrameKind) -> Vec<(usize, usize)> {
    let limits = FrameLimits { metadata_bytes: 1 << 16, body_bytes: 1 << 20 };
    let mut frames = Frames::new(log, limits).expect("bytes");
    std::iter::from_fn(|| frames.next_frame().expect("sound"))
        .filter(|frame| frame.kind == kind)
        .map(|frame| (frame.offset as usize, frame.body_offset as usize))
        .collect()
}

fn put(folder: &Path, files: &Files) {
    fs::write(folder.join(FILE_NAME), &files.log).expect("writable");
    fs::write(folder.join(SIDECAR_NAME), &files.sidecar).expect("writable");
}

/// With a sidecar that vouches for the log as it is.
fn vouched(mut files: Files) -> Files {
    let mut sidecar: serde_json::Value = serde_json::from_slice(&files.sidecar).expect("JSON");
    sidecar["bytes"] = files.log.len().into();
    sidecar["crc32c"] = crc32c::crc32c(&files.log).into();
    files.sidecar = serde_json::to_vec(&sidecar).expect("JSON");
    files
}

/// All rows, if the log is whole.
fn read(reader: Result<Reader, ReadError>) -> Result<Vec<Transaction>, ReadError> {
    let mut reader = reader?;
    let mut all = Vec::new();
    while let Some(rows) = reader.next_rows()? {
        all.extend(rows);
    }
    assert_eq!(reader.rows(), all.len() as u64);
    Ok(all)
}

/// The rows before the first fault.
fn salvage(folder: &Path) -> Vec<Transaction> {
    let mut all = Vec::new();
    if let Ok(mut reader) = Reader::salvage(folder) {
        while let Ok(Some(rows)) = reader.next_rows() {
            all.extend(rows);
        }
    }
    all
}

/// A log of these rows in one batch.
fn log_of(rows: &[Transaction]) -> Files {
    let format = Format::new(&metadata());
    let mut writer = StreamWriter::try_new(Vec::new(), format.schema()).expect("in memory");
    writer.write(&format.batch(rows).expect("of the format")).expect("in memory");
    vouched(Files { log: writer.into_inner().expect("in memory"), sidecar: written().sidecar })
}

fn with_schema(change: impl FnOnce(Schema) -> Schema) -> Files {
    let schema = Arc::new(change(Format::new(&metadata()).schema().as_ref().clone()));
    let writer = StreamWriter::try_new(Vec::new(), &schema).expect("in memory");
    vouched(Files { log: writer.into_inner().expect("in memory"), sidecar: written().sidecar })
}

fn with_entry(key: &str, value: &str) -> Files {
    with_schema(|schema| {
        let mut entries = schema.metadata().clone();
        entries.insert(key.to_owned(), value.to_owned());
        schema.with_metadata(entries)
    })
}

fn sidecar_with(key: &str, value: impl Into<serde_json::Value>) -> Files {
    let mut files = written();
    let mut sidecar: serde_json::Value = serde_json::from_slice(&files.sidecar).expect("JSON");
    sidecar[key] = value.into();
    files.sidecar = serde_json::to_vec(&sidecar).expect("JSON");
    files
}

/// A log whose bytes at a place are others; the sidecar is that of the sound one.
fn patched(place: usize, with: &[u8]) -> Files {
    let mut files = written();
    files.log[place..place + with.len()].copy_from_slice(with);
    files
}

fn cut(length: usize) -> Files {
    let mut files = written();
    files.log.truncate(length);
    files
}

fn zeroed(from: usize) -> Files {
    let mut files = written();
    files.log[from..].fill(0);
    files
}

/// A log with one row of a kind changed; all vouched for.
fn with_row(sequence: usize, change: impl FnOnce(&mut Transaction)) -> Files {
    let mut rows: Vec<Transaction> = (0..BATCH_ROWS).map(row).collect();
    change(&mut rows[sequence]);
    log_of(&rows)
}

/// What a damage is called, the files, what the error says, and how many rows can be used, vouched for or not.
type Damage = (&'static str, Files, &'static str, u64, bool);

#[test]
fn every_damage_is_named_with_what_can_still_be_used() {
    let sound = written();
    let batches = frames(&sound.log, FrameKind::Batch);
    let dictionaries = frames(&sound.log, FrameKind::Dictionary);
    let schema_end = dictionaries[0].0;
    let [(first, _), (second, second_body), (third, third_body), ..] = batches[..] else { panic!("four batches") };
    let end = sound.log.len();
    // The body's bytes in the third batch's metadata.
    let (third_end, body_bytes) = (batches[3].0, (batches[3].0 - third_body) as i64);
    let stated = sound.log[third + 8..third_body].windows(8).position(|w| w == body_bytes.to_le_bytes());
    let body_length = third + 8 + stated.expect("the body's length");
    let other = log_of(&(0..BATCH_ROWS).map(row).collect::<Vec<_>>());
    let number = Arc::new(Schema::new(vec![Field::new("n", DataType::UInt64, false)]));
    let mut foreign = StreamWriter::try_new(Vec::new(), &number).expect("in memory");
    let column = Arc::new(UInt64Array::from(vec![1]));
    foreign.write(&RecordBatch::try_new(number, vec![column]).expect("one column")).expect("in memory");
    let foreign = foreign.into_inner().expect("in memory");
    let with_log = |log: Vec<u8>| vouched(Files { log, sidecar: sound.sidecar.clone() });
    let without_column = |schema: Schema| schema.project(&(0..15).collect::<Vec<_>>()).expect("a projection");
    let image = metadata().layout.database_bytes();

    let damages: Vec<Damage> = vec![
        ("empty", with_log(Vec::new()), "schema: expected a schema, the stream is empty; nothing", 0, false),
        ("cut in the first prefix", cut(5), "expected 8 bytes of a frame's beginning, the file ends after 5", 0, true),
        ("cut in the schema", cut(schema_end - 8), "bytes of metadata, the file ends after", 0, true),
        ("cut after the schema", cut(schema_end), "bus.json says", 0, true),
        ("cut in a dictionary", cut(dictionaries[0].1 + 3), "bytes of body, the file ends after 3", 0, true),
        ("cut before the first batch", cut(first), "bus.json says", 0, true),
        ("cut in a prefix", cut(third + 6), "8 bytes of a frame's beginning, the file ends after 6", 40, true),
        ("cut in the metadata", cut(third + 100), "bytes of metadata, the file ends after 92", 40, true),
        ("cut in a body", cut(third_body + 1000), "bytes of body, the file ends after 1000", 40, true),
        ("cut between batches", cut(third), "bus.json says", 40, true),
        ("cut before the end's mark", cut(end - 8), "bus.json says", 80, true),
        ("cut in the end's mark", cut(end - 3), "the file ends after 5", 80, true),
        ("a zeroed file", zeroed(0), "expected the beginning of a frame, ff ff ff ff, found 00 00 00 00", 0, false),
        ("zeroed from a batch on", zeroed(third), "batch 2, expected the beginning of a frame", 40, false),
        ("zeroed from a body on", zeroed(third_body), "batch 2, ", 40, false),
        (
            "zeroed from metadata on",
            zeroed(third + 8),
            "batch 2, expected a schema, a dictionary or a batch",
            40,
            false,
        ),
        ("a marker flipped", patched(second, &[0xfe]), "ff ff ff ff, found fe ff ff ff", 20, false),
        ("metadata of 2 GiB", patched(second + 4, &i32::MAX.to_le_bytes()), "1 to 65536 bytes of metadata", 20, false),
        ("metadata of less than nothing", patched(second + 4, &[0xff; 4]), "bytes of metadata, found -1", 20, false),
        ("metadata garbled", patched(second + 8, &[0x5a; 64]), "batch 1, expected the metadata of an Arrow", 20, false),
        ("a body of 2^62 bytes", patched(body_length, &(1i64 << 62).to_le_bytes()), "0 to 2097152 bytes", 40, false),
        ("a body of -1 bytes", patched(body_length, &[0xff; 8]), "0 to 2097152 bytes of body, found -1", 40, false),
        (
            "a body longer than the file",
            patched(body_length, &(1i64 << 20).to_le_bytes()),
            "1048576 bytes of body, the file ends after",
            40,
            false,
        ),
        (
            "a body shorter than it is",
            patched(body_length, &(body_bytes - 64).to_le_bytes()),
            "expected a column within",
            40,
            false,
        ),
        ("a sequence flipped", patched(second_body, &[21]), "batch 1, expected sequence 20, found 21", 20, false),
        (
            "a byte flipped that means nothing to a reader",
            patched(third_end - 1, &[7]),
            "bytes were altered",
            80,
            false,
        ),
        ("an end in the midst", patched(third + 4, &[0; 4]), "expected the file to end with its stream", 40, false),
        ("more bytes after the end", with_log([&sound.log[..], b"more"].concat()), "found 4 bytes more", 80, false),
        ("no Arrow at all", with_log(b"sequence,epoch,cluster\n0,0,0\n".to_vec()), "found 73 65 71 75", 0, false),
        (
            "another Arrow stream",
            with_log(foreign),
            "expected column 0 \"sequence\" of UInt64, found column 0",
            0,
            false,
        ),
        ("a column missing", with_schema(without_column), "\"completion_ns\" of UInt64, found 15 columns", 0, false),
        (
            "another version",
            with_entry("marti.format_version", "3"),
            "expected format version 1 to 2, found \"3\"",
            0,
            false,
        ),
        ("an arbiter unknown", with_entry("marti.arbiter", "lottery"), "\"lottery\" is not known", 0, false),
        ("an image too large", with_entry("marti.records", &records(1 << 60)), "at most 4294967296 can", 0, false),
        ("another image", with_entry("marti.records", &records(9)), "expected the", 0, false),
        (
            "a sidecar of another version",
            sidecar_with("format_version", 3),
            "version 1 to 2 and complete, found 3",
            80,
            false,
        ),
        ("a sidecar that is not complete", sidecar_with("complete", false), "complete, found 1 and false", 80, false),
        (
            "a sidecar of other rows",
            sidecar_with("rows", 81),
            "says 81 rows, sequence 0 to 79, found 80 rows",
            80,
            true,
        ),
        ("a sidecar of another sum", sidecar_with("crc32c", 1), "says crc32c 0x00000001, the file has", 80, false),
        (
            "a sidecar of another file",
            Files { log: sound.log.clone(), sidecar: other.sidecar },
            "the file has",
            80,
            false,
        ),
        ("a sidecar that is empty", Files { log: sound.log.clone(), sidecar: vec![] }, "not a sidecar", 80, false),
        ("a sidecar of a mebibyte", Files { log: sound.log.clone(), sidecar: vec![b' '; 1 << 20] }, "65536", 80, false),
        ("a gap", with_row(7, |row| row.sequence = 9), "expected sequence 7, found 9", 0, false),
        ("another bus", with_row(7, |row| row.cluster.0 = 3), "expected cluster 2 epoch 1, found cluster 3", 0, false),
        ("time running back", with_row(7, |row| row.grant_nanoseconds = 1), "in this order, found 700, 1", 0, false),
        ("a line of 17 bytes", with_row(6, |row| row.bytes = 17), "whole lines of 16 to 256 bytes", 0, false),
        (
            "a fetch beyond the image",
            with_row(6, |row| row.address = Some(ground::ids::Address(image))),
            "sequence 6: expected a fetch of lines within the image",
            0,
            false,
        ),
        ("a fetch without lines", with_row(6, |row| row.lines = None), "a fetch to have address, section", 0, false),
        ("a job with an address", with_row(7, |row| row.kind = Kind::Write), "the columns of its kind", 0, false),
    ];
    assert!(damages.len() >= 20);
    let mut wrong = Vec::new();
    for (name, files, expected, rows, unaltered) in damages {
        let folder = tempfile::tempdir().expect("a folder");
        put(folder.path(), &files);
        let error = read(Reader::open(folder.path())).expect_err(name);
        let said = error.to_string();
        let is_named = said.contains(expected) && said.contains("bus.arrows");
        let salvaged = salvage(folder.path());
        let is_right = salvaged == (0..rows).map(row).collect::<Vec<_>>();
        if !is_named || !is_right || error.usable != (Usable { rows, unaltered }) {
            wrong.push(format!("{name}: {} rows, {said}", salvaged.len()));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Records of each section, so many octree nodes.
fn records(octree_nodes: u64) -> String {
    let names = trace::database::Section::ALL.map(|section| section.name());
    let counts = names.map(|name| (name.to_owned(), if name == "octree_nodes" { octree_nodes } else { 1 }));
    serde_json::to_string(&std::collections::HashMap::from(counts)).expect("JSON")
}

#[test]
fn without_a_sidecar_or_unfinished_the_rows_are_there_and_the_lack_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let sound = written();
    put(folder.path(), &sound);
    assert_eq!(read(Reader::open(folder.path())).expect("whole").len() as u64, ROWS);
    fs::remove_file(folder.path().join(SIDECAR_NAME)).expect("there");
    let error = read(Reader::open(folder.path())).expect_err("no sidecar");
    assert!(error.to_string().contains("bus.json: No such file"), "{error}");
    assert_eq!(error.usable, Usable { rows: ROWS, unaltered: false });

    let partial = folder.path().join("bus.arrows.partial");
    fs::rename(folder.path().join(FILE_NAME), &partial).expect("there");
    for (bytes, rows) in [(sound.log.len() - 8, ROWS), (sound.log.len() - 20, ROWS - BATCH_ROWS)] {
        fs::write(&partial, &sound.log[..bytes]).expect("writable");
        let error = read(Reader::open(folder.path())).expect_err("not finished");
        assert!(error.to_string().contains("bus.arrows.partial: "), "{error}");
        assert!(error.to_string().contains("the bus was ended before it could finish this file"), "{error}");
        assert_eq!(error.usable, Usable { rows, unaltered: true }, "{error}");
        assert_eq!(salvage(folder.path()).len() as u64, rows);
    }
    fs::remove_file(&partial).expect("there");
    let error = read(Reader::open(folder.path())).expect_err("nothing there");
    assert!(error.to_string().contains("bus.arrows: No such file"), "{error}");
}

#[test]
fn bytes_flipped_at_random_never_panic_and_never_pass() {
    let sound = written();
    let folder = tempfile::tempdir().expect("a folder");
    put(folder.path(), &sound);
    let whole: Vec<Transaction> = (0..ROWS).map(row).collect();
    let mut random = Pcg64Mcg::seed_from_u64(4);
    for _ in 0..4000 {
        let mut log = sound.log.clone();
        for _ in 0..1 + random.next_u32() % 4 {
            let place = random.next_u64() as usize % log.len();
            log[place] ^= 1 << (random.next_u32() % 8);
        }
        if log == sound.log {
            continue;
        }
        fs::write(folder.path().join(FILE_NAME), &log).expect("writable");
        let error = read(Reader::open(folder.path())).expect_err("flipped");
        assert_eq!(salvage(folder.path()).len() as u64, error.usable.rows);
        assert!(!error.usable.unaltered && error.usable.rows <= ROWS, "{error}");
    }
    put(folder.path(), &sound);
    assert!(read(Reader::open(folder.path())) == Ok(whole));
}

/// Metadata are where Arrow's own readers trust: all bytes there, each flipped in several ways.
#[test]
fn no_byte_of_metadata_can_panic_the_reader() {
    let sound = written();
    let rows_of = |log: &[u8]| {
        let mut count = 0;
        let opened = Batches::open(log, LIMITS).and_then(|batches| batches.with_columns(&Format::columns()));
        let Ok(mut batches) = opened else { return 0 };
        while let Ok(Some(batch)) = batches.next_batch() {
            let Ok(rows) = rows(&batch.columns) else { break };
            count += rows.len() as u64;
        }
        count
    };
    assert_eq!(rows_of(&sound.log), ROWS);
    let batch = frames(&sound.log, FrameKind::Batch)[1];
    let dictionary = frames(&sound.log, FrameKind::Dictionary)[0];
    for place in (0..dictionary.0).chain(dictionary.0..dictionary.1).chain(batch.0..batch.1) {
        for flip in [0xff, 0x80, 0x03] {
            let mut log = sound.log.clone();
            log[place] ^= flip;
            assert!(rows_of(&log) <= ROWS);
        }
    }
}
