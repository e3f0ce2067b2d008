//! Tables: their columns, separators and headers.

use std::path::Path;

use super::{Imported, Lines};
use crate::replay::importers::{Column, CsvOptions, ImportFormat, ImportOptions, Notes, import_from};

fn table(text: &str, csv: CsvOptions) -> Result<Imported, String> {
    let options = ImportOptions { format: Some(ImportFormat::Csv), csv, line_bytes_min: 16 };
    import_from(Path::new("f"), text.as_bytes(), &options).map_err(|error| error.to_string())
}

fn column(text: &str) -> Option<Column> {
    Some(text.parse().expect("a column"))
}

#[test]
fn columns_are_found_by_their_names() {
    // A block trace as libCacheSim's samples: blocks are objects, unless their unit is known.
    let text = "time,op,size,lbn\n1,r,512,100\n2,W,4096,108\n3,2a,512,100\n4,?,512,9\n";
    let imported = table(text, CsvOptions::default()).expect("a trace");
    assert!(imported.is_of_objects());
    assert_eq!(imported.notes(), Notes { references: 4, writes: 2, unknown_operations: 1, ..Notes::default() });
    assert_eq!([0, 1, 2].map(|record| imported.object_bytes(record)), [512, 4096, 512]);
    let imported = table(text, CsvOptions { address_unit: Some(512), ..CsvOptions::default() }).expect("a trace");
    assert!(!imported.is_of_objects());
    // Blocks 9, 100, and 108 to 115.
    assert_eq!((imported.lines(512).count(), imported.lines(512).of(1)), (10, (2, 8)));

    // Dates, and blanks in them, as in MSR Cambridge's traces.
    let text = "Timestamp,Hostname,DiskNumber,Type,Offset,Size,ResponseTime\n128166372003061629,hm,1,Read,383496192,32768,413\n";
    let imported = table(text, CsvOptions::default()).expect("a trace");
    assert_eq!((imported.is_of_objects(), imported.object_bytes(0)), (false, 32_768));
}

#[test]
fn columns_have_numbers_where_they_have_no_names() {
    for (text, count) in [
        ("0,key a,5,get\n1,\"b,c\",6,set\n", 2),
        ("0\tkey a\t5\tget\n1\tb,c\t6\tset\n", 2),
        ("0;key a;5;get\n1;b,c;6;set\n", 2),
        ("  0   a   5  get \n1 b 6 set\n", 2),
        ("time,x,y,what\n0,key a,5,get\n", 1),
    ] {
        let header = text.starts_with("time").then_some(true);
        let csv =
            CsvOptions { id: column("2"), size: column("3"), operation: column("4"), header, ..CsvOptions::default() };
        let imported = table(text, csv).expect(text);
        assert_eq!((imported.records(), imported.object_bytes(0)), (count, 5), "{text}");
        assert_eq!(imported.notes().writes, u64::from(count == 2));
    }
    let separated = |text: &str, separator: &str| {
        let separator = Some(separator.parse().expect("a separator"));
        table(text, CsvOptions { id: column("1"), separator, header: Some(false), ..CsvOptions::default() })
    };
    assert_eq!(separated("a|b\nc|d\n", "|").expect("a trace").records(), 2);
    assert_eq!(separated("a,1|b\nc,1|d\n", "comma").expect("a trace").records(), 2);
    // One column needs no name.
    assert_eq!(table("5\n6\n5\n", CsvOptions::default()).expect("a trace").records(), 2);
}

#[test]
fn deletions_are_no_references() {
    let imported = table("key,op\na,set\na,delete\nb,get\n", CsvOptions::default()).expect("a trace");
    assert_eq!(imported.notes(), Notes { references: 2, writes: 1, invalidations: 1, ..Notes::default() });
}

