//! Any course of well-formed events, as bytes choose them, at times that only go forward; and what each state keeps to in all
//! of them. A fuzz target per state and a test call the same functions.
//!
//! What the manager and the peers send is arbitrary. The driver and the worker keep to the contract of
//! [`driver`](crate::processes::driver): a connection is there before something comes from it, an answer follows its task.

mod bus;
mod display;
mod machine;
mod manager;
mod master;
mod node;

#[cfg(test)]
mod tests;

pub use self::manager::manager;

use self::machine::Course;
use crate::processes::bus::control::Control;
use crate::processes::{display as display_process, master as master_process, node as node_process};

/// # Panics
/// A bus's control conversation breaks a promise, as do those below.
pub fn bus(bytes: &[u8]) {
    Course::<Control>::run(bytes);
}

/// # Panics
/// A display breaks a promise.
pub fn display(bytes: &[u8]) {
    Course::<display_process::state::State>::run(bytes);
}

/// # Panics
/// A master breaks a promise.
pub fn master(bytes: &[u8]) {
    Course::<master_process::state::State>::run(bytes);
}

/// # Panics
/// A node breaks a promise.
pub fn node(bytes: &[u8]) {
    Course::<node_process::state::State>::run(bytes);
}
