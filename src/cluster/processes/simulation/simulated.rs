//! What a state needs so that it can be simulated: the manager speaks to all kinds of process in one vocabulary.

use crate::processes::driver::Machine;
use crate::processes::manager::process::{Command, Report};

/// A machine whose manager is simulated.
pub(super) trait Simulated: Machine {
    /// `None`: it is for another kind of process.
    fn command(command: Command) -> Option<Self::Command>;

    fn report(report: Self::Report) -> Report;
}
