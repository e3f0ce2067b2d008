use super::*;

/// So many in every test run; `cargo bench --bench simulated` does more.
const SLICE: u64 = 200;

#[test]
fn whatever_goes_wrong_the_promises_are_kept() {
    let slice = std::env::var("SCHEDULES").ok().and_then(|s| s.parse().ok()).unwrap_or(SLICE);
    let first = std::env::var("FIRST").ok().and_then(|s| s.parse().ok()).unwrap_or(0);
    let mut bad = 0;
    for seed in first..first + slice {
        let schedule = Schedule::random(seed);
        let outcome = rehearse(&schedule, None);
        if !outcome.broken.is_empty() {
            bad += 1;
            if bad < 12 {
                println!("{schedule}\n{:#?}\n{:#?} {:?}", outcome.broken, outcome.incidents, outcome.end);
            }
        }
    }
    assert_eq!(bad, 0);
}

#[test]
fn one_seed_is_one_course_of_events() {
    for seed in [3, 17] {
        let schedule = Schedule::random(seed);
        let [one, other] = [(); 2].map(|()| rehearse(&schedule, None));
        assert_eq!((one.took, one.decisions, one.incidents), (other.took, other.decisions, other.incidents));
    }
}
