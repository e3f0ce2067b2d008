//! Nodes that live too long, too short, or to no purpose.

use crate::run::{COUNTED, VERIFIED, WHOLE, finds, survives};

#[test]
fn silent() {
    finds("silent", &[WHOLE]);
    finds("silent", &[COUNTED, VERIFIED]);
}

#[test]
fn lazy() {
    finds("lazy", &[WHOLE]);
}

#[test]
fn sluggard() {
    survives("sluggard", &[WHOLE, "run.assignment=on_demand"]);
}

/// Each of its processes does a tile, so that its place is not set aside.
#[test]
fn mortal() {
    survives("mortal", &[WHOLE, "image.tile=16"]);
}

#[test]
fn dieholding() {
    finds("dieholding", &[WHOLE]);
}

#[test]
fn nofinish() {
    survives("nofinish", &[WHOLE]);
}
