//! A process that was not spawned asks the manager for a place. It has said hello with the role that it can play and
//! [`Epoch::JOINING`](ground::ids::Epoch::JOINING); once it has a place, it dials anew, as the holder of that.

use serde::{Deserialize, Serialize};

use super::control::Bootstrap;
use super::frame::messages;
use super::hello::HELLO_BYTES_MAX;

/// The first frame after the welcome.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct JoinRequest {
    /// The topology's name of the host that it wants a place on; `None`: any.
    pub host: Option<String>,
}

#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub enum JoinReply {
    /// All places are taken; said again and again, as a sign of life.
    Wait,
    Place(Box<Bootstrap>),
    /// The run is over.
    Over,
}

messages! {
    JoinRequest: 512, bulk 0;
    JoinReply: HELLO_BYTES_MAX + 4, bulk 0;
}
