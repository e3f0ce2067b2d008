//! The master: owns its cluster's job queue, hands tiles to the nodes that ask, reports what became of them.

pub(in crate::processes) mod dispatcher;
pub(in crate::processes) mod seat;
pub mod state;

use std::sync::Arc;

use self::state::State;
use crate::processes::Child;
use crate::processes::driver::live::{self, NoTasks, ProcessError};
use crate::protocol::hello::Role;

/// Serves until the manager says that all is done.
///
/// # Errors
/// The manager or the bus cannot be reached, or the manager is gone.
pub fn run(child: &Child) -> Result<(), ProcessError> {
    let Role::Master(cluster) = child.bootstrap.role else {
        return Err(ProcessError::Failed(format!("a {} is no master", child.bootstrap.role)));
    };
    live::run(child, State::new(cluster), NoTasks, Arc::default())
}
