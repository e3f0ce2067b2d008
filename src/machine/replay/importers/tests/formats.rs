//! Each format: what is read of a sample, and what is refused.

use super::{of_format, recognised, sets_of};
use crate::hardware::references::ReferenceWord;
use crate::replay::importers::ImportFormat::{self, Champsim, Din, Ids, Json, Lackey, OracleGeneral, Ramulator, Vscsi};
use crate::replay::importers::builder::Builder;
use crate::replay::importers::{Imported, Notes};
use crate::replay::{Lines, Trace};

/// The lines of 64 bytes that are read or written, by record, in order.
fn lines_read(imported: &Imported) -> Vec<u32> {
    let mut words = Vec::new();
    imported.read(0, &mut words).expect("one part");
    let lines = imported.lines(64);
    words.iter().filter_map(|&word| ReferenceWord(word).record()).map(|record| lines.of(record).0).collect()
}

#[test]
fn din_takes_what_dinero_takes() {
    let text = "0 0\r\n2 3f a comment\n\n  1\t0x40\n03 41\n0x4 40\n5 40\n0 FFFFFFFFFFFFFFFE";
    let imported = recognised("x.din", text.as_bytes()).expect("a trace");
    // Addresses are those of words: 0x41 is that of 0x40.
    assert_eq!(imported.records(), 4);
    let expected = Notes { references: 5, writes: 1, copy_backs: 1, invalidations: 1, ..Notes::default() };
    assert_eq!(imported.notes(), expected);
    // The last line of all 64-bit addresses is 2^58 - 1, which is 1 mod 7.
    let reads = sets_of(&imported, &imported.lines(64));
    assert_eq!(reads, [0, 0, 1, 1, ((1u64 << 58) - 1).rem_euclid(7) as u32]);
}

#[test]
fn extended_din_has_sizes() {
    let text = "r 3c 8 comment\nW 0x40 0x4\ni 80 1\nM 80 1\nc 40 4\nv 40 4\nc 0 0\nv 0 0\n";
    for name in ["x.din", "-"] {
        let imported = recognised(name, text.as_bytes()).expect("a trace");
        let expected = Notes { references: 4, writes: 1, copy_backs: 2, invalidations: 2, ..Notes::default() };
        assert_eq!(imported.notes(), expected);
        assert_eq!((imported.lines(64).of(0), imported.object_bytes(0)), ((0, 2), 8));
    }
}

/// A reference of oracleGeneral.
fn object(time: u32, id: u64, size: u32, next: i64) -> Vec<u8> {
    [&time.to_le_bytes()[..], &id.to_le_bytes(), &size.to_le_bytes(), &next.to_le_bytes()].concat()
}

#[test]
fn objects_have_their_first_size_and_are_left_out_without_one() {
    let bytes =
        [object(9, 1 << 60, 100, 4), object(9, 3, 0, -1), object(9, 5, 7, -1), object(9, 1 << 60, 8, -1)].concat();
    for name in ["x.oracleGeneral", "x.oracleGeneral.bin", "sample.ORACLEGENERAL.bin.zst"] {
        let imported = recognised(name, &bytes).expect("a trace");
        assert_eq!(imported.notes(), Notes { references: 3, left_out: 1, resized: 1, ..Notes::default() });
        assert!(imported.is_of_objects());
        assert_eq!([0, 1].map(|record| imported.object_bytes(record)), [100, 7]);
        assert_eq!((imported.records(), imported.objects_bytes()), (2, Some(107)));
        let expected = (1u64 << 60).rem_euclid(7) as u32;
        assert_eq!(sets_of(&imported, &imported.lines(64)), [expected, 5, expected]);
    }
    // Eight references are certain whatever their file is called.
    let many: Vec<u8> = (1..9).flat_map(|i| object(i, u64::from(i % 3), 10, i64::from(i + 3))).collect();
    assert_eq!(recognised("x.bin", &many).expect("a trace").records(), 3);
    assert!(recognised("x.bin", &many[..7 * 24]).is_err());
}

