//! The guard of the hot paths' instruction counts (`just instructions`): that it reads callgrind's files, and finds what is off.

#[path = "../benches/instructions/callgrind.rs"]
mod callgrind;
#[path = "../benches/instructions/recorded.rs"]
mod recorded;

use std::path::Path;

use recorded::{Count, Recorded};

/// A function of the program that calls another of its own, one of the C library, and itself after that; names are compressed.
const COUNTS: &str = "# callgrind format
version: 1
creator: callgrind-3.19.0
positions: line
events: Ir
summary: 1121

ob=(1) /target/release/deps/program
fl=(1) ???
fn=(1) program::paths::one
0 7
+3 3
cob=(2) /usr/lib/libc.so.6
cfn=(2) memcpy
calls=2 0
0 1000
cob=(1)
cfn=(3) program::inner
calls=1 0
0 100
* 11

ob=(2)
fn=(2)
0 1000

ob=(1)
fn=(3)
12 99
-5 1
totals: 1121
";

#[test]
fn the_program_s_own_instructions_are_counted_once() {
    let program = Path::new("/target/release/deps/program");
    assert_eq!(callgrind::instructions_of(COUNTS, program), Ok(7 + 3 + 11 + 99 + 1));
    assert_eq!(callgrind::instructions_of(COUNTS, Path::new("/usr/lib/libc.so.6")), Ok(1000));
    assert_eq!(callgrind::instructions_of(COUNTS, Path::new("/another")), Ok(0));
    let cycles = COUNTS.replace("events: Ir", "events: Cy");
    assert!(callgrind::instructions_of(&cycles, program).is_err());
    let broken = COUNTS.replace("+3 3", "+3 three");
    let error = callgrind::instructions_of(&broken, program).expect_err("no cost");
    assert_eq!(error, "line 12: \"+3 three\", expected a position and a cost");
}

fn count(path: &str, instructions: u64) -> Count {
    Count { path: path.to_owned(), unit: "ray".to_owned(), units: 100, instructions }
}

#[test]
fn what_is_more_than_one_percent_off_is_found_in_both_directions() {
    let counts = vec![count("slower", 10_000), count("same", 10_000), count("faster", 10_000)];
    let recorded = Recorded { reason: String::new(), compiler: String::new(), counts };
    let counts = [count("slower", 10_101), count("same", 10_099), count("faster", 9_899), count("new", 1)];
    assert_eq!(recorded.off(&counts), ["slower", "faster", "new"]);
    assert_eq!(recorded.off(&recorded.counts), Vec::<String>::new());
    // More units at the same cost of each are no change.
    let twice = Count { units: 200, instructions: 20_000, ..count("same", 0) };
    assert_eq!(recorded.ratio(&twice), Some(1.0));
    let text = recorded::table(&counts[..1], Some(&recorded));
    assert!(text.ends_with("slower                           100           101.0  ray            +1.01 %\n"), "{text}");
}

#[test]
fn every_path_is_recorded() {
    let recorded = Recorded::read().expect("it is in the repository");
    let paths = include_str!("../benches/instructions/paths.rs");
    let defined = paths.matches("path(\"").count();
    assert_eq!(recorded.counts.len(), defined, "`just instructions-record REASON`");
    assert!(recorded.counts.iter().all(|count| paths.contains(&format!("path(\"{}\"", count.path))));
}
