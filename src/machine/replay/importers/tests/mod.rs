//! What was exported comes back; what is wrong is named by its place.

mod compressions;
mod formats;
mod tables;

use std::io::Cursor;
use std::path::Path;

use super::{
    CsvOptions, ImportFormat, ImportOptions, Imported, TableLines, csv, din, import, import_from, json, oracle_general,
};
use crate::hardware::local_memory::Geometry;
use crate::hardware::references::{PART_WORDS, ReferenceWord};
use crate::hardware::replacement::{Clock, Lru};
use crate::replay::exporters::{self, accesses::Surroundings};
use crate::replay::model::replayer::{Counters, Replayer, Sum};
use crate::replay::stream::captured::tests::teapot;
use crate::replay::{Lines, RecordLines, Trace};
use trace::picture::{Sides, Tiling};

fn totals<R: crate::hardware::replacement::Replacement>(
    trace: &impl Trace,
    lines: &impl Lines,
    sets: u64,
    ways: u64,
) -> Counters {
    let geometry = Geometry { line_bytes: 64, database_lines: lines.count(), sets, ways };
    let mut replayer = Replayer::<R, _>::new(lines, geometry, 0).expect("few slots");
    let mut sum = Sum::new(trace);
    for tile in 0..trace.tiles().len() as u32 {
        replayer.tile(trace, tile, &mut sum).expect("a sound trace");
    }
    sum.finish()
}

/// The lines that a trace references, in order, and the sets of these among 7.
fn sets_of(imported: &Imported, lines: &TableLines) -> Vec<u32> {
    let mut words = Vec::new();
    imported.read(0, &mut words).expect("one part");
    let lines_of = |&record: &u32| {
        let (first, count) = lines.of(record);
        first..first + count
    };
    let referenced: Vec<u32> = words.iter().filter_map(|&word| ReferenceWord(word).record()).collect();
    referenced.iter().flat_map(lines_of).map(|line| lines.set(line, 7) as u32).collect()
}

#[test]
fn exports_come_back_with_the_same_counts() {
    let (database, trace) = teapot(32, 1);
    let layout = &database.database().header.layout;
    let tiles: Vec<u32> = (0..trace.tiles().len() as u32).collect();
    let name = Path::new("trace");
    for (line_bytes, sets, ways) in [(64, 1, 40), (16, 1, 300), (32, 8, 12), (256, 3, 8)] {
        let lines = RecordLines::new(layout, line_bytes);
        let expected = totals::<Lru>(&trace, &lines, sets, ways);
        let expected_clock = totals::<Clock>(&trace, &lines, sets, ways);
        assert!(expected.record_accesses > PART_WORDS as u64, "several parts");

        let mut bytes = Vec::new();
        exporters::din::write(&mut bytes, &trace, &tiles, &lines, line_bytes).expect("into memory");
        let imported = din::read(name, &bytes[..], 16).expect("what was exported");
        let read = imported.lines(line_bytes);
        let counted = totals::<Lru>(&imported, &read, sets, ways);
        assert_eq!((counted.line_accesses, counted.line_misses), (expected.line_accesses, expected.line_misses));
        assert_eq!(totals::<Clock>(&imported, &read, sets, ways).line_misses, expected_clock.line_misses);
        assert_eq!((imported.notes().references, imported.notes().writes), (expected.line_accesses, 0));

        let mut bytes = Cursor::new(Vec::new());
        exporters::oracle_general::write(&mut bytes, &trace, &tiles, &lines, line_bytes).expect("into memory");
        let imported = oracle_general::read(name, &bytes.get_ref()[..], 16).expect("what was exported");
        // Each object is a line, whatever its bytes.
        for line_bytes in [16, line_bytes] {
            let counted = totals::<Lru>(&imported, &imported.lines(line_bytes), sets, ways);
            assert_eq!((counted.line_accesses, counted.line_misses), (expected.line_accesses, expected.line_misses));
        }
        assert_eq!(imported.notes().left_out, 0);

        let surroundings = Surroundings {
            layout,
            levels: &[],
            tiling: Tiling::new(Sides { width: 32, height: 32, tile_width: 8, tile_height: 8 }).expect("possible"),
        };
        let mut bytes = Vec::new();
        exporters::csv::write(&mut bytes, &trace, &tiles, surroundings).expect("into memory");
        let imported = csv::read(name, &bytes[..], &CsvOptions::default(), 16).expect("what was exported");
        assert_eq!(totals::<Lru>(&imported, &imported.lines(line_bytes), sets, ways), expected);

        let mut bytes = Vec::new();
        exporters::json::write(&mut bytes, &trace, &tiles, surroundings).expect("into memory");
        let imported = json::read(name, &bytes[..], 16).expect("what was exported");
        assert_eq!(totals::<Lru>(&imported, &imported.lines(line_bytes), sets, ways), expected);
    }
}

/// Reads a trace by its bytes and name alone.
fn recognised(name: &str, bytes: &[u8]) -> Result<Imported, String> {
    let options = ImportOptions { format: None, csv: CsvOptions::default(), line_bytes_min: 16 };
    import_from(Path::new(name), bytes, &options).map_err(|error| error.to_string())
}

/// Reads a trace of this format.
fn of_format(format: ImportFormat, bytes: &[u8]) -> Result<Imported, String> {
    let options = ImportOptions { format: Some(format), csv: CsvOptions::default(), line_bytes_min: 16 };
    import_from(Path::new("f"), bytes, &options).map_err(|error| error.to_string())
}

#[test]
fn only_what_is_referenced_has_a_place() {
    // By hand: 250 with 10 bytes is in lines 3 and 4 of 64 bytes, 0x404 in line 16, the last in line 2^46.
    let rows = "bytes,x,address\n10,a,250\n4,b,0x404\n4,\"c,d\",1024\n\n4,e,0x10000000000000\n10,f,250\n";
    let imported = recognised("x.csv", rows.as_bytes()).expect("a trace");
    // 0x404 and 1024 are within the same 16 bytes: a record.
    assert_eq!((imported.notes().references, imported.records()), (5, 3));
    // 10 bytes are three words, 4 are one.
    assert_eq!(imported.record_words(), [1, 3]);
    assert_eq!([0, 1, 2].map(|record| imported.kind(record)), [1, 0, 0]);
    assert_eq!(imported.object_bytes(0), 10);
    let lines = imported.lines(64);
    assert_eq!(lines.count(), 4);
    assert_eq!([0, 1, 2].map(|record| lines.of(record)), [(0, 2), (2, 1), (3, 1)]);
    assert_eq!(sets_of(&imported, &lines), [3, 4, 2, 2, (1u64 << 46).rem_euclid(7) as u32, 3, 4]);
    // Lines 15 and 16, 64, and 2^48 of 16 bytes; 0 and 1, 4, and 2^44 of 256; 0 and 2^36 of 65,536.
    assert_eq!((imported.lines(16).count(), imported.lines(16).of(0)), (4, (0, 2)));
    assert_eq!((imported.lines(256).count(), imported.lines(256).of(0)), (4, (0, 2)));
    let longest = imported.lines(65_536);
    assert_eq!((longest.count(), [0, 1, 2].map(|record| longest.of(record))), (2, [(0, 1), (0, 1), (1, 1)]));
}

#[test]
fn a_file_that_is_not_there_is_named() {
    let options = ImportOptions { format: None, csv: CsvOptions::default(), line_bytes_min: 64 };
    let missing = import(Path::new("no such file.din"), &options).expect_err("there is none");
    assert!(missing.to_string().starts_with("no such file.din: "), "{missing}");
}
