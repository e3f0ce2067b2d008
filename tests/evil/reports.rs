//! What a node reports to the manager.

use crate::run::{COUNTED, PATIENT, WHOLE, finds, modes, survives};

modes! {
    incidents: survives [WHOLE];
    failed: finds [WHOLE];
    /// A process may be asked to leave by the operator of its machine, and another takes its place; but not for ever where no tile
    /// is done in between.
    leaving: finds [WHOLE] survives [COUNTED, "run.assignment=on_demand"];
    finished: finds [WHOLE];
    packets: survives [WHOLE] [COUNTED];
    controlflood: survives [WHOLE, PATIENT];
    foreigncontrol: finds [WHOLE];
}
