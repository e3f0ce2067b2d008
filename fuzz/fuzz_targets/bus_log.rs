//! A bus log and its sidecar: `bus.json`, a NUL, `bus.arrows`.
#![no_main]

use libfuzzer_sys::fuzz_target;
use machine::recording::bus_log::{FILE_NAME, Reader, SIDECAR_NAME};
use marti_fuzz::{split, with_folder};

fuzz_target!(|data: &[u8]| {
    let (sidecar, stream) = split(data);
    with_folder(&[(SIDECAR_NAME, sidecar), (FILE_NAME, stream)], |folder| {
        for reader in [Reader::open(folder), Reader::salvage(folder)] {
            let Ok(mut reader) = reader else { continue };
            let mut rows = 0;
            while let Ok(Some(some)) = reader.next_rows() {
                rows += some.len() as u64;
            }
            assert_eq!(reader.rows(), rows);
        }
    });
});
