//! Pixels that are wrong, missing, too many or too early.

use crate::run::{COUNTED, PATIENT, VERIFIED, WHOLE, finds, modes, right, run, survives};

modes! {
    nopixels: finds [WHOLE] [WHOLE, VERIFIED] [COUNTED];
    ahead: finds [COUNTED] [COUNTED, VERIFIED] [COUNTED, "run.assignment=on_demand"];
    maxattempt: finds [WHOLE] [COUNTED, VERIFIED];
    nextattempt: finds [WHOLE] [COUNTED, VERIFIED];
    /// The others get on, though nothing ends the connection that is not read.
    noread: survives [COUNTED, PATIENT, "image.tile=4", "run.assignment=on_demand"];
    nan: finds [WHOLE] [COUNTED, VERIFIED];
    infinite: finds [WHOLE];
    greylast: finds [WHOLE, VERIFIED] [COUNTED, "run.verify=0.000001"];
    greylater: finds [WHOLE, "run.verify=0.000001"];
    greyheld: finds [WHOLE, VERIFIED] [COUNTED, "run.verify=0.000001"];
    falsechecker: finds [COUNTED, "run.verify=0.2"] [WHOLE, "run.verify=1"];
    badcrc: finds [WHOLE];
    oversize: finds [WHOLE];
    undersize: finds [COUNTED];
    nosuchtile: finds [WHOLE];
    duplicates: survives [WHOLE, "image.tile=4"];
    changed: finds [WHOLE, VERIFIED];
    disputes: finds [COUNTED, VERIFIED] [WHOLE, "run.assignment=on_demand"];
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
