//! Memories and buses: what the paper proposes as hardware, recordings of what crossed it, and replays of these through others.

pub mod hardware;
pub mod recording;
pub mod replay;
pub mod tile_order;
