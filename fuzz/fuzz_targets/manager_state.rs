//! Any course of events of a manager, as the bytes choose them.
#![no_main]

use cluster::processes::simulation::arbitrary;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| arbitrary::manager(bytes));
