use super::*;

/// So many in every test run; `cargo bench --bench simulated` does more.
const SLICE: u64 = 200;

#[test]
fn whatever_goes_wrong_the_promises_are_kept() {
    for seed in 0..SLICE {
        let schedule = Schedule::random(seed);
        let outcome = rehearse(&schedule, None);
        assert!(outcome.broken.is_empty(), "{schedule}\n{:#?}\n{:#?}", outcome.broken, outcome.incidents);
    }
}

#[test]
fn one_seed_is_one_course_of_events() {
    for seed in [3, 17] {
        let schedule = Schedule::random(seed);
        let [one, other] = [(); 2].map(|()| rehearse(&schedule, None));
        assert_eq!((one.took, one.decisions, one.incidents), (other.took, other.decisions, other.incidents));
    }
}
