//! Nodes that live too long, too short, or to no purpose.

use crate::run::{COUNTED, VERIFIED, WHOLE, finds, modes, survives};

modes! {
    silent: finds [WHOLE] [COUNTED, VERIFIED];
    lazy: finds [WHOLE];
    sluggard: survives [WHOLE, "run.assignment=on_demand"];
    /// Each of its processes does a tile, so that its place is not set aside.
    mortal: survives [WHOLE, "image.tile=16"];
    dieholding: finds [WHOLE];
    nofinish: survives [WHOLE];
}
