//! What was exported comes back; what is wrong is named by its place.

use std::io::Cursor;
use std::path::Path;

use super::{Imported, TableLines, csv, din, import, oracle_general};
use crate::hardware::local_memory::Geometry;
use crate::hardware::references::PART_WORDS;
use crate::hardware::replacement::{Clock, Lru};
use crate::replay::exporters::{self, accesses::Surroundings};
use crate::replay::model::replayer::{Counters, Replayer, Sum};
use crate::replay::stream::captured::tests::teapot;
use crate::replay::{Lines, RecordLines, Trace};
use trace::picture::{Sides, Tiling};
use trace::scene::SourceError;

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
    words.iter().flat_map(lines_of).map(|line| lines.set(line, 7) as u32).collect()
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
        let imported = din::read(name, &bytes[..]).expect("what was exported");
        let read = imported.lines(line_bytes);
        let counted = totals::<Lru>(&imported, &read, sets, ways);
        assert_eq!((counted.line_accesses, counted.line_misses), (expected.line_accesses, expected.line_misses));
        assert_eq!(totals::<Clock>(&imported, &read, sets, ways).line_misses, expected_clock.line_misses);
        assert_eq!((imported.references(), imported.writes), (expected.line_accesses, 0));

        let mut bytes = Cursor::new(Vec::new());
        exporters::oracle_general::write(&mut bytes, &trace, &tiles, &lines, line_bytes).expect("into memory");
        let imported = oracle_general::read(name, &bytes.get_ref()[..]).expect("what was exported");
        // Each object is a line, whatever its bytes.
        for line_bytes in [16, line_bytes] {
            let counted = totals::<Lru>(&imported, &imported.lines(line_bytes), sets, ways);
            assert_eq!((counted.line_accesses, counted.line_misses), (expected.line_accesses, expected.line_misses));
        }
        assert_eq!(imported.left_out, 0);

        let surroundings = Surroundings {
            layout,
            levels: &[],
            tiling: Tiling::new(Sides { width: 32, height: 32, tile_width: 8, tile_height: 8 }).expect("possible"),
        };
        let mut bytes = Vec::new();
        exporters::csv::write(&mut bytes, &trace, &tiles, surroundings).expect("into memory");
        let imported = csv::read(name, &bytes[..]).expect("what was exported");
        assert_eq!(totals::<Lru>(&imported, &imported.lines(line_bytes), sets, ways), expected);
    }
}

#[test]
fn only_what_is_referenced_has_a_place() {
    // By hand: granules 0, 1, 4 and 2^52 of 256 bytes; 250 with 10 bytes is in granules 0 and 1.
    let rows = "bytes,x,address\n10,a,250\n4,b,0x404\n4,\"c,d\",1024\n\n4,e,0x10000000000000\n10,f,250\n";
    let imported = csv::read(Path::new("x"), rows.as_bytes()).expect("a trace");
    assert_eq!((imported.references(), imported.records()), (5, 4));
    // 10 bytes are three words, 4 are one.
    assert_eq!(imported.record_words(), [1, 3]);
    assert_eq!([0, 1, 2, 3].map(|record| imported.kind(record)), [1, 0, 0, 0]);
    assert_eq!(imported.database_bytes(), 4 * 256);
    let lines = imported.lines(64);
    assert_eq!(lines.count(), 16);
    // The lines of each granule follow those of the one before.
    assert_eq!([0, 1, 2, 3].map(|record| lines.of(record)), [(3, 2), (8, 1), (8, 1), (12, 1)]);
    // True lines: 3 and 4, 0x404 / 64 = 16, and 2^52 * 256 / 2^8 / 64 = 2^46, which is 2 mod 7.
    assert_eq!(sets_of(&imported, &lines), [3, 4, 2, 2, (1u64 << 46).rem_euclid(7) as u32, 3, 4]);
    assert_eq!(imported.lines(16).of(0), (15, 2));
    assert_eq!(imported.lines(256).of(0), (0, 2));
}

#[test]
fn din_takes_what_dinero_takes() {
    let text = "0 0\r\n2 3f a comment\n\n  1\t0x40\n0 FFFFFFFFFFFFFFFE";
    let imported = din::read(Path::new("x.din"), text.as_bytes()).expect("a trace");
    assert_eq!((imported.references(), imported.writes, imported.records()), (4, 1, 4));
    let lines = imported.lines(64);
    // The last line of all 64-bit addresses is 2^58 - 1, which is 1 mod 7.
    assert_eq!(sets_of(&imported, &lines), [0, 0, 1, ((1u64 << 58) - 1).rem_euclid(7) as u32]);
}

/// A reference to an object.
fn object(id: u64, size: u32) -> Vec<u8> {
    let mut bytes = vec![9, 0, 0, 0];
    bytes.extend(id.to_le_bytes());
    bytes.extend(size.to_le_bytes());
    bytes.extend((-1i64).to_le_bytes());
    bytes
}

