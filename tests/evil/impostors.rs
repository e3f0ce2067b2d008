//! A node that poses as another process: no other process is condemned for it.

use crate::run::{COUNTED, VERIFIED, WHOLE, survives};

#[test]
fn posenode() {
    survives("posenode", &[WHOLE]);
    survives("posenode", &[COUNTED, VERIFIED]);
}

#[test]
fn posetwice() {
    survives("posetwice", &[COUNTED]);
}

#[test]
fn posefuture() {
    survives("posefuture", &[COUNTED]);
}

#[test]
fn posemaster() {
    let outcome = survives("posemaster", &[COUNTED]);
    let lost = outcome.incidents().iter().any(|text| text.starts_with("the master: bus "));
    assert!(!lost, "the master lost its connection: {:?}", outcome.incidents());
}

#[test]
fn poseloader() {
    survives("poseloader", &[COUNTED]);
}
