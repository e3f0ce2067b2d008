//! What a node asks of the bus that it should not.

use cluster::protocol::memory::{BULK_BYTES_MAX, MemoryReply, MemoryRequest};
use ground::ids::{Address, Attempt, TileId};
use trace::database::Section;

use super::ground::Ground;
use super::{Outcome, deed};

const TILE: TileId = TileId(0);
const ATTEMPT: Attempt = Attempt(0);
const FETCHES: u64 = 1000;
const MESSAGES: u32 = 1_000_000;
const BULKS: u32 = 100;

fn fetch(section: Section, address: u64, line_bytes: u16, lines: u32, accesses_before: u64) -> MemoryRequest {
    let address = Address(address);
    MemoryRequest::Fetch { tile: TILE, attempt: ATTEMPT, section, address, line_bytes, lines, accesses_before }
}

pub(crate) async fn bad_fetches(ground: &mut Ground) -> Outcome {
    let bad = [
        fetch(Section::OctreeNodes, u64::MAX, 64, 1, 0),
        fetch(Section::OctreeNodes, u64::MAX - 63, 64, u32::MAX, 0),
        fetch(Section::OctreeNodes, 1 << 40, 64, 1, 0),
        fetch(Section::OctreeNodes, 1, 64, 1, 0),
        fetch(Section::OctreeNodes, 0, 0, 1, 0),
        fetch(Section::OctreeNodes, 0, 65535, 1, 0),
        fetch(Section::OctreeNodes, 0, 64, 0, 0),
        fetch(Section::Materials, 0, 64, 1, 0),
        MemoryRequest::Bulk { address: Address(0), bytes: 0 },
        MemoryRequest::Bulk { address: Address(0), bytes: u32::MAX },
        MemoryRequest::Bulk { address: Address(u64::MAX), bytes: BULK_BYTES_MAX },
    ];
    for request in bad {
        let (mut bus, mut replies) = ground.talk::<MemoryRequest, MemoryReply>(ground.bus()).await?;
        bus.send(&request).await?;
        match replies.receive().await? {
            Some(MemoryReply::Refused(why)) => deed(format_args!("was refused a fetch: {why}")),
            other => return Err(format!("{request:?} was answered by {other:?}").into()),
        }
    }
    Ok(())
}

pub(crate) async fn store(ground: &mut Ground) -> Outcome {
    let (mut bus, mut replies) = ground.talk::<MemoryRequest, MemoryReply>(ground.bus()).await?;
    deed("stores");
    bus.send_with_bulk(&MemoryRequest::Store { address: Address(0) }, [7; 16].as_slice()).await?;
    match replies.receive().await {
        Ok(Some(MemoryReply::Stored)) => Err("the bus lets a node store".into()),
        _ => Ok(()),
    }
}

pub(crate) async fn extra_fetches(ground: &mut Ground) -> Outcome {
    let (mut bus, mut replies) = ground.talk::<MemoryRequest, MemoryReply>(ground.bus()).await?;
    deed("fetches what it does not tell");
    for fetched in 0..FETCHES {
        bus.send(&fetch(Section::OctreeNodes, 0, 64, 1, fetched)).await?;
        replies.receive_with_bulk().await?;
    }
    Ok(())
}

pub(crate) async fn messages(ground: &mut Ground) -> Outcome {
    let (mut bus, _replies) = ground.talk::<MemoryRequest, MemoryReply>(ground.bus()).await?;
    deed("does not stop to talk");
    for _ in 0..MESSAGES {
        bus.send(&MemoryRequest::Pixels { tile: TILE, attempt: ATTEMPT, bytes: u32::MAX }).await?;
    }
    Ok(())
}

pub(crate) async fn bulk_unread(ground: &mut Ground) -> Outcome {
    let (mut bus, replies) = ground.talk::<MemoryRequest, MemoryReply>(ground.bus()).await?;
    let bytes = ground.configuration.header.layout.database_bytes().min(u64::from(BULK_BYTES_MAX)) as u32;
    deed("reads nothing");
    for _ in 0..BULKS {
        bus.send(&MemoryRequest::Bulk { address: Address(0), bytes }).await?;
    }
    std::mem::forget((bus, replies));
    Ok(())
}