#[test]
fn bad_tables_are_named_by_their_place() {
    let plain = CsvOptions::default;
    let by = |id: &str| CsvOptions { id: column(id), ..CsvOptions::default() };
    let names = "address, addr, lbn, lba, id, obj_id, object_id, objid, object, key, block, offset";
    let address = "expected an address of at most 64 bits, decimal or hexadecimal after 0x";
    let cases: &[(&str, CsvOptions, &str)] = &[
        ("", plain(), "f: no references, expected at least one"),
        ("\n\n", plain(), "f: no references, expected at least one"),
        ("address\n", plain(), "f: no references, expected at least one"),
        (
            "x,type\n1,2\n",
            plain(),
            &format!("f:1:1: no column of addresses or ids, expected one named {names}, or to be told which"),
        ),
        (
            "1,2\n",
            plain(),
            "f:1:1: no names of columns, expected the numbers of those that are used, such as --csv-address 1",
        ),
        (
            "a,b\n",
            by("1"),
            "f:1:1: a first row without a number or a known name, expected --csv-header: whether it names the columns",
        ),
        ("a,b\n1,2\n", by("c"), "f:1:1: no column \"c\", expected one of \"a\", \"b\""),
        ("1,2\n", by("3"), "f:1:1: no column 3, expected one of 1 to 2"),
        ("address,address\n", plain(), "f:1:9: a second column \"address\", expected one"),
        ("a,address\n1,2\n3\n", plain(), "f:3:2: a row of 1 fields, expected 2"),
        ("a,address\n1,2,3\n", plain(), "f:2:6: a row of 3 fields, expected 2"),
        ("a,address\n1,ff\n", plain(), &format!("f:2:3: \"ff\", {address}")),
        ("a,address\n1,-4\n", plain(), &format!("f:2:3: \"-4\", {address}")),
        ("a,address\n1,\n", plain(), &format!("f:2:3: \"\", {address}")),
        ("a,key\n1,\n", plain(), "f:2:3: an empty field, expected an id"),
        ("address,bytes\n1, x\n", plain(), "f:2:4: \"x\", expected bytes, 1 to 1048576"),
        ("address,bytes\n1,0\n", plain(), "f:2:1: 0 bytes, expected 1 to 1048576"),
        ("address,bytes\n1,4294967295\n", plain(), "f:2:1: 4294967295 bytes, expected 1 to 1048576"),
        (
            "address,bytes\n18446744073709551615,8\n",
            plain(),
            "f:2:1: address 0xffffffffffffffff and 8 bytes, expected an end within 64 bits",
        ),
        (
            "address\n36028797018963968\n",
            CsvOptions { address_unit: Some(512), ..plain() },
            &format!("f:2:1: \"36028797018963968\", {address}"),
        ),
        (
            "address,b\n1,\"x\n",
            plain(),
            "f:2:3: a quotation mark that is not closed on its line, or text after it, expected one and a separator",
        ),
        (
            "key,size\na,18446744073709551616\n",
            plain(),
            "f:2:3: \"18446744073709551616\", expected a size of at most 64 bits",
        ),
        ("a,1\n", CsvOptions { size: column("1"), ..by("1") }, "f:1:1: column 1 twice, expected another one"),
        (
            "a,b\n",
            CsvOptions { header: Some(false), ..by("a") },
            "f:1:1: no names of columns, expected a number for \"a\"",
        ),
    ];
    for (text, csv, expected) in cases {
        assert_eq!(table(text, csv.clone()).expect_err(expected), *expected);
    }
    for column in ["0", "", " "] {
        assert!(column.parse::<Column>().is_err());
    }
    assert!(recognised_with_columns().contains("this is no table"));
}

fn recognised_with_columns() -> String {
    let csv = CsvOptions { id: column("1"), ..CsvOptions::default() };
    let options = ImportOptions { format: None, csv, line_bytes_min: 16 };
    import_from(Path::new("x.din"), &b"0 1\n"[..], &options).expect_err("no table").to_string()
}
