//! Tiles reported done that are not, and counts that cannot be.

use crate::run::{COUNTED, VERIFIED, WHOLE, finds, run, survives};

#[test]
fn earlydone() {
    finds("earlydone", &[WHOLE]);
}

#[test]
fn othertile() {
    finds("othertile", &[WHOLE]);
    finds("othertile", &[COUNTED, VERIFIED]);
}

#[test]
fn notheld() {
    finds("notheld", &[WHOLE]);
    finds("notheld", &[COUNTED, VERIFIED]);
}

#[test]
fn donetwice() {
    finds("donetwice", &[WHOLE]);
}

#[test]
fn readies() {
    finds("readies", &[WHOLE]);
}

#[test]
fn hoard() {
    finds("hoard", &[WHOLE]);
    // The others take its tiles before it fails three times.
    survives("hoard", &[COUNTED, VERIFIED, "run.assignment=on_demand"]);
}

#[test]
fn maxcounters() {
    finds("maxcounters", &[WHOLE]);
    finds("maxcounters", &[COUNTED]);
}

#[test]
fn moremisses() {
    finds("moremisses", &[COUNTED]);
}

#[test]
fn wrongrays() {
    finds("wrongrays", &[WHOLE]);
    finds("wrongrays", &[COUNTED]);
}

/// Within its bounds a count is believed: that it is wrong shows when all are added up.
#[test]
fn wronghits() {
    run("wronghits", &[COUNTED]).assert_failed("wronghits", "books do not hold");
}
