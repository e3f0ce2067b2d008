//! A node in another one's name: nobody comes to harm of what was not his.

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
    survives("posemaster", &[COUNTED]);
}

#[test]
fn poseloader() {
    survives("poseloader", &[COUNTED]);
}
