//! What a master may be given.

use std::convert::Infallible;

use super::super::hostile::Forge;
use super::machine::{Arbitrary, NODES};
use crate::processes::driver::PeerId;
use crate::processes::master::state::{Incoming, Outgoing, State};
use crate::protocol::control::{MasterCommand, MasterConfiguration, TileGrant};
use crate::protocol::hello::Role;
use crate::protocol::mac::{Claim, MacKey};
use crate::protocol::work::{WorkReply, WorkRequest};
use ground::ids::{ClusterId, NodeId};
use machine::tile_order::Assignment;

const KEY: MacKey = MacKey::new([1; 32]);

impl Arbitrary for State {
    const TASKS_MAX: usize = 0;

    fn begin() -> Self {
        Self::new(ClusterId(0))
    }

    fn command(forge: &mut Forge) -> MasterCommand {
        match forge.dice.below(16) {
            0 => MasterCommand::Finish,
            1 => MasterCommand::NodeSetAside { node: forge.node() },
            2..5 => MasterCommand::NodeLost { node: forge.node(), epoch: forge.epoch() },
            5..11 => MasterCommand::Tiles((0..forge.dice.below(4)).map(|_| grant(forge)).collect()),
            _ => {
                // Some clusters end with the last node that can be.
                let first = [0, 0, 0, u16::MAX - NODES + 1][forge.dice.below(4) as usize];
                MasterCommand::Configure(MasterConfiguration {
                    bus: ([127, 0, 0, 1], 1).into(),
                    first_node: NodeId(first),
                    nodes: if forge.dice.chance(95) { NODES } else { forge.dice.below(1 << 16) as u16 },
                    threads: 1,
                    assignment: Assignment::OnDemand,
                    tile_deadline_milliseconds: 1000,
                    key: KEY,
                })
            }
        }
    }

    fn message(forge: &mut Forge, peer: PeerId, sent: &[Outgoing]) -> Option<Incoming> {
        // A bus has nothing to say.
        let Role::Node(node) = peer.role else { return None };
        if forge.dice.chance(50) {
            return Some(Incoming(WorkRequest::Ready));
        }
        let mut done = forge.done();
        if !sent.is_empty()
            && let Outgoing::Work(WorkReply::Job { tile, attempt, .. }) = forge.dice.choose(sent)
        {
            (done.tile, done.attempt) = (*tile, *attempt);
        }
        let claim = Claim { tile: done.tile, attempt: done.attempt, node, epoch: peer.epoch };
        let receipt = if forge.dice.chance(95) { KEY.receipt(claim) } else { forge.mac() };
        Some(Incoming(WorkRequest::Done { done, receipt }))
    }

    fn answer(_forge: &mut Forge, task: Infallible) -> Infallible {
        task
    }
}

fn grant(forge: &mut Forge) -> TileGrant {
    TileGrant {
        tile: forge.tile(),
        attempt: forge.attempt(),
        node: forge.dice.chance(20).then(|| forge.node()),
        except: (0..forge.dice.below(3)).map(|_| forge.node()).collect(),
    }
}
