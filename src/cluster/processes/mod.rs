//! The five kinds of process. Each is an async shell around a synchronous state; none imports another,
//! they share meaning through [`crate::protocol`] alone. The player stands in for three of them before a bus.

pub mod bootstrap;
pub mod bus;
pub mod control_link;
pub mod display;
pub mod driver;
mod event_queue;
mod folder_claim;
pub mod health;
pub mod join;
mod listening;
mod loader;
pub mod manager;
pub mod master;
pub mod node;
pub mod player;
pub mod scene_warnings;
#[cfg(any(test, feature = "testing"))]
pub mod simulation;
pub mod token;

pub use bootstrap::{Child, StartError};
pub use control_link::ControlLink;
pub use join::Origin;
