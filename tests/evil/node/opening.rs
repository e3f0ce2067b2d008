//! What a node does before its work, or instead of it.

use super::ground::Ground;
use super::mode::Mode;
use super::{Outcome, bus, connections, deed, impostors, reports, unasked};

pub(crate) enum Then {
    /// What a node does, but for what its mode changes there.
    Work,
    /// Nothing: it lives.
    Idle,
    /// Its end, without a word.
    End,
}

pub(crate) async fn act(ground: &mut Ground) -> Outcome<Then> {
    match ground.mode {
        Mode::Ahead => unasked::ahead(ground).await?,
        Mode::Disputes => unasked::disputes(ground).await?,
        Mode::NotHeld => unasked::not_held(ground).await?,
        Mode::Readies => unasked::readies(ground).await?,
        Mode::Silent => deed("does nothing"),
        Mode::Reconnect => connections::reconnect(ground).await?,
        Mode::Crowd => connections::crowd(ground).await?,
        Mode::Knock => connections::knock(ground).await,
        Mode::SlowDisplay | Mode::SlowMaster | Mode::SlowBus => connections::slow(ground).await?,
        Mode::Giant => connections::giant(ground).await?,
        Mode::Foreign => connections::foreign(ground).await?,
        Mode::BadFetch => bus::bad_fetches(ground).await?,
        Mode::Store => bus::store(ground).await?,
        Mode::ExtraFetches => bus::extra_fetches(ground).await?,
        Mode::BusMessages => bus::messages(ground).await?,
        Mode::BulkUnread => bus::bulk_unread(ground).await?,
        Mode::PoseNode => impostors::node(ground).await?,
        Mode::PoseTwice => impostors::twice(ground).await,
        Mode::PoseFuture => impostors::future(ground).await,
        Mode::PoseMaster => impostors::master(ground).await,
        Mode::PoseLoader => impostors::loader(ground).await,
        Mode::Incidents => reports::incidents(ground).await?,
        Mode::Failed => reports::failed(ground).await?,
        Mode::Leaving => reports::leaving(ground).await?,
        Mode::Finished => reports::finished(ground).await?,
        Mode::Packets => reports::packets(ground).await?,
        Mode::ControlFlood => reports::flood(ground).await?,
        _ => {}
    }
    Ok(match ground.mode {
        Mode::Leaving => Then::End,
        Mode::NotHeld
        | Mode::Readies
        | Mode::Silent
        | Mode::SlowDisplay
        | Mode::SlowMaster
        | Mode::SlowBus
        | Mode::Giant
        | Mode::Foreign
        | Mode::BulkUnread
        | Mode::Failed
        | Mode::Finished => Then::Idle,
        _ => Then::Work,
    })
}
