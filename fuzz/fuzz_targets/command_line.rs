//! What is typed behind `marti`, a line a word.
#![no_main]

use clap::Parser;
use libfuzzer_sys::fuzz_target;
use program::cli::Arguments;

fuzz_target!(|text: &str| {
    let _ = Arguments::try_parse_from(std::iter::once("marti").chain(text.lines()));
});
