//! The five kinds of process. Each is an async shell around a synchronous state; none imports another,
//! they share meaning through [`crate::protocol`] alone.

pub mod bootstrap;
pub mod bus;
pub mod control_link;
pub mod display;
pub mod manager;
pub mod master;
pub mod node;

pub use bootstrap::{Child, StartError};
pub use control_link::ControlLink;
