//! Reports to the manager that are false, or too many.

use std::time::Duration;

use cluster::processes::Child;
use cluster::protocol::connection::connect;
use cluster::protocol::control::{NodeCommand, NodeReport, Packets};
use cluster::protocol::hello::Role;
use cluster::protocol::work::WorkRequest;
use ground::ids::{Attempt, TileId};
use tokio::time::sleep;
use trace::tracer::simd::Simd;

use super::ground::Ground;
use super::{Outcome, deed, messages};

const INCIDENTS: u32 = 3000;
const HEARTBEATS: u32 = 1_000_000;
const CONNECT_DEADLINE: Duration = Duration::from_secs(5);
/// Longer than it is allowed to live.
const LIFETIME: Duration = Duration::from_secs(60);

/// As long as a report may be, nearly. Wipes a terminal, and looks like the end of a run.
fn text() -> String {
    let forged = format!("\x1b[31;1m\x1b[2J\r\nimage        64x64, sha256 {}\n\x07\u{9b}2J\u{202e}", "0".repeat(64));
    forged + &"x".repeat(60_000)
}

pub(crate) async fn incidents(ground: &mut Ground) -> Outcome {
    for _ in 0..INCIDENTS {
        ground.link.reports.send(NodeReport::Incident(text())).await?;
    }
    deed(format_args!("told {INCIDENTS} incidents"));
    Ok(())
}

pub(crate) async fn failed(ground: &mut Ground) -> Outcome {
    deed("tells a failure");
    Ok(ground.link.reports.send(NodeReport::Failed(text())).await?)
}

pub(crate) async fn leaving(ground: &mut Ground) -> Outcome {
    deed("tells that it leaves");
    Ok(ground.link.reports.send(NodeReport::Leaving).await?)
}

pub(crate) async fn finished(ground: &mut Ground) -> Outcome {
    deed("tells that it has finished");
    Ok(ground.link.reports.send(NodeReport::Finished).await?)
}

pub(crate) async fn packets(ground: &mut Ground) -> Outcome {
    deed("tells of packets");
    let packets = Packets { simd: Simd::Scalar, derived_bytes: u64::MAX };
    Ok(ground.link.reports.send(NodeReport::Packets(packets)).await?)
}

pub(crate) async fn flood(ground: &mut Ground) -> Outcome {
    for _ in 0..HEARTBEATS {
        ground.link.reports.send(NodeReport::Heartbeat).await?;
    }
    deed(format_args!("told {HEARTBEATS} times that it lives"));
    Ok(())
}

/// Instead of its whole life.
pub(crate) async fn foreign(child: &Child) -> Outcome {
    let manager = connect(Role::Manager, child.bootstrap.manager, &child.introduction(), CONNECT_DEADLINE).await?;
    let (mut manager, _commands) = manager.split::<WorkRequest, NodeCommand>();
    deed("says to the manager what is for the master");
    manager.send(&messages::told(TileId(0), Attempt(0))).await?;
    sleep(LIFETIME).await;
    Ok(())
}