#[test]
fn ids_are_numbers_or_text_and_never_the_same() {
    let text = "7\n0x7\n007\nseven\r\n\n 7 \nseven\n0\n18446744073709551616\n";
    let imported = recognised("x.txt", text.as_bytes()).expect("a trace");
    // 7, "007", "seven", 0 and a number that is too large; a text's number is never another's.
    assert_eq!((imported.records(), imported.notes().references), (5, 8));
    assert_eq!(lines_read(&imported), [0, 0, 1, 2, 0, 2, 3, 4]);
    assert_eq!(imported.objects_bytes(), Some(5));
}

fn vscsi_1(command: u16, block: u64, length: u32) -> Vec<u8> {
    let mut bytes = 5u32.to_le_bytes().to_vec();
    bytes.extend(length.to_le_bytes());
    bytes.extend(1u32.to_le_bytes());
    bytes.extend(command.to_le_bytes());
    bytes.extend(0x0100u16.to_le_bytes());
    bytes.extend(block.to_le_bytes());
    bytes.extend(77u64.to_le_bytes());
    bytes
}

fn vscsi_2(command: u16, block: u64, length: u32) -> Vec<u8> {
    let mut bytes = command.to_le_bytes().to_vec();
    bytes.extend(0x0200u16.to_le_bytes());
    bytes.extend(5u32.to_le_bytes());
    bytes.extend(length.to_le_bytes());
    bytes.extend(1u32.to_le_bytes());
    bytes.extend(block.to_le_bytes());
    bytes.extend([77u64.to_le_bytes(), 99u64.to_le_bytes()].concat());
    bytes
}

#[test]
fn both_versions_of_vscsi_are_read() {
    for record in [vscsi_1 as fn(u16, u64, u32) -> Vec<u8>, vscsi_2] {
        let bytes =
            [record(0x28, 10, 512), record(0x2a, 11, 4096), record(0x2a, 10, 512), record(0x28, 12, 0)].concat();
        let imported = recognised("x.vscsi", &bytes).expect("a trace");
        assert_eq!(imported.notes(), Notes { references: 3, writes: 2, left_out: 1, ..Notes::default() });
        assert_eq!([0, 1].map(|record| imported.object_bytes(record)), [512, 4096]);
    }
}

#[test]
fn lackey_modifies_by_a_load_and_a_store() {
    let text = "==14175== Lackey, an example Valgrind tool\n==14175== \nI  0401ab70,3\n S 1fff00003c,8\n L 04a17de0,1\n\
        --14175-- a message\n M 04a17de0,8\n==14175== Exit code:       0\n";
    for name in ["x.log", "-"] {
        let imported = recognised(name, text.as_bytes()).expect("a trace");
        assert_eq!(imported.notes(), Notes { references: 5, writes: 2, ..Notes::default() });
        assert_eq!(imported.lines(64).of(1), (2, 2), "eight bytes from 0x3c lie in two lines");
    }
    assert_eq!(recognised("-", b"I  0401ab70,3\n").expect("a trace").records(), 1);
}

fn instruction(address: u64, branch: [u8; 2], destinations: [u64; 2], sources: [u64; 4]) -> Vec<u8> {
    let mut bytes = address.to_le_bytes().to_vec();
    bytes.extend(branch);
    bytes.extend([1, 2, 3, 4, 5, 6]);
    destinations.iter().chain(&sources).for_each(|address| bytes.extend(address.to_le_bytes()));
    bytes
}

#[test]
fn instructions_are_fetched_then_read_then_written() {
    let one = instruction(0x1000, [1, 0], [0x40, 0], [0x80, 0, 0, 0xc0]);
    let bytes = [one.clone(), instruction(0x1004, [0, 0], [0; 2], [0; 4])].concat();
    for name in ["400.perlbench-41B.champsimtrace.xz", "x.champsim"] {
        let imported = recognised(name, &bytes).expect("a trace");
        assert_eq!(imported.notes(), Notes { references: 5, writes: 1, ..Notes::default() });
        // Lines 0x40, 2, 3, 1 and 0x40 in the order of their addresses.
        assert_eq!(lines_read(&imported), [3, 1, 2, 0, 3]);
    }
    assert_eq!(recognised("trace", &one.repeat(8)).expect("certain").notes().references, 32);
    assert!(recognised("trace", &one.repeat(7)).is_err());
}

#[test]
fn ramulator_has_two_formats() {
    for text in ["LD 0x40\nST 128\n\nLD 0x40\n", "0x40 R\n128 W\n0x40 R\n"] {
        let imported = recognised("x.trace", text.as_bytes()).expect("a trace");
        assert_eq!(imported.notes(), Notes { references: 3, writes: 1, ..Notes::default() });
        assert_eq!(imported.records(), 2);
    }
}

