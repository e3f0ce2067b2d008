//! Pixels that are wrong, missing, too many or too early.

use crate::run::{COUNTED, PATIENT, VERIFIED, WHOLE, finds, right, run, survives};

#[test]
fn nopixels() {
    finds("nopixels", &[WHOLE]);
    finds("nopixels", &[WHOLE, VERIFIED]);
    finds("nopixels", &[COUNTED]);
}

#[test]
fn ahead() {
    finds("ahead", &[COUNTED]);
    finds("ahead", &[COUNTED, VERIFIED]);
    finds("ahead", &[COUNTED, "run.assignment=on_demand"]);
}

#[test]
fn maxattempt() {
    finds("maxattempt", &[WHOLE]);
    finds("maxattempt", &[COUNTED, VERIFIED]);
}

#[test]
fn nextattempt() {
    finds("nextattempt", &[WHOLE]);
    finds("nextattempt", &[COUNTED, VERIFIED]);
}

/// The others get on, though nothing ends the connection that is not read.
#[test]
fn noread() {
    survives("noread", &[COUNTED, PATIENT, "image.tile=4", "run.assignment=on_demand"]);
}

#[test]
fn nan() {
    finds("nan", &[WHOLE]);
    finds("nan", &[COUNTED, VERIFIED]);
}

#[test]
fn infinite() {
    finds("infinite", &[WHOLE]);
}

/// Plausible pixels are found out by comparison alone.
#[test]
fn grey() {
    finds("grey", &[WHOLE, VERIFIED]);
    finds("grey", &[COUNTED, "run.verify=0.000001"]);
    let unverified = run("grey", &[WHOLE]);
    assert!(unverified.status.success(), "{}", unverified.stderr);
    assert_ne!(&unverified.report()["image"]["sha256"], right(), "nobody compares");
}

#[test]
fn greylast() {
    finds("greylast", &[WHOLE, VERIFIED]);
    finds("greylast", &[COUNTED, "run.verify=0.000001"]);
}

#[test]
fn greylater() {
    finds("greylater", &[WHOLE, "run.verify=0.000001"]);
}

#[test]
fn greyheld() {
    finds("greyheld", &[WHOLE, VERIFIED]);
    finds("greyheld", &[COUNTED, "run.verify=0.000001"]);
}

#[test]
fn falsechecker() {
    finds("falsechecker", &[COUNTED, "run.verify=0.2"]);
    finds("falsechecker", &[WHOLE, "run.verify=1"]);
}

#[test]
fn badcrc() {
    finds("badcrc", &[WHOLE]);
}

#[test]
fn oversize() {
    finds("oversize", &[WHOLE]);
}

#[test]
fn undersize() {
    finds("undersize", &[COUNTED]);
}

#[test]
fn nosuchtile() {
    finds("nosuchtile", &[WHOLE]);
}

#[test]
fn duplicates() {
    survives("duplicates", &[WHOLE, "image.tile=4"]);
}

#[test]
fn changed() {
    finds("changed", &[WHOLE, VERIFIED]);
}

#[test]
fn disputes() {
    finds("disputes", &[COUNTED, VERIFIED]);
    finds("disputes", &[WHOLE, "run.assignment=on_demand"]);
}
