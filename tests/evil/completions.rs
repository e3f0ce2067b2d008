//! Tiles reported done that are not, and counts that cannot be.

use crate::run::{COUNTED, VERIFIED, WHOLE, finds, modes, run, survives};

modes! {
    earlydone: finds [WHOLE];
    othertile: finds [WHOLE] [COUNTED, VERIFIED];
    notheld: finds [WHOLE] [COUNTED, VERIFIED];
    donetwice: finds [WHOLE];
    readies: finds [WHOLE];
    hoard: finds [WHOLE]
        // The others take its tiles before it fails three times.
        survives [COUNTED, VERIFIED, "run.assignment=on_demand"];
    maxcounters: finds [WHOLE] [COUNTED];
    moremisses: finds [COUNTED];
    wrongrays: finds [WHOLE] [COUNTED];
}

/// Within its bounds a count is believed: that it is wrong shows when all are added up.
#[test]
fn wronghits() {
    run("wronghits", &[COUNTED]).assert_failed("wronghits", "counts do not agree");
}
