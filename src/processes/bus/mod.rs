//! The bus process: cluster memory, arbitration, and the log of both.
mod client;
pub mod memory_loop;
pub mod state;
