//! What processes say to each other: one file a conversation, and the connection that carries them.
//!
//! A conversation is one pair of enums with named roles. Bulk bytes (lines, pixels, uploads) follow a
//! message in the same frame and are never encoded by the codec.

pub mod connection;
pub mod control;
pub mod frame;
pub mod hello;
pub mod image;
pub mod join;
pub mod mac;
pub mod memory;
pub mod work;
