//! Connections without end, without words or with the wrong ones; and the bus.

use crate::run::{COUNTED, PATIENT, WHOLE, finds, modes, run, run_with_files, survives};

modes! {
    reconnect: survives [WHOLE];
    knock: survives [WHOLE];
    slowdisplay: finds [WHOLE];
    slowmaster: finds [WHOLE];
    slowbus: finds [COUNTED];
    giant: finds [WHOLE];
    foreign: finds [WHOLE];
    badfetch: survives [COUNTED];
    store: survives [COUNTED];
    busmessages: survives [WHOLE, PATIENT];
    bulkunread: finds [WHOLE];
}

/// The display may have as many files open as most systems let it.
#[test]
fn crowd() {
    run_with_files("crowd", 1024, &[WHOLE]).assert_right("crowd");
}

#[test]
fn extrafetches() {
    run("extrafetches", &[COUNTED]).assert_failed("extrafetches", "counts do not agree");
}
