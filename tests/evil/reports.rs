//! What a node reports to the manager.

use crate::run::{COUNTED, PATIENT, WHOLE, finds, survives};

#[test]
fn incidents() {
    survives("incidents", &[WHOLE]);
}

#[test]
fn failed() {
    finds("failed", &[WHOLE]);
}

/// A process may be asked to leave by the operator of its machine, and another takes its place; but not for ever where no tile
/// is done in between.
#[test]
fn leaving() {
    finds("leaving", &[WHOLE]);
    survives("leaving", &[COUNTED, "run.assignment=on_demand"]);
}

#[test]
fn finished() {
    finds("finished", &[WHOLE]);
}

#[test]
fn packets() {
    survives("packets", &[WHOLE]);
    survives("packets", &[COUNTED]);
}

#[test]
fn controlflood() {
    survives("controlflood", &[WHOLE, PATIENT]);
}

#[test]
fn foreigncontrol() {
    finds("foreigncontrol", &[WHOLE]);
}
