//! Connections that are made too often, stay too long, say too little or what has no place there.

use std::io::Write;
use std::time::Duration;

use cluster::protocol::control::NodeCommand;
use cluster::protocol::frame;
use cluster::protocol::hello::{HelloReply, Role};
use cluster::protocol::image::TilePixels;
use cluster::protocol::mac::Mac;
use cluster::protocol::memory::MemoryRequest;
use cluster::protocol::work::{WorkReply, WorkRequest};
use ground::ids::{Attempt, Epoch, NodeId, TileId};
use nix::sys::resource::{Resource, getrlimit, setrlimit};
use tokio::time::{sleep, timeout};

use super::ground::Ground;
use super::mode::Mode;
use super::{Outcome, deed, messages};

const CONNECTIONS: u32 = 2000;
const KNOCKS: u32 = 1500;
/// For a display that has no room.
const DIAL_DEADLINE: Duration = Duration::from_millis(500);
/// Between two bytes.
const PAUSE: Duration = Duration::from_secs(1);

pub(crate) async fn reconnect(ground: &mut Ground) -> Outcome {
    for _ in 0..CONNECTIONS {
        ground.dial(Role::Display).await?;
    }
    deed(format_args!("dialled {CONNECTIONS} times"));
    Ok(())
}

/// As many as the display takes, but for the one that its work needs.
pub(crate) async fn crowd(ground: &mut Ground) -> Outcome {
    let (_, hard) = getrlimit(Resource::RLIMIT_NOFILE)?;
    setrlimit(Resource::RLIMIT_NOFILE, hard, hard)?;
    let mut crowd = Vec::new();
    while crowd.len() < CONNECTIONS as usize
        && let Ok(Ok(connection)) = timeout(DIAL_DEADLINE, ground.dial(Role::Display)).await
    {
        crowd.push(connection);
    }
    deed(format_args!("holds {} connections", crowd.len()));
    crowd.pop();
    // They stay as long as the process.
    std::mem::forget(crowd);
    Ok(())
}

pub(crate) async fn knock(ground: &mut Ground) {
    let (mut refused, me) = (0, Role::Node(NodeId(0)));
    for epoch in 0..KNOCKS {
        let strangers = [
            ground.dial_as(me, Epoch(7 + epoch), Role::Manager).await,
            ground.dial_as(Role::Display, Epoch(epoch), ground.master()).await,
        ];
        refused += strangers.iter().filter(|stranger| stranger.is_err()).count();
    }
    deed(format_args!("was refused {refused} times"));
}

/// A frame that is right, if it were ever whole.
pub(crate) async fn slow(ground: &mut Ground) -> Outcome {
    let (tile, attempt) = (TileId(0), Attempt(0));
    let (role, frame) = match ground.mode {
        Mode::SlowDisplay => {
            let planes = messages::grey(ground.configuration.tiling, tile, ground.configuration.aov);
            (Role::Display, frame::encode(&messages::pixels(tile, attempt, Mac::default(), &planes), &planes)?)
        }
        Mode::SlowMaster => (ground.master(), frame::encode(&messages::told(tile, attempt), &[])?),
        _ => (ground.bus(), frame::encode(&MemoryRequest::Pixels { tile, attempt, bytes: 3 }, &[])?),
    };
    let mut socket = ground.raw(role).await?;
    deed("sends a byte a second");
    for byte in frame {
        tokio::select! {
            command = ground.link.commands.recv() => if matches!(command, Some(NodeCommand::Finish) | None) { break },
            () = sleep(PAUSE) => if socket.write_all(&[byte]).is_err() { break },
        }
    }
    Ok(())
}

pub(crate) async fn giant(ground: &mut Ground) -> Outcome {
    deed("begins frames of four gigabytes");
    for role in [Role::Display, ground.master(), ground.bus()] {
        let mut socket = ground.raw(role).await?;
        // An error means that it was not heard to the end.
        let _ = socket.write_all(&[&[0xff; 4][..], &[0; 1 << 20]].concat());
        std::mem::forget(socket);
    }
    Ok(())
}

pub(crate) async fn foreign(ground: &mut Ground) -> Outcome {
    deed("says to each what is for another");
    let (mut display, _answers) = ground.talk::<WorkRequest, WorkReply>(Role::Display).await?;
    let _ = display.send(&messages::told(TileId(0), Attempt(0))).await;
    let (mut master, _answers) = ground.talk::<TilePixels, WorkReply>(ground.master()).await?;
    let _ = master
        .send_with_bulk(&messages::pixels(TileId(0), Attempt(0), Mac::default(), &[1; 999]), [1; 999].as_slice())
        .await;
    let (mut bus, _answers) = ground.talk::<HelloReply, WorkReply>(ground.bus()).await?;
    let _ = bus.send(&HelloReply::Refused("go away".repeat(99))).await;
    Ok(())
}
