//! A schedule of faults. What is accepted prints as itself, and finds its places or says which it does not find.
#![no_main]

use cluster::chaos::{Cast, FaultSchedule};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    let Ok(schedule) = text.parse::<FaultSchedule>() else { return };
    assert_eq!(schedule.to_string().parse(), Ok(schedule.clone()));
    let _ = schedule.faults(Cast { clusters: 2, nodes: 5 });
});
