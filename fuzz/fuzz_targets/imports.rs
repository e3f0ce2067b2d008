//! Other people's traces, plain or compressed: the first byte says in which format, and how columns are found.
#![no_main]

use std::path::Path;

use clap::ValueEnum;
use libfuzzer_sys::fuzz_target;
use machine::hardware::local_memory::Geometry;
use machine::hardware::specification::Replacement;
use machine::replay::Lines;
use machine::replay::importers::{CsvOptions, ImportFormat, ImportOptions, import_from};
use machine::replay::model::writes::{Writing, count_writes};

fuzz_target!(|data: &[u8]| {
    let Some((&choice, bytes)) = data.split_first() else { return };
    let format = ImportFormat::value_variants().get(usize::from(choice % 16)).copied();
    let column = |number: u8| (choice >> 4 & number != 0).then(|| format!("{number}").parse().expect("a column"));
    let csv = match format {
        Some(ImportFormat::Csv) => {
            CsvOptions { id: column(1), address: column(2), size: column(4), ..CsvOptions::default() }
        }
        _ => CsvOptions::default(),
    };
    let options = ImportOptions { format, csv, line_bytes_min: 16 };
    let Ok(imported) = import_from(Path::new("trace"), bytes, &options) else { return };
    for line_bytes in [16, 256, 1 << 16] {
        let lines = imported.lines(line_bytes);
        assert!(lines.count() > 0);
        for record in 0..imported.records() {
            let (first, count) = lines.of(record);
            assert!(count > 0 && first + count <= lines.count());
        }
        let geometry = Geometry { line_bytes, database_lines: lines.count(), sets: 3, ways: 2 };
        let (counters, writes) = count_writes(&imported, geometry, Replacement::Lru, Writing::default()).expect("few");
        assert!(counters.line_misses <= counters.line_accesses && writes.write_misses <= counters.line_misses);
        assert!(writes.write_accesses <= counters.line_accesses);
    }
});