#[test]
fn json_needs_an_address() {
    let text = "{\"node\":0,\"address\":60,\"bytes\":8,\"ray\":null}\n\n{\"address\":128}\n";
    for name in ["x.json", "-"] {
        let imported = recognised(name, text.as_bytes()).expect("a trace");
        assert_eq!(
            (imported.notes().references, imported.lines(64).of(0), imported.lines(64).of(1)),
            (2, (0, 2), (2, 1))
        );
    }
}

#[test]
fn what_is_not_recognised_gets_a_list() {
    // Dinero's classic format looks like others.
    assert!(recognised("x.txt", b"0 40\n").is_err());
    assert!(recognised("x.csv", b"1 R\n2 W\n").expect_err("a table").contains("no names of columns"));
    for (name, bytes) in
        [("x", &b"hello\n"[..]), ("-", b"1,2\n3,4\n"), ("x.oracleGeneralOpNS", &[7; 54]), ("y.bin", b"")]
    {
        let error = recognised(name, bytes).expect_err("nothing that is known");
        assert!(
            error.starts_with(&format!("{name}: its format is not recognised; --import says which, expected one of "))
        );
        for format in <ImportFormat as clap::ValueEnum>::value_variants() {
            let known = clap::ValueEnum::to_possible_value(format).expect("not hidden");
            assert!(error.contains(known.get_name()), "{error}");
        }
    }
}

