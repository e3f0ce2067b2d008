//! A node that poses as another process: no other process is condemned for it.

use crate::run::{COUNTED, VERIFIED, WHOLE, modes, survives};

modes! {
    posenode: survives [WHOLE] [COUNTED, VERIFIED];
    posetwice: survives [COUNTED];
    posefuture: survives [COUNTED];
    poseloader: survives [COUNTED];
}

#[test]
fn posemaster() {
    let outcome = survives("posemaster", &[COUNTED]);
    let lost = outcome.incidents().iter().any(|text| text.starts_with("the master: bus "));
    assert!(!lost, "the master lost its connection: {:?}", outcome.incidents());
}
