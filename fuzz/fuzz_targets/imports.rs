//! Other people's traces: the first byte says in which format.
#![no_main]

use std::path::Path;

use libfuzzer_sys::fuzz_target;
use machine::replay::importers::{csv, din, oracle_general};

fuzz_target!(|data: &[u8]| {
    let Some((format, bytes)) = data.split_first() else { return };
    let file = Path::new("trace");
    let imported = match format % 3 {
        0 => csv::read(file, bytes),
        1 => din::read(file, bytes),
        _ => oracle_general::read(file, bytes),
    };
    if let Ok(imported) = imported {
        assert!(imported.database_bytes() > 0 || imported.references() == 0);
        let _ = [16, 256].map(|line_bytes| imported.lines(line_bytes));
    }
});
