use super::super::dice::Dice;
use super::*;

/// So many of each state in every test run.
const COURSES: u64 = 3000;
const BYTES_MAX: u64 = 1000;

fn courses(run: fn(&[u8])) {
    for seed in 0..COURSES {
        let mut dice = Dice::new(seed);
        let bytes: Vec<u8> = (0..dice.below(BYTES_MAX)).map(|_| dice.below(256) as u8).collect();
        if std::panic::catch_unwind(|| run(&bytes)).is_err() {
            panic!("course {seed}");
        }
    }
}

#[test]
fn a_bus_keeps_its_promises_in_any_course_of_events() {
    courses(bus);
}

#[test]
fn a_display_keeps_its_promises_in_any_course_of_events() {
    courses(display);
}

#[test]
fn a_manager_keeps_its_promises_in_any_course_of_events() {
    courses(manager);
}

#[test]
fn a_master_keeps_its_promises_in_any_course_of_events() {
    courses(master);
}

#[test]
fn a_node_keeps_its_promises_in_any_course_of_events() {
    courses(node);
}
