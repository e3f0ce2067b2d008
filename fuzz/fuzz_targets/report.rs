//! report.json, as `--resume` and studies read it.
#![no_main]

use libfuzzer_sys::fuzz_target;
use marti_fuzz::with_file;

fuzz_target!(|data: &[u8]| {
    with_file("report.json", data, |file| drop(cluster::report::json::read(file)));
});
