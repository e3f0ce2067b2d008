//! Connections without end, without words or with the wrong ones; and the bus.

use crate::run::{COUNTED, PATIENT, WHOLE, finds, run, run_with_files, survives};

#[test]
fn reconnect() {
    survives("reconnect", &[WHOLE]);
}

/// The display may have as many files open as most systems let it.
#[test]
fn crowd() {
    run_with_files("crowd", 1024, &[WHOLE]).assert_right("crowd");
}

#[test]
fn knock() {
    survives("knock", &[WHOLE]);
}

#[test]
fn slowdisplay() {
    finds("slowdisplay", &[WHOLE]);
}

#[test]
fn slowmaster() {
    finds("slowmaster", &[WHOLE]);
}

#[test]
fn slowbus() {
    finds("slowbus", &[COUNTED]);
}

#[test]
fn giant() {
    finds("giant", &[WHOLE]);
}

#[test]
fn foreign() {
    finds("foreign", &[WHOLE]);
}

#[test]
fn badfetch() {
    survives("badfetch", &[COUNTED]);
}

#[test]
fn store() {
    survives("store", &[COUNTED]);
}

#[test]
fn extrafetches() {
    run("extrafetches", &[COUNTED]).assert_failed("extrafetches", "books do not hold");
}

#[test]
fn busmessages() {
    survives("busmessages", &[WHOLE, PATIENT]);
}

#[test]
fn bulkunread() {
    finds("bulkunread", &[WHOLE]);
}