#[test]
fn bad_input_is_named_by_its_place() {
    let long = [vec![b'0'], vec![b' '; 1 << 17]].concat();
    let cut = [object(0, 1, 1, -1), object(0, 2, 1, -1)[..20].to_vec()].concat();
    let mixed = [vscsi_1(0, 1, 1), vscsi_2(0, 1, 1)[..32].to_vec()].concat();
    let lying = [instruction(1, [1, 1], [0; 2], [0; 4]), instruction(1, [1, 2], [0; 2], [0; 4])].concat();
    let letters = "r (read), w (write), i (instruction), m (other read), c (copy back) or v (invalidate)";
    let labels = "0 (read), 1 (write), 2 (instruction), 3 (other read), 4 (copy back) or 5 (invalidate)";
    let ramulator = "LD or ST and an address, or an address and R or W; an address is decimal, or hexadecimal after 0x, of at most 64 bits";
    let json = "expected an object on its line, with a number \"address\" and perhaps \"bytes\"";
    let place = "a hexadecimal address, a comma and a decimal size";
    let none = "f: no references, expected at least one";
    let cases: &[(ImportFormat, &[u8], &str)] = &[
        (Din, b"", none),
        (Din, b"\n\n", none),
        (Din, b"4 0\n5 0\n", none),
        (Din, b"0 10\n0\n", "f:2:2: the line ends here, expected a hexadecimal address"),
        (Din, b"0 10\n 7 10\n", &format!("f:2:2: label \"7\", expected {labels}")),
        (Din, b"0 10\nr 10 4\n", &format!("f:2:1: label \"r\", expected {labels}")),
        (Din, b"0  1g\n", "f:1:4: \"1g\", expected a hexadecimal address of at most 64 bits"),
        (Din, b"0 +1\n", "f:1:3: \"+1\", expected a hexadecimal address of at most 64 bits"),
        (
            Din,
            b"0 10000000000000000\n",
            "f:1:3: \"10000000000000000\", expected a hexadecimal address of at most 64 bits",
        ),
        (Din, b"\xff\x00 1\n", &format!("f:1:1: label \"\\xff\\x00\", expected {labels}")),
        (Din, b"r 10 4\n0 10\n", &format!("f:2:1: label \"0\", expected {letters}")),
        (Din, b"r 10\n", "f:1:5: the line ends here, expected a hexadecimal size"),
        (Din, b"r 10 0\n", "f:1:6: a size of 0, expected 1 or more"),
        (Din, b"r 10 100001\n", "f:1:6: 1048577 bytes, expected 1 to 1048576"),
        (Din, b"r 10 1ffffffff\n", "f:1:6: 4294967295 bytes, expected 1 to 1048576"),
        (
            Din,
            b"r ffffffffffffffff 2\n",
            "f:1:20: address 0xffffffffffffffff and 2 bytes, expected an end within 64 bits",
        ),
        (Din, &long, "f:1:1: a line of 65536 bytes or more, expected a shorter one"),
        (OracleGeneral, b"", none),
        (OracleGeneral, &cut, "f: byte 24: 20 bytes of a record, expected 24"),
        (OracleGeneral, b"abc", "f: byte 0: 3 bytes of a record, expected 24"),
        (OracleGeneral, &object(0, 7, 0, -1), none),
        (Ids, b"\n \n", none),
        (Ids, &long, "f:1:1: a line of 65536 bytes or more, expected a shorter one"),
        (Vscsi, b"", "f: byte 0: neither version 1 nor 2 of vscsi, expected either"),
        (Vscsi, &[3; 40], "f: byte 0: neither version 1 nor 2 of vscsi, expected either"),
        (Vscsi, &vscsi_1(0, 1, 1)[..31], "f: byte 0: 31 bytes of a record, expected 32"),
        (Vscsi, &[vscsi_2(0, 1, 1), vec![0; 39]].concat(), "f: byte 40: 39 bytes of a record, expected 40"),
        (Vscsi, &mixed, "f: byte 32: a record of version 0, expected 1 as in the first one"),
        (Lackey, b"==1== \n", none),
        (Lackey, b"I  10,3\nhello\n", "f:2:1: \"hello\", expected I, L, S or M, or a line of valgrind's"),
        (Lackey, b" L\n", &format!("f:1:3: the line ends here, expected {place}")),
        (Lackey, b" L 10\n", &format!("f:1:4: \"10\", expected {place}")),
        (Lackey, b" L 1g,1\n", &format!("f:1:4: \"1g,1\", expected {place}")),
        (Lackey, b" L 10,4294967296\n", &format!("f:1:4: \"10,4294967296\", expected {place}")),
        (Lackey, b" L 10,0\n", "f:1:4: 0 bytes, expected 1 to 1048576"),
        (Lackey, b" L 10,1 x\n", "f:1:9: \"x\", expected the end of the line"),
        (Champsim, b"", none),
        (Champsim, &[0; 63], "f: byte 0: 63 bytes of a record, expected 64"),
        (Champsim, &[0; 64], none),
        (Champsim, &lying, "f: byte 64: an instruction that is a branch: 1, and taken: 2; expected 0 or 1 each"),
        (Ramulator, b"LD\n", &format!("f:1:3: the line ends here, expected {ramulator}")),
        (Ramulator, b"LD 0x10\nPD 1\n", &format!("f:2:1: \"PD\" and \"1\", expected {ramulator}")),
        (Ramulator, b"LD 1 2\n", "f:1:6: \"2\", expected the end of the line"),
        (
            Ramulator,
            b"LD 0x10000000000000000\n",
            &format!("f:1:1: \"LD\" and \"0x10000000000000000\", expected {ramulator}"),
        ),
        (Json, b"", none),
        (Json, b"{\"address\":1}\n{\"bytes\":1}\n", &format!("f:2:11: missing field `address`, {json}")),
        (Json, b"{\"address\":-1}\n", &format!("f:1:13: invalid value: integer `-1`, expected u64, {json}")),
        (Json, b"{\"address\":1,\"bytes\":0}\n", "f:1:1: 0 bytes, expected 1 to 1048576"),
        (Json, b"{\"address\":1\n", &format!("f:1:12: EOF while parsing an object, {json}")),
        (Json, b"[[[[[[\n", &format!("f:1:1: invalid type: sequence, expected u64, {json}")),
    ];
    for (format, bytes, expected) in cases {
        let error = of_format(*format, bytes).expect_err(expected);
        assert_eq!(error, *expected);
    }
}

#[test]
fn there_is_an_end_to_references() {
    use crate::replay::importers::access::{AccessKind, ObjectId};
    let mut builder = Builder::of_objects().expect("a temporary file");
    builder.references_max = 3;
    let mut append = || builder.object(AccessKind::Read, ObjectId::Number(1), 1);
    assert_eq!([append(), append(), append()], [Ok(()), Ok(()), Ok(())]);
    assert_eq!(append(), Err("more than 3 references, expected fewer".to_owned()));
}
