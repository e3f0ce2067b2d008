//! What a node tells the manager.

use crate::run::{COUNTED, WHOLE, finds, survives};

#[test]
fn incidents() {
    survives("incidents", &[WHOLE]);
}

#[test]
fn failed() {
    finds("failed", &[WHOLE]);
}

/// It is asked to leave by whoever has its machine, which the manager cannot know: it may come back.
#[test]
fn leaving() {
    survives("leaving", &[WHOLE, "run.assignment=on_demand"]);
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
    survives("controlflood", &[WHOLE]);
}

#[test]
fn foreigncontrol() {
    finds("foreigncontrol", &[WHOLE]);
}
