//! What no honest node sends, decided apart from the states under test.

use bytes::BytesMut;

use super::roles::Process;
use crate::processes::driver::Incoming as _;
use crate::processes::manager::simulated;
use crate::processes::{display, master};
use crate::protocol::frame::PREFIX_BYTES;
use crate::protocol::hello::Role;
use crate::protocol::mac::Claim;
use crate::protocol::work::WorkRequest;
use ground::ids::{Producer, TileId};
use trace::picture::Pixels;

/// Whether a frame of a node to a display or a master is a forgery: pixels without a permit or that are not finite, a
/// completion without a receipt.
pub(super) fn is_forged(to: &Process, by: Producer, frame: &[u8]) -> bool {
    let (body, role) = (BytesMut::from(frame.get(PREFIX_BYTES..).unwrap_or_default()), Role::Node(by.node));
    let claim = |tile: TileId, attempt| Claim { tile, attempt, node: by.node, epoch: by.epoch };
    let key = simulated::key(by.run);
    match to {
        Process::Display(_) => display::state::Incoming::decode(role, body).is_ok_and(|it| {
            let tile = it.tile;
            !key.is_permit(claim(tile.tile, tile.attempt), tile.permit) || !Pixels::have_finite_colours(1, &it.planes)
        }),
        Process::Master(_) => master::state::Incoming::decode(role, body).is_ok_and(|it| match it.0 {
            WorkRequest::Done { done, receipt } => !key.is_receipt(claim(done.tile, done.attempt), receipt),
            WorkRequest::Ready => false,
        }),
        Process::Bus(_) | Process::Node(_) => false,
    }
}
