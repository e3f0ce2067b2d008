//! A node in others' names. Any process that has the run's token can say that it is another one.

use std::time::Duration;

use cluster::protocol::hello::Role;
use cluster::protocol::memory::{MemoryReply, MemoryRequest};
use cluster::protocol::work::{WorkReply, WorkRequest};
use ground::ids::{Address, Attempt, Epoch, NodeId, TileId};
use machine::hardware::transaction::JOB_BYTES;
use tokio::time::sleep;

use super::ground::Ground;
use super::{Outcome, deed, unasked};

const NODE_1: Role = Role::Node(NodeId(1));
/// Whose number no process of a run reaches.
const FUTURE: Epoch = Epoch(1000);
const TIMES: u32 = 20;
const PAUSE: Duration = Duration::from_millis(50);

pub(crate) async fn node(ground: &mut Ground) -> Outcome {
    match ground.dial_as(NODE_1, Epoch(0), Role::Display).await {
        Ok(display) => unasked::all_grey(ground, display).await,
        Err(error) => {
            deed(format_args!("is no node 1: {error}"));
            Ok(())
        }
    }
}

pub(crate) async fn twice(ground: &mut Ground) {
    for _ in 0..TIMES {
        match ground.dial_as(NODE_1, Epoch(0), ground.master()).await {
            Ok(master) => {
                deed("comes to the master as node 1");
                let (mut master, replies) = master.split::<WorkRequest, WorkReply>();
                let _ = master.send(&WorkRequest::Ready).await;
                sleep(PAUSE).await;
                drop(replies);
            }
            Err(error) => deed(format_args!("is no node 1: {error}")),
        }
    }
}

pub(crate) async fn future(ground: &mut Ground) {
    for server in [ground.master(), ground.bus()] {
        match ground.dial_as(NODE_1, FUTURE, server).await {
            Ok(connection) => {
                deed(format_args!("comes to the {server} as a successor of node 1"));
                std::mem::forget(connection);
            }
            Err(error) => deed(format_args!("is no node 1: {error}")),
        }
    }
}

pub(crate) async fn master(ground: &mut Ground) {
    match ground.dial_as(ground.master(), FUTURE, ground.bus()).await {
        Ok(connection) => {
            deed("comes to the bus as its master");
            let (mut bus, replies) = connection.split::<MemoryRequest, MemoryReply>();
            let (node, tile, attempt) = (NodeId(1), TileId(0), Attempt(0));
            let _ = bus.send(&MemoryRequest::Job { node, tile, attempt, bytes: JOB_BYTES }).await;
            std::mem::forget((bus, replies));
        }
        Err(error) => deed(format_args!("is no master: {error}")),
    }
}

pub(crate) async fn loader(ground: &mut Ground) {
    match ground.dial_as(Role::Manager, FUTURE, ground.bus()).await {
        Ok(connection) => {
            deed("comes to the bus as the manager");
            let (mut bus, mut replies) = connection.split::<MemoryRequest, MemoryReply>();
            let _ = bus.send_with_bulk(&MemoryRequest::Store { address: Address(0) }, [7; 4096].as_slice()).await;
            deed(format_args!("its store is answered by {:?}", replies.receive().await));
        }
        Err(error) => deed(format_args!("is no manager: {error}")),
    }
}