#[test]
fn objects_of_no_size_are_left_out_and_counted() {
    let bytes = [object(1 << 60, 100), object(3, 0), object(5, 7), object(1 << 60, 8)].concat();
    let imported = oracle_general::read(Path::new("x"), &bytes[..]).expect("a trace");
    assert_eq!((imported.references(), imported.records(), imported.left_out), (3, 2, 1));
    let lines = imported.lines(64);
    let expected = (1u64 << 60).rem_euclid(7) as u32;
    assert_eq!(sets_of(&imported, &lines), [expected, 5, expected]);
}

#[test]
fn bad_input_is_named_by_its_place() {
    type Reader = fn(&Path, &[u8]) -> Result<Imported, SourceError>;
    let din: Reader = |file, bytes| din::read(file, bytes);
    let csv: Reader = |file, bytes| csv::read(file, bytes);
    let oracle: Reader = |file, bytes| oracle_general::read(file, bytes);
    let zstd = [vec![0x28, 0xb5, 0x2f, 0xfd], vec![0; 40]].concat();
    let cut = [object(1, 1), object(2, 1)[..20].to_vec()].concat();
    let long = [vec![b'0'], vec![b' '; 1 << 17]].concat();
    let many_granules: Vec<u8> = (0..5000u64)
        .fold(b"address,bytes\n".to_vec(), |text, i| [text, format!("{},1048576\n", i << 21).into()].concat());
    let cases: &[(Reader, &[u8], &str)] = &[
        (din, b"", "f: no references, expected at least one"),
        (din, b"\n\n", "f: no references, expected at least one"),
        (din, b"0 10\n0\n", "f:2:2: the line ends here, expected a hexadecimal address"),
        (din, b"0 10\n 7 10\n", "f:2:2: label \"7\", expected 0 (read), 1 (write) or 2 (instruction)"),
        (din, b"0  1g\n", "f:1:4: \"1g\", expected a hexadecimal address of at most 64 bits"),
        (din, b"0 +1\n", "f:1:3: \"+1\", expected a hexadecimal address of at most 64 bits"),
        (
            din,
            b"0 10000000000000000\n",
            "f:1:3: \"10000000000000000\", expected a hexadecimal address of at most 64 bits",
        ),
        (din, b"\xff\x00 1\n", "f:1:1: label \"\\xff\\x00\", expected 0 (read), 1 (write) or 2 (instruction)"),
        (din, &long, "f:1:1: a line of 65536 bytes or more, expected a shorter one"),
        (csv, b"", "f:1:1: no such column, expected one named \"address\""),
        (csv, b"a,b\n1,2\n", "f:1:1: no such column, expected one named \"address\""),
        (csv, b"address,address\n", "f:1:9: a second column \"address\", expected one"),
        (csv, b"address\n", "f: no references, expected at least one"),
        (csv, b"a,address\n1,2\n3\n", "f:3:2: a row of 1 fields, expected 2"),
        (csv, b"a,address\n1,2,3\n", "f:2:6: a row of 3 fields, expected 2"),
        (
            csv,
            b"a,address\n1,ff\n",
            "f:2:3: \"ff\", expected an address of at most 64 bits, decimal or hexadecimal after 0x",
        ),
        (
            csv,
            b"a,address\n1,-4\n",
            "f:2:3: \"-4\", expected an address of at most 64 bits, decimal or hexadecimal after 0x",
        ),
        (
            csv,
            b"a,address\n1,\n",
            "f:2:3: \"\", expected an address of at most 64 bits, decimal or hexadecimal after 0x",
        ),
        (csv, b"address,bytes\n1, x\n", "f:2:4: \"x\", expected bytes, 1 to 1048576"),
        (csv, b"address,bytes\n1,0\n", "f:2:1: 0 bytes, expected 1 to 1048576"),
        (csv, b"address,bytes\n1,4294967295\n", "f:2:1: 4294967295 bytes, expected 1 to 1048576"),
        (
            csv,
            b"address,bytes\n18446744073709551615,8\n",
            "f:2:1: address 0xffffffffffffffff and 8 bytes, expected an end within 64 bits",
        ),
        (
            csv,
            b"address,b\n1,\"x\n",
            "f:2:3: a quotation mark that is not closed on its line, or text after it, expected one and a comma",
        ),
        (
            csv,
            &many_granules,
            "f: references to more than 16777215 different objects or granules of 256 bytes, expected fewer",
        ),
        (oracle, b"", "f: no references, expected at least one"),
        (oracle, &cut, "f: byte 24: 20 bytes of a reference, expected 24"),
        (oracle, b"abc", "f: byte 0: 3 bytes of a reference, expected 24"),
        (oracle, &zstd, "f: byte 0: compressed by zstd, expected plain oracleGeneral: `zstd -d` it first"),
        (oracle, &object(7, 0), "f: no references, expected at least one"),
    ];
    for (read, bytes, expected) in cases {
        let error = read(Path::new("f"), bytes).expect_err(expected);
        assert_eq!(error.to_string(), *expected);
    }
    let missing = import(Path::new("no such file.din"), din::read).expect_err("there is none");
    assert!(missing.to_string().starts_with("no such file.din: "), "{missing}");
}
